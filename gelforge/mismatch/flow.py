"""The images' channel: regions' flow as further readings of the problem, beside the forces.

A press with images adds one row per region of the image, with the flow's u and v in the places of Fx and Fy [px]. Residual,
covariance, changes by effects and what is set aside then hold both channels, and the judge works as on forces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import Study
from gelforge.indentation.error_bars import PART_TOTALS
from gelforge.mismatch import verdict as form
from gelforge.mismatch.covariance import Covariance, Draws, estimated_noise
from gelforge.mismatch.effect import Effect
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.flow_images import (
    DRAWINGS,
    REGIONS,
    Eye,
    Seen,
    likely_particles,
    seen_flows,
    shows_gel,
)
from gelforge.mismatch.flow_model import (
    CHANGES,
    OTHER_BLUR_PX,
    OTHER_DIAMETER,
    FlowModel,
    FlowUnknown,
    flow_model,
)  # fmt: skip
from gelforge.mismatch.holdout import Blocks
from gelforge.mismatch.judge import Judgement
from gelforge.mismatch.observations import Observations
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.scan import global_test
from gelforge.mismatch.screen import Candidate
from gelforge.mismatch.solutions import Solver
from gelforge.mismatch.solver import Base

# The real particles are one placement, the prediction a mean over some: their difference stays from press to press of a
# site but for what lies elsewhere in the moved image. Measured between two depths (benchmarks/flow_channel.py).
SHARED = 0.8  # of its variance
# Of the flow of a region: what drawing leaves out of a real image (glare, particles that are no balls, distortion).
DRAWN_SHARE = 0.01
LEAST_PX = 0.005  # an 8-bit image holds no smaller mean motion


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


def with_flow(solver: Solver, base: Base, problem: Problem, folders: Sequence[Path]) -> Problem:
    """Return the problem with the flow of its sessions' images; as it is where they have none.

    Raises SolverFailed where the gel's motion cannot be solved.
    """
    study = solver.study
    seen = seen_flows(folders, problem.observations, study.sensor)
    if not seen:
        return problem
    reason = _unfit(study, seen)
    if reason:
        return _told(problem, f"images were not used: {reason}")
    seen = [replace(press, eye=_as_known(study, press.eye)) for press in seen]
    particles = likely_particles(study.sensor, study.seed)
    effects = {name: e for name, e in CATALOGUE.items() if e.to_camera is not None and e.applies(study)}
    effects = {name: e for name, e in effects.items() if name not in study.mismatch.leave_out}
    model = flow_model(solver, base, seen, problem.effects, particles)
    return _joined(problem, model, dict(problem.effects) | effects)


def _unfit(study: Study, seen: Sequence[Seen]) -> str:
    if study.sensor.shape.kind != "block" or study.mechanics.mesh.elements == "tetrahedra":
        return "the motion of particles is known on hexahedra, in a block, only"
    if not any(layer.particle_volume_fraction > 0 for layer in study.sensor.layers):
        return "no layer of the study carries particles (particle_volume_fraction)"
    if any(not np.isfinite(press.noise).all() for press in seen):
        return "one image per press and none at zero force: their noise is not known"
    return ""


def _as_known(study: Study, eye: Eye) -> Eye:
    """Return an eye with the effects of the camera that the study takes as known."""
    camera = eye.camera
    for known in study.mismatch.known:
        effect = CATALOGUE[known.effect]
        if effect.to_camera is not None:
            amounts = [known.amounts.get(p.name, 0.0) for p in effect.parameters]
            camera = effect.to_camera(study, camera, amounts)
    return replace(eye, camera=camera)


def _told(problem: Problem, sentence: str) -> Problem:
    observations = problem.observations
    return replace(
        problem, observations=replace(observations, cannot_know=(*observations.cannot_know, sentence))
    )


def _joined(problem: Problem, model: FlowModel, effects: Mapping[str, Effect]) -> Problem:
    drawn = model.base_flows()  # (F, K, m, 2)
    few = drawn[:, :CHANGES].mean(axis=1)  # in the placements in which changes are drawn
    base, shown = drawn.mean(axis=1), np.stack([shows_gel(p.eye, model.particles) for p in model.seen])
    observations = _observations(problem.observations, model.seen, shown)
    labels = observations.labels()
    rows = Rows(observations, len(problem.labels), shown)
    failed = dict(problem.failed)
    candidates = _candidates(problem, model, effects, rows, few, failed)
    channel = FlowChannel(problem, model, base)
    joint = np.concatenate([problem.base, rows.as_readings(base)])
    known = {c.name for c in candidates}
    return replace(
        problem,
        observations=observations,
        base=joint,
        covariance=_covariance(problem, model, drawn, few, rows, labels),
        candidates=candidates,
        effects={
            name: effect for name, effect in effects.items() if name in known or name in problem.effects
        },
        forces_with=_Both(channel, rows, few, {}, effects),
        failed=failed,
        flow=channel,
    )


@dataclass(frozen=True, eq=False)
class Rows:
    """Where the flow stands among the readings and the entries."""

    observations: Observations
    entries: int  # of force
    shown: np.ndarray  # (F, m) bool

    def flat(self, flow: np.ndarray) -> np.ndarray:
        """Return the entries of a quantity (F, m, 2, ...): regions that show the gel, u and v in turn."""
        return flow[self.shown].reshape(-1, *flow.shape[3:])

    def as_readings(self, flow: np.ndarray) -> np.ndarray:
        """Return the rows (F m, 3) of a flow (F, m, 2), nothing in the place of Fz."""
        rows = np.where(self.shown[..., None], flow, np.nan).reshape(-1, 2)
        return np.column_stack([rows, np.full(len(rows), np.nan)])


def _observations(forces: Observations, seen: Sequence[Seen], shown: np.ndarray) -> Observations:
    """Return the observations with one row per press and region."""
    m = REGIONS**2
    table = (
        pd.DataFrame([press.row for press in seen]).loc[lambda t: t.index.repeat(m)].reset_index(drop=True)
    )
    table = table.assign(channel="flow", region=np.tile(np.arange(m), len(seen)))
    measured = np.stack([press.flow for press in seen])
    flow = np.where(shown[..., None], measured, np.nan).reshape(-1, 2)
    noise = np.concatenate([press.noise / np.sqrt(press.images) for press in seen])
    nothing = np.full(len(table), np.nan)
    numbers = np.array([int(press.row.name) for press in seen]).repeat(m)
    return replace(
        forces,
        table=pd.concat([forces.table.assign(channel="force", region=-1), table], ignore_index=True),
        force=np.concatenate([forces.force, np.column_stack([flow, nothing])]),
        noise_N=np.concatenate([forces.noise_N, np.column_stack([noise, nothing])]),
        zero_N=np.concatenate([forces.zero_N, np.zeros((len(table), 3))]),
        touchdown_mm=np.concatenate([forces.touchdown_mm, forces.touchdown_mm[numbers]]),
        zero_by=np.concatenate([forces.zero_by, np.asarray(forces.zero_by)[numbers]]),
        rounding_N=np.concatenate([forces.rounding_N, np.zeros((len(table), 3))]),
        repeats=np.concatenate([forces.repeats, np.full(len(table), np.inf)]),
        tails=np.concatenate([forces.tails, np.ones(len(table))]),
    )


def _candidates(
    problem: Problem,
    model: FlowModel,
    effects: Mapping[str, Effect],
    rows: Rows,
    few: np.ndarray,
    failed: dict[str, str],
) -> list[Candidate]:
    """Return the candidates with what they change of the flow; one whose flow is not known is left out and told."""
    found = []
    for candidate in problem.candidates:
        effect = effects[candidate.name]
        shapes = [dict(shape) for shape in effect.shapes(model.base.context)]
        try:
            change = model.columns(effect, candidate.shape, shapes.index(dict(candidate.shape)), few)
        except FlowUnknown as missing:
            failed.setdefault(str(missing), "its flow in the images could not be computed")
            continue
        found.append(replace(candidate, columns=np.concatenate([candidate.columns, rows.flat(change)])))
    for name, effect in effects.items():
        if effect.to_camera is None:
            continue
        try:
            change = rows.flat(model.columns(effect, {}, 0, few))
        except ValueError as impossible:  # this camera cannot have it
            failed[name] = str(impossible)
            continue
        if np.any(change):
            columns = np.concatenate([np.zeros((rows.entries, change.shape[1])), change])
            signs = np.array([p.sign for p in effect.parameters])
            found.append(Candidate(name, {}, columns, effect.widths, signs, effect.switch))
    return found


def _covariance(
    problem: Problem,
    model: FlowModel,
    drawn: np.ndarray,
    few: np.ndarray,
    rows: Rows,
    labels: pd.DataFrame,
) -> Covariance:
    """Return the covariance of both channels.

    Of the flow: independent its images' noise and what drawing leaves out; per site, region and direction the reference
    frame's noise and where the particles are (their scatter over placements); shared by all the touchdown of a press with
    images, in force and flow alike, the laws' directions, the discretisation, and two other looks of the particles.
    """
    forces = problem.covariance
    *depth, press, alike, common = forces.levels
    n, seen = rows.entries, model.seen
    noise = np.stack([p.noise for p in seen])
    images = np.array([p.images for p in seen])[:, None, None]
    base = drawn.mean(axis=1)
    scatter = _smoothed(drawn.var(axis=1, ddof=1)) * (1 + 1 / DRAWINGS)
    variance = (
        noise**2 / images
        + (1 - SHARED) * scatter
        + (DRAWN_SHARE * _smoothed(base**2) ** 0.5) ** 2
        + LEAST_PX**2
    )
    own = labels.iloc[n:]
    region = pd.factorize(
        own["site"].astype(str) + "/" + own["region"].astype(str) + "/" + own["axis"].astype(str)
    )[0]
    placed = np.column_stack(
        [
            rows.flat(np.sqrt(SHARED * scatter)),
            rows.flat(noise),
            *np.zeros((press.directions.shape[1] - 2, len(own))),
        ]
    )
    by_press, shared_force, shared_flow = _touchdown(problem, model, few, rows)
    laws = np.zeros((len(own), common.directions.shape[1]))
    for k, key in enumerate(sorted_laws(model)):
        laws[:, k] = rows.flat(model.change_along(key, 1.0, few))
    laws += shared_flow["session"]
    flow_alone = np.column_stack([rows.flat(change) for change in _doubts(model, few)])
    q = flow_alone.shape[1]
    return Covariance(
        np.concatenate([forces.variance, rows.flat(variance)]),
        (
            *(_of_forces(level, np.arange(len(own))) for level in depth),
            Draws(
                np.concatenate([press.group, press.group.max() + 1 + region]), np.vstack([by_press, placed])
            ),
            _of_forces(alike, pd.factorize(own["site"])[0]),
            Draws(
                np.zeros(len(labels), dtype=int),
                np.block(
                    [
                        [common.directions, shared_force, np.zeros((n, q))],
                        [laws, shared_flow["press"], flow_alone],
                    ]
                ),
            ),
        ),
        estimated_noise(rows.observations),
    )


def _of_forces(level: Draws, own: np.ndarray) -> Draws:
    """Return draws of the forces that the flow has no part in; own (f,) int: groups of its entries."""
    nothing = np.zeros((len(own), level.directions.shape[1]))
    return Draws(
        np.concatenate([level.group, level.group.max() + 1 + own]), np.vstack([level.directions, nothing])
    )


def sorted_laws(model: FlowModel) -> list[str]:
    """Return the laws' directions in the order of Base.law."""
    keys = [key for key in next(iter(model.coarse.values())).along if key.startswith("law ")]
    return sorted(keys, key=lambda key: (key.rsplit(" ", 1)[0], int(key.rsplit(" ", 1)[1])))


