"""The whole stage: a recording and a study in, verdict.json, readings.csv, body_map.csv and config.patch.yaml out."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gelforge.config import ConfigError, Session, Study, load_session, write_yaml
from gelforge.files import digest, file_sha256
from gelforge.laws_of_study import laws_and_doubts, material_laws_of
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.candidates import body_map
from gelforge.mismatch.evidence.kernels import Module
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.evidence.screen import Term
from gelforge.mismatch.fem.nominal import observations_of, problem_of
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.fem.solver import Base
from gelforge.mismatch.images.flow import with_flow
from gelforge.mismatch.inference.judge import Judgement, judge
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.pipeline.experiments import with_experiments
from gelforge.mismatch.readings.sessions import read_all, session_folders
from gelforge.mismatch.result.verdict import PATCH, Provenance, Verdict, versions, write_verdict
from gelforge.mismatch.result.verdict_tables import (
    BODY_MAP,
    CORRECTION,
    FLOW,
    LIMITS,
    MODULE,
    READINGS,
    limits_table,
    write_tables,
)
from gelforge.mismatch.summary.findings import limits_of, readings_table, taken_over, verdict_of
from gelforge.mismatch.summary.sections import after_of, correction_table, flow_section, flow_table
from gelforge.progress import stage
from gelforge.recording.imaging.images import reference_path
from gelforge.recording.readings import Recording

UNMOVED = ("force sensor", "analyst")  # families of effects that do not move the gel
NUMBER = r"\d+(?:\.\d+)?"
SOLUTIONS = "solves"  # folder of what is solved on the way, in the verdict's own


def patch_of(
    study: Study,
    effects: Mapping[str, Effect],
    terms: Sequence[Term] = (),
    module: Module | None = None,
    map_: pd.DataFrame | None = None,
) -> dict[str, Any]:
    """Return the keys that differ with effects at their values.

    What the finite elements know becomes keys of mechanics (and `plan.symmetry: none` instead of `d4`, where mirror images
    no longer hold); what belongs to force sensor, clock or single indentations goes to mismatch.known, which the judge
    adds to the base. The map of a module goes to mechanics where a study can have it, and nowhere else.
    """
    with_effects, known = study, []
    for part, theta in terms:
        effect = effects[part.name]
        if effect.to_study is not None:
            with_effects = effect.to_study(with_effects, part.hyperparameters, tuple(theta))
        else:
            values = {p.name: float(a) for p, a in zip(effect.parameters, np.asarray(theta))}
            known.append(
                {"effect": part.name, "parameters": values, "hyperparameters": dict(part.hyperparameters)}
            )
    if module is not None and module.to_study is not None and map_ is not None:
        with_effects = module.to_study(with_effects, map_["mean"].to_numpy())
    changes = differences(study.model_dump(mode="json"), with_effects.model_dump(mode="json"))
    if known:
        changes.setdefault("mismatch", {})["known"] = [
            *study.model_dump(mode="json")["mismatch"]["known"],
            *known,
        ]
    return changes


def differences(before: Mapping, after: Mapping) -> dict[str, Any]:
    """Return the keys of nested mappings whose values differ, with the values after.

    Parameters
    ----------
    before, after : mapping
        Keys of `before` alone are passed over.

    Returns
    -------
    dict
        Nested as they are.
    """
    changed = {}
    for key, value in after.items():
        old = before.get(key)
        if value == old:
            continue
        if isinstance(value, dict) and isinstance(old, dict):
            changed[key] = differences(old, value)
        else:
            changed[key] = value
    return changed


def judge_folder(
    study: Study,
    recording: Path,
    out: Path,
    laws: Sequence[Path] = (),
    kept: Path | None = None,
    workers: int = 1,
) -> Verdict:
    """Judge the sessions in a folder against a study, write the stage's files and return the verdict.

    Parameters
    ----------
    study : Study
        The nominal model.
    recording : Path
        A session's folder, or one of sessions.
    out : Path
        Receives the files.
    laws : sequence of Path
        Files of fitted materials in place of the study's own.
    kept : Path, optional
        Folder of what is solved on the way; SOLUTIONS in `out` if not given.
    workers : int
        Processes.

    Returns
    -------
    Verdict
        As in verdict.json.

    Raises
    ------
    ConfigError
        For a folder without sessions, and for sessions of another sensor.
    RecordingError
        For a recording that cannot be read.
    SolverFailed
        Where the base cannot be solved.
    """
    of_study = (
        recording.resolve() == study.data_folder.resolve()
    )  # of its own data a study chooses the sessions
    folders = session_folders(recording, study.sessions if of_study else ())
    check_matches(folders, study)  # first: what belongs to another sensor need not be read
    recordings = read_all(folders, study.sensor)
    solver = solver_of(study, out, list(laws), kept, workers, recordings)
    return judge_recording(solver, recordings, out, f"{recording.name} against study {study.study}")


def solver_of(
    study: Study,
    out: Path,
    laws: list[Path],
    kept: Path | None,
    workers: int,
    recorded: Sequence[Path | Recording],
) -> Solver:
    """Return the finite elements of a study; where every session calls the constants exact, its laws are certain.

    Parameters
    ----------
    study, out, laws, kept, workers
        As of `judge_folder`.
    recorded : sequence of Path or Recording
        Sessions that are judged.

    Returns
    -------
    Solver
        Reads solved sites and derivatives of the study's results where there are any.

    Raises
    ------
    ConfigError
        For no workers, and for sessions that differ in force.turns_with.
    """
    if workers < 1:
        raise ConfigError(f"--workers {workers}: 1 or more are needed")
    by_material, uncertain = laws_and_doubts(material_laws_of(study, laws))
    sessions = [_session(one) for one in recorded]
    if sessions and all(session.base_parameters == "exact" for session in sessions):
        uncertain = {}
    study = study.model_copy(update={"variants": {}})  # an effect need not go together with them
    cells = study.results_folder / "cells"
    zeroed = {session.depth_zero.by for session in sessions}
    turning = {session.force.turns_with for session in sessions} or {"sensor"}
    if len(turning) > 1:
        raise ConfigError("sessions differ in force.turns_with (sensor, stage): judge them one by one")
    stored = study.results_folder / "sensitivities"
    return Solver(
        study,
        by_material,
        uncertain,
        kept or out / SOLUTIONS,
        cells if cells.is_dir() else None,
        workers,
        zeroed.pop() if len(zeroed) == 1 else "press",
        stored if stored.is_dir() else None,
        turning.pop(),
    )


def judge_recording(solver: Solver, sessions: Sequence[Path | Recording], out: Path, title: str) -> Verdict:
    """Judge sessions against the solver's study, write the stage's files into a folder and return the verdict.

    Raises RecordingError for a recording that cannot be read, SolverFailed where the base cannot be solved.
    """
    study = solver.study
    stage("readings")
    recordings = read_all(sessions, study.sensor)
    observations, synthetic = observations_of(recordings, study)
    forces, base = problem_of(solver, observations)
    problem, joint, judgement = judged_with_images(solver, base, forces, recordings)
    after = after_of(joint, judgement)
    verdict = verdict_of(
        problem,
        judgement,
        title,
        synthetic,
        study.sensor,
        provenance_of([one.folder for one in recordings], study, solver),
        flow=flow_section(joint, judgement, after),
    )
    stage("experiments that would distinguish effects")
    verdict = with_experiments(verdict, forces, base.context)
    verdict = verdict.model_copy(update={"detection_limits": limits_of(forces)})
    stage("tables")
    (out / PATCH).unlink(missing_ok=True)
    if taken_over(judgement):
        write_patch(out, study, problem, judgement)
    return write_results(out, verdict, problem, judgement, flow_table(joint, after))


def judged_with_images(
    solver: Solver, base: Base, forces: Problem, recordings: Sequence[Recording]
) -> tuple[Problem, Problem, Judgement]:
    """Return the problem that was judged, the one with images (itself where there are none), and the judgement."""
    settings, seed = solver.study.mismatch, solver.study.seed

    def with_images(problem: Problem) -> Problem:
        stage("images, and the motion of the gel at their indentations")
        return with_flow(solver, base, problem, recordings)

    if settings.images == "fitted":
        joint = with_images(forces)
    else:
        judgement = judge(forces, settings, seed)
        if settings.images == "predicted":
            return forces, with_images(forces), judgement
        left = told_apart_by_images(judgement) if settings.images == "auto" else set()
        joint = with_images(of_effects(forces, left)) if left else forces
        if joint.flow is None:
            told = replace(forces, observations=joint.observations)
            return told, told, judgement
    return joint, joint, judge(joint, settings, seed)


def told_apart_by_images(judgement: Judgement) -> set[str]:
    """Return the effects among which forces leave a choice that images can make: some move the gel otherwise than others.

    The force sensor's errors move nothing, and the stiffness of all layers as good as nothing: forces scale with it.
    """
    if judgement.answer is None:
        return set()
    left: set[str] = set()
    for group in judgement.answer.groups:
        moving = [
            name for name in group.names if CATALOGUE[name].family not in UNMOVED and name != "body_stiffness"
        ]
        if len(group.names) > 1 and moving:
            left |= {*group.names}
    return left and left | {part.name for part in judgement.answer.fit.parts}


def of_effects(problem: Problem, names: Collection[str]) -> Problem:
    """Return the problem with some effects alone."""
    return replace(
        problem,
        candidates=[one for one in problem.candidates if one.name in names],
        effects={name: effect for name, effect in problem.effects.items() if name in names},
    )


def write_patch(out: Path, study: Study, problem: Problem, judgement: Judgement) -> None:
    """Write config.patch.yaml: the fitted effects, and the map of a cause with a free form where a study can have it."""
    model = judgement.model
    terms = () if model is not None and not model.with_effects else judgement.answered.fit.terms
    cause = (model.module, model.map()) if model is not None and model.sure else ()
    if changes := patch_of(study, problem.effects, terms, *cause):
        out.mkdir(parents=True, exist_ok=True)
        write_yaml(out / PATCH, changes)


def write_results(
    out: Path, verdict: Verdict, problem: Problem, judgement: Judgement, flow: pd.DataFrame | None = None
) -> Verdict:
    """Write the tables, then verdict.json with their SHA-256, and return that verdict; flow: the rows of flow.csv."""
    tables = {
        READINGS: readings_table(problem, judgement),
        BODY_MAP: body_map(problem.in_newtons),
        CORRECTION: correction_table(problem, judgement.model),
        MODULE: None if judgement.model is None else judgement.model.map(),
        FLOW: flow,
        LIMITS: limits_table(verdict.detection_limits),
    }
    verdict = verdict.model_copy(update={"tables": write_tables(out, tables)})
    write_verdict(out, verdict)
    return verdict


def _session(recorded: Path | Recording) -> Session:
    return recorded.session if isinstance(recorded, Recording) else load_session(recorded / "session.yaml")


def provenance_of(folders: Sequence[Path], study: Study, solver: Solver) -> Provenance:
    """Return what the verdict rests on.

    Parameters
    ----------
    folders : sequence of Path
        Of the sessions.
    study : Study
        The nominal model.
    solver : Solver
        Its laws.

    Returns
    -------
    Provenance
        Checksums, seed, draws and versions.
    """
    return Provenance(
        sessions={folder.name: _files_sha256(folder, study.mismatch.images) for folder in folders},
        base=f"study {study.study}",
        base_sha256=digest(
            [study.model_dump(mode="json"), {name: law.description() for name, law in solver.laws.items()}]
        ),
        seed=study.seed,
        draws=study.mismatch.draws,
        versions=versions(),
    )


def _files_sha256(folder: Path, images: str) -> str:
    """Return the digest of a session's readings, description, samples of force, and images where they count."""
    files = [folder / name for name in ("indentations.csv", "ft.csv", "session.yaml")]
    files += [] if images == "left_out" else [reference_path(folder), *sorted((folder / "images").glob("*"))]
    return digest({path.name: file_sha256(path) for path in files if path.is_file()})


