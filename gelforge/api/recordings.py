"""Recorded sessions: reading them, and judging them against a study."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gelforge.api import arguments
from gelforge.api.studies import study_of
from gelforge.config import Study

if TYPE_CHECKING:
    from gelforge.mismatch.result.verdict import Verdict
    from gelforge.recording.readings import Recording


def read_recording(folder: str | Path, study: Study | str | Path | None = None) -> Recording:
    """Return a checked session: positions in the sensor's frame [mm], forces on the sensor [N], zero subtracted.

    Parameters
    ----------
    folder : path
        A session: session.yaml, indentations.csv and what they name (docs/file-formats.md).
    study : Study or path, optional
        Then positions are checked against its sensor, and indentations joined to the sites of its plan.

    Returns
    -------
    Recording
        `readings` (a table with a row per reading), `session` (its description), `findings` (what was found doubtful).

    Raises
    ------
    RecordingError
        What cannot be read or cannot be true: file, row, value and remedy.
    ConfigError
        A session.yaml or a study with a wrong key or value.

    Examples
    --------
    A session of real presses on a GelSight Mini:

    >>> import gelforge as gf
    >>> from gelforge.shipped import EXAMPLES
    >>> recording = gf.read_recording(EXAMPLES / "data/gelsight_mini/feats")
    >>> len(recording.readings), recording.session.sensor
    (5, 'GelSight Mini')
    """
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.recording.readings import read_recording as read

    session = arguments.path("folder", folder, "a session's folder")
    if study is None:
        return read(session)
    described = study_of(study)
    return read(session, plan_cells(described), described.sensor)


def judge(recording: str | Path, study: Study | str | Path, out: str | Path, *, workers: int = 1) -> Verdict:
    """Return what a simulation leaves out of recorded sessions, as `gelforge mismatch` does.

    Parameters
    ----------
    recording : path
        A session's folder, or one that holds some.
    study : Study or path
        What was simulated. Its fitted materials, solved sites and stored derivatives are used where they exist.
    out : path
        Folder for verdict.json, its tables, the patch of the study, and what was solved on the way.
    workers : int
        Processes that solve side by side.

    Returns
    -------
    Verdict
        `state` (consistent, identified, ambiguous, inconclusive, unexplained), `sentence`, groups of
        effects with probabilities, and the rest of verdict.json (docs/mismatch.md).

    Raises
    ------
    ConfigError
        A material without a model, or a session of another sensor.
    RecordingError
        A session that cannot be read.
    SolverFailed
        The simulation cannot be solved at the recorded sites.

    Examples
    --------
    Minutes of finite elements, so that this one is not run with the tests:

    >>> import gelforge as gf
    >>> verdict = gf.judge("data/mine/recordings/day1", "config/mine.yaml", "out")  # doctest: +SKIP
    >>> print(verdict.state, verdict.sentence)  # doctest: +SKIP
    """
    from gelforge.mismatch.pipeline.stage import judge_folder

    described = study_of(study)
    folder = arguments.path("recording", recording, "a session's folder, or of one that holds some")
    out = arguments.path("out", out, "a folder for the results")
    return judge_folder(described, folder, out, workers=arguments.whole("workers", workers))
