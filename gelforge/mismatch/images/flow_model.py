"""The flow that the base predicts at the indentations with images, and how it follows every effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.sparse import csr_array

from gelforge.config import Camera
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.fem.asked import asked_of, observed_by
from gelforge.mismatch.fem.solutions import Solver, SolverFailed, way_down
from gelforge.mismatch.fem.solver import Base
from gelforge.mismatch.images.flow_fields import Moved, each_moved, each_moved_along, solved_with
from gelforge.mismatch.images.flow_images import (
    PRESET,
    CameraView,
    FlowObservation,
    Particles,
    Scene,
    even_points,
    flow_of_warp,
    mean_motion,
    mean_motion_slope,
    motion_field,
)
from gelforge.mismatch.model.effect import Effect, Shape
from gelforge.mismatch.model.places import FirstOrder
from gelforge.recording.imaging.flow import Flow
from gelforge.workers import each

LOOKS = 3  # placements in which another look of the particles is drawn: their scatter is a part of a part
STEP_MM = 0.05  # of depth, over which the flow's slope is taken
UNIT = 1e-3  # of a width: a step at which a first-order change of the force is a straight line
# What the recording does not state of its particles' look is off by as much: blur by half a pixel, diameter by a fifth.
OTHER_BLUR_PX, OTHER_DIAMETER = 0.5, 1.2


class FlowUnknown(ValueError):
    """The flow with an effect could not be computed."""


@dataclass(frozen=True, eq=False)
class FlowModel:
    """Displacements behind the flow of F indentations with images."""

    solver: Solver
    base: Base
    seen: Sequence[FlowObservation]
    particles: Particles
    planned: Mapping[int, PlannedCell]  # by site, the loading through its depths
    known: frozenset[str]  # derivatives that the study has
    asked: Mapping[int, frozenset[str]]  # by site, those of them that an indentation there can show
    moving: Sequence[
        Mapping[str, np.ndarray]
    ]  # (m, 2) [px per unit] mean motion along derivatives, by indentation
    even: np.ndarray  # (Q, 3) [mm], points that fill the layers with particles
    points: Mapping[int, np.ndarray]  # by site, base displacement (D, P, 3) of all particles
    evenly: Mapping[int, np.ndarray]  # by site, the same (D, Q, 3) of the even points
    coarsely: Mapping[int, np.ndarray]  # by site, the same on the coarser mesh

    def depth(self, press: FlowObservation) -> int:
        """Return the step of its site's loading at which an indentation was seen."""
        return _step(self.planned[int(press.row["site"])], press)

    @cached_property
    def drawn(self) -> np.ndarray:
        """Return flows (F, K, m, 2) [px] that the base could show: the real image's warp and the rest of each placement."""
        warps = []
        for press, field in zip(self.seen, self.fields):
            search = Flow(press.untouched, PRESET)
            warps.append(flow_of_warp(search, press.untouched, field, press.eye.imaging))
        return np.stack(warps)[:, None] + self.by_height([press.eye for press in self.seen], self.particles)

    @cached_property
    def fields(self) -> list[np.ndarray]:
        """Return the gel's mean motion in the base (H, W, 2) [px] near each pixel, at each indentation."""
        moved = [self.evenly[int(press.row["site"])][self.depth(press)] for press in self.seen]
        return [motion_field(press.eye, self.even, u) for press, u in zip(self.seen, moved)]

    def by_height(self, eyes: Sequence[CameraView], particles: Particles) -> np.ndarray:
        """Return by how much flows (F, K, m, 2) [px] are other than a warp's, as particles of other heights move otherwise.

        In the first placements, with other eyes or another diameter of the particles.
        """
        moved = [self.points[int(press.row["site"])][self.depth(press)] for press in self.seen]
        count, workers = len(particles.points), self.solver.workers
        seen_by: dict[str, list[int]] = {}
        for k, eye in enumerate(eyes):
            seen_by.setdefault(repr(eye), []).append(k)
        # One scene draws many indentations; they are shared out, so that all workers draw.
        parts = [part for rows in seen_by.values() for part in np.array_split(rows, workers) if len(part)]
        tasks = [
            (eyes[part[0]], particles, [(moved[k][:count], self.fields[k]) for k in part]) for part in parts
        ]
        flows = np.concatenate(each(_drawn_by, tasks, workers, "scenes drawn"))
        return flows[np.argsort(np.concatenate(parts))]

    @cached_property
    def mean(self) -> np.ndarray:
        """Return the mean motion (F, m, 2) [px] in the base."""
        nothing = [None] * len(self.seen)
        return self._means(nothing, [press.eye for press in self.seen])

    @cached_property
    def found(self) -> np.ndarray:
        """Return what part (F, 1, 1) of the mean motion the search finds at each indentation."""
        drawn = self.drawn.mean(axis=1)
        return np.sum(drawn * self.mean, axis=(1, 2), keepdims=True) / np.sum(
            self.mean**2, axis=(1, 2), keepdims=True
        )

    def other_heights(self, share: float) -> np.ndarray:
        """Return the change of the flow (F, m, 2) [px] if the highest particles count by a share more, the lowest less."""
        z = self.even[:, 2]
        seen = 1 + share * (2 * (z - z.min()) / np.ptp(z) - 1)
        moved = [self.evenly[int(press.row["site"])][self.depth(press)] for press in self.seen]
        means = [mean_motion(press.eye, self.even, u, seen) for press, u in zip(self.seen, moved)]
        return self.found * (np.stack(means) - self.mean)

    def change(
        self, more: Sequence[np.ndarray | None], eyes: Sequence[CameraView] | None = None
    ) -> np.ndarray:
        """Return the change of the flow (F, m, 2) [px] by further displacements (Q, 3) of the even points, or other eyes."""
        return self.found * (self._means(more, eyes or [press.eye for press in self.seen]) - self.mean)

    def _means(self, more: Sequence[np.ndarray | None], eyes: Sequence[CameraView]) -> np.ndarray:
        moved = [self.evenly[int(press.row["site"])][self.depth(press)] for press in self.seen]
        return np.stack(
            [
                mean_motion(eye, self.even, u if du is None else u + du)
                for eye, u, du in zip(eyes, moved, more)
            ]
        )

    def change_along(self, key: str) -> np.ndarray:
        """Return the change of the flow (F, m, 2) [px per unit] along a derivative; 0 where it is not observable.

        That may be everywhere, as of a defect far from all images. Raises FlowUnknown where it could not be had.
        """
        sites = [int(press.row["site"]) for press in self.seen]
        lacking = [s for s, moving in zip(sites, self.moving) if key in self.asked[s] and key not in moving]
        if lacking or (key not in self.known and not _of_laws(key)):
            raise FlowUnknown(key)
        nothing = np.zeros(self.mean.shape[1:])
        return self.found * np.stack([moving.get(key, nothing) for moving in self.moving])

    def slope(self) -> np.ndarray:
        """Return d flow / d depth (F, m, 2) [px/mm]."""
        more = []
        for press in self.seen:
            site = int(press.row["site"])
            knots, u = np.concatenate([[0.0], self.planned[site].depths_mm]), self.evenly[site]
            curve = PchipInterpolator(knots, np.concatenate([np.zeros_like(u[:1]), u]))
            more.append(-STEP_MM * curve.derivative()(press.row["depth_mm"]))
        return -self.change(more) / STEP_MM

    def columns(self, effect: Effect, shape: Shape, number: int) -> np.ndarray:
        """Return the change of the flow (F, m, 2, P) [px per unit] by each value of an effect. Raises FlowUnknown."""
        steps = [1.0 if effect.binary else p.width * (p.sign or 1) for p in effect.parameters]
        if effect.to_camera is not None:
            return np.stack([self._by_camera(effect, k, step) for k, step in enumerate(steps)], axis=-1)
        if isinstance(effect.to_forces, FirstOrder):
            return np.stack([self.change_along(key) for key in effect.to_forces.keys(number)], axis=-1)
        return self._by_parts(effect, shape)

    def _by_parts(self, effect: Effect, shape: Shape) -> np.ndarray:
        """Return the change of the flow (F, m, 2, P) [px per unit] by an effect that is made of others' derivatives.

        Its share of each derivative is that of the force at the indentation; others move nothing while the stage waits.
        """
        assert effect.to_forces is not None
        context, rows = self.base.context, [int(press.row.name) for press in self.seen]
        found = np.zeros((*self.mean.shape, len(effect.parameters)))
        parts = [key for name in effect.depends_on for key in _keys_of(name)]
        for key in parts if effect.family in ("history", "kinematics") else ():
            alone = context.with_derivative(key)
            along = alone.derivative(key)[rows]
            size = np.maximum(np.sum(along**2, axis=1), np.finfo(float).tiny)
            for k in range(len(effect.parameters)):
                step = effect.unit_step(k, UNIT)
                change = (effect.to_forces(alone, shape, alone.force, step) - alone.force)[rows] / step[k]
                share = np.sum(change * along, axis=1) / size
                if share.any():
                    found[..., k] += share[:, None, None] * self.change_along(key)
        return found

    def _by_camera(self, effect: Effect, k: int, step: float) -> np.ndarray:
        amounts = step * np.eye(len(effect.parameters))[k]
        eyes = [self.seen_by(press, [(effect, amounts)]) for press in self.seen]
        return self.change([None] * len(self.seen), eyes) / step

    def seen_by(self, press: FlowObservation, cameras: Sequence[tuple[Effect, np.ndarray]]) -> CameraView:
        """Return the eye of an indentation with effects of the camera in it."""
        camera: Camera = press.eye.camera
        for effect, amounts in cameras:
            if effect.to_camera is not None:
                camera = effect.to_camera(self.solver.study, camera, tuple(amounts))
        return replace(press.eye, camera=camera)

    def solved(self, studied: Sequence[tuple[Effect, Shape, np.ndarray]]) -> list[np.ndarray]:
        """Return the further displacement (Q, 3) of the even points at each indentation with effects of the finite elements.

        Raises NotConverged.
        """
        study = self.solver.study
        for effect, shape, amounts in studied:
            if effect.to_study is not None:
                study = effect.to_study(study, shape, tuple(amounts))
        sites = sorted(self.planned)
        found = solved_with(self.solver, study, [self.planned[s] for s in sites], self.even)
        with_it = dict(zip(sites, found))
        more = []
        for press in self.seen:
            site, d = int(press.row["site"]), self.depth(press)
            more.append(with_it[site][d] - self.coarsely[site][d])
        return more