def _smoothed(square: np.ndarray) -> np.ndarray:
    """Return a square (F, m, 2) averaged over the 3 x 3 regions around each and both directions."""
    F = len(square)
    grid = square.mean(axis=-1).reshape(F, REGIONS, REGIONS)
    wide = np.pad(grid, ((0, 0), (1, 1), (1, 1)), mode="edge")
    near = sum(wide[:, i : i + REGIONS, j : j + REGIONS] for i in range(3) for j in range(3)) / 9
    return np.repeat(near.reshape(F, -1, 1), 2, axis=-1)


def _touchdown(problem: Problem, model: FlowModel, few: np.ndarray, rows: Rows):
    """Return the forces' directions per press without the touchdown of presses with images, and these as shared columns."""
    *_, press, alike, common = problem.covariance.levels
    labels, slope = problem.labels, model.slope(few)
    by_press = press.directions.copy()
    force, flow = [], []
    session = np.zeros((rows.shown.sum() * 2, common.directions.shape[1]))
    last = model.base.law.shape[-1] + alike.directions.shape[1]  # columns of laws and floor come first
    for k, seen in enumerate(model.seen):
        own = (labels["press"] == seen.row["press"]).to_numpy()
        sd = problem.observations.touchdown_mm[int(seen.row.name)]
        alone = np.zeros_like(slope)
        alone[k] = sd * slope[k]
        if np.asarray(problem.observations.zero_by)[int(seen.row.name)] == "session":
            column = last + int(np.argmax(np.abs(common.directions[own][:, last:]).sum(axis=0)))
            session[:, column] += rows.flat(alone)
            continue
        column = np.where(own, by_press[:, -1], 0.0)
        by_press[own, -1] = 0.0
        force.append(column)
        flow.append(rows.flat(alone))
    n, f = rows.entries, len(session)
    return (
        by_press,
        np.column_stack(force) if force else np.zeros((n, 0)),
        {"session": session, "press": np.column_stack(flow) if flow else np.zeros((f, 0))},
    )


