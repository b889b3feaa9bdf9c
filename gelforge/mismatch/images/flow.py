"""The images' channel: regions' flow as further readings of the problem, next to the forces.

An indentation with images adds one row per region of the image, with the flow's u and v in the places of Fx and Fy [px].
Residual, covariance, changes by effects and what is held out then hold both channels, and the judge works as on forces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gelforge.config import Study
from gelforge.mismatch.effects import CATALOGUE, with_dependencies
from gelforge.mismatch.evidence.problem import ForcesWith, Problem
from gelforge.mismatch.evidence.screen import Candidate, Term
from gelforge.mismatch.fem.solutions import Solver, SolverFailed
from gelforge.mismatch.fem.solver import Base
from gelforge.mismatch.images.flow_covariance import Rows, flow_covariance
from gelforge.mismatch.images.flow_images import (
    REGIONS,
    CameraView,
    FlowObservation,
    away_from_indenter,
    likely_particles,
    seen_flows,
    shows_gel,
)
from gelforge.mismatch.images.flow_model import FlowModel, FlowUnknown, flow_model
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.readings.observations import Observations
from gelforge.recording.readings import Recording
from gelforge.virtual_lab.particles import VirtualLabError

# Of the study's sizes, the mesh on which changes of the flow are solved: on one twice as coarse, as forces have it, they are
# 14 % off and call for effects that are not there; on this one 5 % (benchmarks/flow_changes.py).
COARSER = 1.25
PRESS_FIELDS = ("press_depth_mm", "session_depth_mm", "came_along")  # of observations: an indentation's own


@dataclass(frozen=True, eq=False)
class FlowChannel:
    """What the joint problem was made of."""

    forces: Problem  # the readings of force alone
    model: FlowModel
    base: np.ndarray  # (F, m, 2) [px]

    @property
    def entries(self) -> int:
        """Return the number of entries of force, which come first."""
        return len(self.forces.labels)


def with_flow(solver: Solver, base: Base, problem: Problem, sessions: Sequence[Path | Recording]) -> Problem:
    """Return the problem with the flow of its sessions' images; as it is, and reported, where they cannot be used."""
    study = solver.study
    finer = study.mismatch.model_copy(update={"coarser": min(COARSER, study.mismatch.coarser)})
    solver = replace(solver, study=study.model_copy(update={"mismatch": finer}))
    seen = seen_flows(sessions, problem.observations, study.sensor)
    if reason := _unfit(study, seen):
        return _without(problem, reason)
    seen = [replace(press, eye=_as_known(study, press.eye)) for press in seen]
    particles = likely_particles(study.sensor, study.seed)
    effects = {name: e for name, e in CATALOGUE.items() if e.to_camera is not None and e.applies(study)}
    effects = {name: e for name, e in effects.items() if name not in study.mismatch.leave_out}
    asked = {effect.name: effect for effect in with_dependencies(problem.effects.values())}
    try:
        model = flow_model(solver, base, seen, asked, particles)
    except SolverFailed as failure:
        return _without(problem, str(failure))
    return _joined(problem, model, dict(problem.effects) | effects)


def _unfit(study: Study, seen: Sequence[FlowObservation]) -> str:
    """Return why images cannot be used, in words; none where they can."""
    if not seen:
        return "no session has a camera and images in its dwell rows"
    if study.sensor.shape.kind != "block" or study.mechanics.mesh.elements == "tetrahedra":
        return "the motion of particles is known on hexahedra, in a block, only"
    if not any(layer.particle_volume_fraction > 0 for layer in study.sensor.layers):
        return "no layer of the study carries particles (particle_volume_fraction)"
    if any("misregistration" in CATALOGUE[known.effect].depends_on for known in study.mismatch.known):
        return "indentations that are known to land off their positions (mismatch.known) are not followed in images"
    if any(not np.isfinite(press.noise).all() for press in seen):
        return "one image per indentation and none at zero force: their noise is not known"
    return ""


def _as_known(study: Study, eye: CameraView) -> CameraView:
    """Return an eye with the effects of the camera that the study takes as known."""
    camera = eye.camera
    for known in study.mismatch.known:
        effect = CATALOGUE[known.effect]
        if effect.to_camera is not None:
            theta = [known.parameters.get(p.name, 0.0) for p in effect.parameters]
            camera = effect.to_camera(study, camera, theta)
    return replace(eye, camera=camera)


def _without(problem: Problem, reason: str) -> Problem:
    return replace(problem, observations=problem.observations.saying(f"images were not used: {reason}"))


def _joined(problem: Problem, model: FlowModel, effects: Mapping[str, Effect]) -> Problem:
    base, shown = model.drawn.mean(axis=1), np.stack([shows_gel(eye, model.particles) for eye in model.eyes])
    observations = _observations(problem.observations, model.seen, shown)
    labels = observations.labels()
    rows = Rows(observations, len(problem.labels), shown)
    failed = dict(problem.failed)
    candidates = _candidates(problem, model, effects, rows, failed)
    channel = FlowChannel(problem, model, base)
    joint = np.concatenate([problem.base, rows.as_readings(base)])
    known = {c.name for c in candidates}
    return replace(
        problem,
        observations=observations,
        base=joint,
        covariance=flow_covariance(problem, model, rows, labels),
        candidates=candidates,
        effects={name: e for name, e in effects.items() if name in known or name in problem.effects},
        forces_with=_forces_with(channel, rows, effects),
        read_with=None,
        failed=failed,
        flow=channel,
    )