def check_matches(folders: Sequence[Path], study: Study) -> None:
    """Refuse a recording that plainly belongs to another sensor or indenter than the study's.

    Parameters
    ----------
    folders : sequence of Path
        Of the sessions.
    study : Study
        Its indenter.

    Raises
    ------
    ConfigError
        Names the session, what it states and what the study describes.
    """
    for folder in folders:
        session = load_session(folder / "session.yaml")
        stated, simulated = session.indenter.strip(), study.indenter.words
        if stated and stated != simulated:
            numbers = _lengths(stated), _lengths(simulated)
            if numbers[0] and numbers[1] and not numbers[0] & numbers[1]:
                raise ConfigError(
                    f"{folder / 'session.yaml'}: pressed with {stated!r}, but the study describes {simulated!r}; give the"
                    " study of this recording, or correct `indenter`"
                )


def _lengths(text: str) -> set[float]:
    """Return the numbers [mm] of an indenter's description, diameters as radii; what is not said to be either, as both."""
    across = r"(?:diameter|dia\b\.?|\u00d8|\u2300|\bd\s*=)"
    halved = re.compile(
        rf"{across}\D{{0,5}}({NUMBER})|({NUMBER})\s*(?:mm)?\W*(?:in |of )?{across}", re.IGNORECASE
    )
    radii = {float(a or b) / 2 for a, b in halved.findall(text)}
    others = {float(found) for found in re.findall(NUMBER, halved.sub("", text))}
    if not radii and not re.search(r"radius|\br\s*=", text, re.IGNORECASE):
        radii = {number / 2 for number in others}
    return radii | others