def _doubts(model: FlowModel, few: np.ndarray) -> list[np.ndarray]:
    """Return changes of the flow (F, m, 2) by one standard deviation of what is not known: mesh, blur, diameter."""
    more = []
    for press in model.seen:
        site, d = int(press.row["site"]), model.depth(press)
        coarse = model.weights[site] @ model.coarse[site].base[d].astype(float)
        more.append(coarse - model.moved(press, model.few))
    blurred = [
        replace(
            p.eye,
            imaging=p.eye.imaging.model_copy(update={"blur_px": p.eye.imaging.blur_px + OTHER_BLUR_PX}),
        )
        for p in model.seen
    ]
    other = replace(model.few, diameter_mm=model.few.diameter_mm * OTHER_DIAMETER)
    larger = replace(model, few=other, scenes={}, changes={})
    return [
        PART_TOTALS * (model.flows_with(more) - few),
        model.flows_with([None] * len(model.seen), blurred) - few,
        larger.flows_with([None] * len(model.seen)) - few,
    ]


@dataclass(frozen=True, eq=False)
class _Both:
    """Forces and flow with effects (Problem.forces_with): the camera's exactly, the finite elements' at their amounts."""

    channel: FlowChannel
    rows: Rows
    few: np.ndarray
    known: dict
    effects: Mapping[str, Effect]

    def __call__(
        self, parts: Sequence[Candidate], amounts: Sequence[np.ndarray], readings: np.ndarray
    ) -> np.ndarray:
        forces, R = self.channel.forces, len(self.channel.forces.base)
        of_force = [(p, a) for p, a in zip(parts, amounts) if self.effects[p.name].to_camera is None]
        found = np.full((len(readings), 3), np.nan)
        found[:R] = forces.forces_with([p for p, _ in of_force], [a for _, a in of_force], readings[:R])
        if readings[R:].any():
            found[R:] = self.rows.as_readings(self.channel.base + self._change(parts, amounts))
            found[R:][~readings[R:]] = np.nan
        return found

    def _change(self, parts: Sequence[Candidate], amounts: Sequence[np.ndarray]) -> np.ndarray:
        """Return the change of the flow (F, m, 2) [px]."""
        key = tuple((p.name, str(dict(p.shape)), tuple(np.round(a, 12))) for p, a in zip(parts, amounts))
        if key not in self.known:
            self.known[key] = self._drawn(parts, amounts)
        return self.known[key]

    def _drawn(self, parts: Sequence[Candidate], amounts: Sequence[np.ndarray]) -> np.ndarray:
        model = self.channel.model
        studied, cameras, linear = [], [], np.zeros(self.few.shape)
        for part, a in zip(parts, amounts):
            effect = self.effects[part.name]
            if not np.any(a):
                continue
            if effect.to_camera is not None:
                cameras.append((effect, a))
            elif effect.to_study is None or effect.history or effect.mesh_changes or effect.unloading:
                linear[self.rows.shown] += (part.columns[self.rows.entries :] @ a).reshape(-1, 2)
            else:
                studied.append((effect, part.shape, a))
        if not studied and not cameras:
            return linear
        more = model.solved(studied) if studied else [None] * len(model.seen)
        eyes = [model.seen_by(press, cameras) for press in model.seen]
        return linear + model.flows_with(more, eyes) - self.few


