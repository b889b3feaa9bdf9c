"""Cases of a development set as problems of the judge, their truths read: how well what is hidden fits is asked."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gelforge.config import load_study
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.fem.nominal import observations_of, problem_of
from gelforge.mismatch.pipeline.stage import solver_of
from gelforge.mismatch.readings.sessions import session_folders
from validation import sealing
from validation.draw import DEVELOPMENT, Case, cases
from validation.library import Library, load_library
from validation.score import session_names
from validation.sets import CONFIG
from validation.world import World, zeroed

SETS = Path("results/concealed/sets")


@dataclass(frozen=True, eq=False)
class Known:
    """A single effect that is hidden in a recording, and the recording next to its base."""

    name: str
    hidden: dict  # name, form, values, snr; where, if it has a place
    change: np.ndarray  # (n,) [N] that it makes to the entries, no noise or contact-point error in either
    problem: Problem
    seed: int


def known_singles(
    folder: Path,
    kept: Path,
    weakest: float = 0.0,
    located: bool = False,
    names: Collection[str] | None = None,
    workers: int = 1,
) -> Iterator[Known]:
    """Yield the single effects of a development set on the plain base, of a signal-to-noise of `weakest` and more.

    located: only those that have a place. names: only these cases. workers: presses solved side by side.
    Raises ValueError for a reporting set: its truths belong to its scorer.
    """
    published = sealing.read(folder / "sealed.json")
    if published["seed"] >= DEVELOPMENT:
        raise ValueError(f"{folder} is a reporting set; its truths are opened by `score` alone")
    library = load_library()
    for case in cases({"small": library}, published["seed"], published["numbers"]):
        hidden = case.truth["effects"][0] if case.content == "single" else {"snr": -1.0}
        if case.base != "concealed" or hidden["snr"] < weakest or (located and "where" not in hidden):
            continue
        if names is not None and case.name not in names:
            continue
        study = load_study(CONFIG / f"{case.base}.yaml")
        folders = session_folders(folder / "cases" / case.name)
        solver = solver_of(study, kept, [], kept, workers, folders)
        problem, _ = problem_of(solver, observations_of(folders, study)[0])
        yield Known(case.name, hidden, _change(library, case, problem), problem, study.seed)


def _change(library: Library, case: Case, problem: Problem) -> np.ndarray:
    """Return what is hidden changes of the entries (n,) [N], no noise or contact-point error in either."""
    rows, labels = case.rows, problem.labels
    plain = World(library).forces(rows)
    by = np.array(case.truth["readings"]["force_N"]) - zeroed(rows, plain, case.instrument.tared)
    of_reading = dict(zip(zip(session_names(case.truth), rows["time_s"].round(3)), by))
    entries = zip(labels["session"], labels["time_s"].round(3), labels["axis"])
    return np.array([of_reading[session, time][axis] for session, time, axis in entries])
