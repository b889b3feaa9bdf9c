"""The whole of `gelforge calibrate`: a recording and a study in, calibrated parameters out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gelforge.calibration.fit import Fit, calibrated
from gelforge.calibration.parameters import free_of
from gelforge.calibration.priors import Prior
from gelforge.calibration.results import write_results
from gelforge.config import Study
from gelforge.laws_of_study import material_laws_of
from gelforge.mismatch.fem.nominal import observations_of
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.pipeline.stage import SOLUTIONS, check_matches, provenance_of, solver_of
from gelforge.mismatch.readings.sessions import read_all, session_folders
from gelforge.progress import stage
from gelforge.recording.readings import Recording

PRESSED = ("load", "dwell")  # phases: an elastic gel has no other forces on the way up


def calibrate_folder(
    study: Study,
    recording: Path,
    names: Sequence[str],
    priors: Mapping[str, Prior],
    out: Path,
    laws: Sequence[Path] = (),
    kept: Path | None = None,
    workers: int = 1,
) -> dict[str, Any]:
    """Calibrate parameters of a study by the sessions in a folder, and write the results.

    Parameters
    ----------
    study : Study
        The sensor as it is described.
    recording : Path
        A session's folder, or a folder of sessions.
    names : sequence of str
        Parameters to be calibrated, such as gel.modulus.
    priors : mapping of str to Prior
        Of parameters whose default prior is to be replaced.
    out : Path
        Folder of the results.
    laws : sequence of Path
        Law files that replace the study's own.
    kept : Path, optional
        Folder of cached solutions; None for one in `out`.
    workers : int
        Number of processes that solve.

    Returns
    -------
    dict
        Content of calibration.json: parameters with 90 % intervals, residuals and held-out errors.

    Raises
    ------
    ConfigError
        For sessions of another sensor, and for parameters that the sensor does not have.
    SolverFailed
        Where the study cannot be solved at the priors' means.
    """
    of_study = recording.resolve() == study.data_folder.resolve()
    folders = session_folders(recording, study.sessions if of_study else ())
    check_matches(folders, study)
    recordings = read_all(folders, study.sensor)
    solver = solver_of(study, out, list(laws), kept or out / SOLUTIONS, workers, recordings)
    fit, synthetic = fit_of(solver, recordings, names, priors)
    stage("tables")
    made = provenance_of(folders, study, solver)
    materials = material_laws_of(study, list(laws))
    return write_results(out, study, fit, materials, recording.name, synthetic, made)


def fit_of(
    solver: Solver, recordings: Sequence[Recording], names: Sequence[str], priors: Mapping[str, Prior]
) -> tuple[Fit, bool]:
    """Return the fit of named parameters of the solver's study to recordings, and whether these are synthetic."""
    stage("readings")
    observations, synthetic = observations_of(recordings, solver.study)
    pressed = observations.table["phase"].isin(PRESSED).to_numpy()
    free = free_of(solver.study, solver.laws, names, priors)
    # What a test says of a material gives way to the prior that is stated here.
    of_free = {one.material for one in free}
    others = {name: moved for name, moved in solver.uncertain.items() if name not in of_free}
    solver = replace(solver, uncertain=others)
    stage("forces of the simulation, and how they follow the parameters")
    loaded = observations.chosen(pressed)
    return calibrated(solver, loaded.at_sites(np.unique(loaded.table["site"])), free), synthetic