def force_part(problem: Problem, judgement: Judgement) -> tuple[Problem, Judgement]:
    """Return problem and judgement of the readings of force alone, for tables in newtons; as they are without images."""
    if problem.flow is None:
        return problem, judgement
    n, R = problem.flow.entries, len(problem.flow.forces.base)

    def cut(blocks: Blocks) -> Blocks:
        return Blocks(blocks.train[:n], {name: mask[:n] for name, mask in blocks.held.items()})

    answer = judgement.answer
    if answer is not None:
        folds = {
            name: (cut(blocks), left[:n], gained, scores)
            for name, (blocks, left, gained, scores) in answer.folds.items()
        }
        answer = replace(answer, after=answer.after[:R], folds=folds)
    return problem.flow.forces, replace(judgement, blocks=cut(judgement.blocks), answer=answer)


def flow_section(joint: Problem, judgement: Judgement) -> form.Flow | None:
    """Return what verdict.json says of the images; judgement of the joint problem, or of the forces alone."""
    if joint.flow is None:
        return None
    fitted = len(judgement.blocks.train) == len(joint.labels)
    mask = np.arange(len(joint.labels)) >= joint.flow.entries
    before, after, answer = joint.residual[mask], None, judgement.answer
    if answer is not None:
        parts = [
            next(c for c in joint.candidates if c.name == p.name and dict(c.shape) == dict(p.shape))
            for p in answer.fit.parts
        ]
        with_it = joint.forces_with(parts, answer.fit.amounts, np.ones(len(joint.base), bool))
        after = joint.observations.flat(joint.observations.force - with_it)[mask]
    return form.Flow(
        used="fitted" if fitted else "predicted",
        p=global_test(before, joint.covariance.restricted(mask)).p,
        rmse_before_px=float(np.sqrt(np.mean(before**2))),
        rmse_after_px=None if after is None else float(np.sqrt(np.mean(after**2))),
    )