def _keys_of(name: str) -> list[str]:
    """Return the derivatives of an effect of the catalogue."""
    first_order = CATALOGUE[name].to_forces
    assert isinstance(first_order, FirstOrder)
    return first_order.keys(None)


def flow_model(
    solver: Solver,
    base: Base,
    seen: Sequence[FlowObservation],
    effects: Mapping[str, Effect],
    particles: Particles,
) -> FlowModel:
    """Return the model of the flow of some indentations, solved. Raises SolverFailed where the base cannot be."""
    even = even_points(solver.study.sensor, particles.diameter_mm)
    sites = sorted({int(press.row["site"]) for press in seen})
    asked = list(asked_of(solver, effects.values(), base.context))
    planned, near = {}, {}
    for site in sites:
        whole = way_down(base.runs.planned[base.runs.of_sites(np.array([site]))[0]])
        deepest = max(p.row["depth_mm"] for p in seen if int(p.row["site"]) == site)
        planned[site] = replace(whole, depths_mm=tuple(d for d in whole.depths_mm if d <= deepest + 1e-6))
        near[site] = observed_by(asked, planned[site])
    paths = [planned[site] for site in sites]
    try:
        fine = each_moved(solver, solver.study, paths)
    except NotConverged as failure:
        raise SolverFailed(
            f"the gel's motion at an indentation with images does not converge: {failure}"
        ) from None
    coarse = dict(zip(sites, each_moved_along(solver, paths, asked)))
    points: dict[int, np.ndarray] = {}
    evenly: dict[int, np.ndarray] = {}
    for site, moved in zip(sites, fine):
        for at, found in ((particles.points, points), (even, evenly)):
            found[site] = _at(moved, moved.weights(at))
    weights = {site: moved.weights(even) for site, moved in coarse.items()}
    coarsely = {site: _at(moved, weights[site]) for site, moved in coarse.items()}
    moving = []
    for press in seen:
        site = int(press.row["site"])
        d = _step(planned[site], press)
        slope = mean_motion_slope(press.eye, even, evenly[site][d], weights[site])
        along = {key: np.tensordot(slope, field[d], 2) for key, field in coarse[site].along.items()}
        moving.append(along)
    asked_at = {site: frozenset(near[site]) for site in sites}
    known = frozenset(one.key for one in asked)
    return FlowModel(
        solver, base, seen, particles, planned, known, asked_at, moving, even, points, evenly, coarsely
    )


def _at(moved: Moved, weights: csr_array) -> np.ndarray:
    """Return the base displacement (D, P, 3) at points of these weights (P, G)."""
    return np.stack([weights @ u.astype(float) for u in moved.base])


def _drawn_by(task: tuple[CameraView, Particles, list[tuple[np.ndarray, np.ndarray]]]) -> np.ndarray:
    """Return `Scene.flows` (F, K, m, 2) [px] of one scene at some motions and fields."""
    eye, particles, motions = task
    scene = Scene(eye, particles)
    return np.stack([scene.flows(moved, field) for moved, field in motions])


def _step(planned: PlannedCell, press: FlowObservation) -> int:
    """Return the step of a loading at which an indentation was seen."""
    return int(np.argmin(np.abs(np.array(planned.depths_mm) - press.row["depth_mm"])))


def _of_laws(key: str) -> bool:
    return key.startswith("law ")