def _observations(forces: Observations, seen: Sequence[FlowObservation], shown: np.ndarray) -> Observations:
    """Return the observations with one row per indentation and region."""
    m = REGIONS**2
    table = (
        pd.DataFrame([press.row for press in seen]).loc[lambda t: t.index.repeat(m)].reset_index(drop=True)
    )
    away = np.concatenate([away_from_indenter(press) for press in seen])
    table = table.assign(channel="flow", region=np.tile(np.arange(m), len(seen)), errs_over=away / away.max())
    measured = np.stack([press.flow for press in seen])
    flow = np.where(shown[..., None], measured, np.nan).reshape(-1, 2)
    noise = np.concatenate([press.noise / np.sqrt(press.images) for press in seen])
    nothing, depth = np.full(len(table), np.nan), forces.table["depth_mm"]
    numbers = np.array([int(press.row.name) for press in seen]).repeat(m)
    of_force = forces.table.assign(channel="force", region=-1, errs_over=depth / depth.max())

    def joined(name: str, flow: np.ndarray) -> np.ndarray:
        return np.concatenate([getattr(forces, name), flow])

    more: dict[str, np.ndarray]
    more = {name: np.zeros((len(table), 3)) for name in ("zero_N", "rounding_N", "drift_N", "trend_N")}
    more |= {name: getattr(forces, name)[numbers] for name in PRESS_FIELDS}
    more |= {"force": np.column_stack([flow, nothing]), "noise_N": np.column_stack([noise, nothing])}
    more |= {"repeats": np.full(len(table), np.inf), "tails": np.ones(len(table))}
    arrays: dict[str, Any] = {name: joined(name, columns_of) for name, columns_of in more.items()}
    return replace(forces, table=pd.concat([of_force, table], ignore_index=True), **arrays)


def _candidates(
    problem: Problem,
    model: FlowModel,
    effects: Mapping[str, Effect],
    rows: Rows,
    failed: dict[str, str],
) -> list[Candidate]:
    """Return the candidates with what they change of the flow; one whose flow is not known is left out and reported."""
    candidates = []
    for candidate in problem.candidates:
        effect = effects[candidate.name]
        grid = [dict(hyperparameters) for hyperparameters in effect.grid(model.base.context)]
        try:
            change = model.columns(
                effect, candidate.hyperparameters, grid.index(dict(candidate.hyperparameters))
            )
        except FlowUnknown as missing:
            failed.setdefault(str(missing), "its flow in the images could not be computed")
            continue
        candidates.append(replace(candidate, columns=np.concatenate([candidate.columns, rows.flat(change)])))
    for name, effect in effects.items():
        if effect.to_camera is None:
            continue
        try:
            change = rows.flat(model.columns(effect, {}, 0))
        except ValueError as impossible:  # this camera cannot have it
            failed[name] = str(impossible)
            continue
        if np.any(change):
            columns = np.concatenate([np.zeros((rows.entries, change.shape[1])), change])
            candidates.append(Candidate(name, {}, columns, effect.prior_sd, effect.signs, effect.binary))
    return candidates


def _forces_with(channel: FlowChannel, rows: Rows, effects: Mapping[str, Effect]) -> ForcesWith:
    """Return forces and flow with effects: the camera's exactly, the finite elements' at their values.

    What moves single indentations, remembers, changes the mesh or is seen during unloading stays at first order in the flow,
    and so does what is solved on elements that are no boxes, in which no particle can be found.
    """
    forces, model = channel.forces, channel.model

    def change_of(terms: Sequence[Term]) -> np.ndarray:
        """Return the change of the flow (F, m, 2) [px]."""
        studied, cameras, linear = [], [], []
        for part, a in terms:
            effect = effects[part.name]
            if not np.any(a):
                continue
            if effect.to_camera is not None:
                cameras.append((effect, a))
            elif effect.to_study is None or effect.history or effect.mesh_changes or effect.by_formula:
                linear.append((part, a))
            else:
                studied.append((part, a))
        more: Sequence[np.ndarray | float] = [0.0] * len(model.seen)
        if studied:
            try:
                more = model.solved([(effects[part.name], part.hyperparameters, a) for part, a in studied])
            except VirtualLabError:
                linear += studied
        change = np.zeros(channel.base.shape)
        for part, a in linear:
            change[rows.shown] += (part.columns[rows.entries :] @ a).reshape(-1, 2)
        if cameras or any(np.any(du) for du in more):
            change += model.change(more, model.seen_by(cameras))
        return change

    def forces_with(terms: Sequence[Term], readings: np.ndarray) -> np.ndarray:
        R = len(forces.base)
        moving = [term for term in terms if effects[term[0].name].to_camera is None]
        force = forces.forces_with(moving, readings[:R])
        flow = np.full((len(readings) - R, 3), np.nan)
        if readings[R:].any():
            flow = rows.as_readings(channel.base + change_of(terms))
        return np.where(readings[:, None], np.concatenate([force, flow]), np.nan)

    return forces_with
