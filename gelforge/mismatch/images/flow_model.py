"""The flow that the base predicts at the indentations with images, by how the gel moves, and how it follows every effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.sparse import csr_array

from gelforge.config import Camera, Study
from gelforge.files import source_digest
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.symmetry import transform_points
from gelforge.indentation.solving.inputs import inputs_digest
from gelforge.indentation.solving.sensitivities import Variation, unmirrored
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.candidates import UNIT
from gelforge.mismatch.fem.asked import Asked, asked_of, carried_derivatives, observed_by
from gelforge.mismatch.fem.solutions import Solver, SolverFailed, along_laws, each_derivative, once
from gelforge.mismatch.fem.solver import Base
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
from gelforge.mismatch.model.effect import Effect, Hyperparameters
from gelforge.mismatch.model.images_of_presses import inverse, solved_for_all
from gelforge.mismatch.model.places import FirstOrder
from gelforge.recording.imaging.flow import Flow
from gelforge.virtual_lab.particles import interpolation
from gelforge.workers import each


@dataclass(frozen=True)
class Moved:
    """Displacement of the layers with particles at some depths of an indentation, on a mesh of boxes.

    What was solved at a mirror image is carried: displacements are those here, nodes stay where they were solved.
    """

    nodes: np.ndarray  # (G, 3) undeformed [mm], at the image
    boxes: np.ndarray  # (E, 8)
    base: np.ndarray  # (D, G, 3) [mm]
    along: Mapping[str, np.ndarray]  # (D, G, 3) [mm per unit] by derivative
    symmetry: str = "identity"  # which carries the image here
    width_mm: float = 0.0  # of the square that it is a symmetry of

    def weights(self, points: np.ndarray) -> csr_array:
        """Return the weights (P, G) of the nodes at points (P, 3)."""
        there = transform_points(inverse(self.symmetry), points, self.width_mm)
        return interpolation(self.nodes, self.boxes, there)

    def at(self, weights: csr_array) -> np.ndarray:
        """Return the base displacement (D, P, 3) at points of these weights."""
        return np.stack([weights @ u.astype(float) for u in self.base])

    def carried(self, symmetry: str, asked: Sequence[Asked], width_mm: float) -> Moved:
        """Return what a symmetry of a square of this width makes of it, with the asked derivatives that it can show."""
        fields = carried_derivatives(dict(self.along) | {"base": self.base}, symmetry, asked, width_mm)
        return Moved(self.nodes, self.boxes, fields.pop("base"), fields, symmetry, width_mm)


def storing(study: Study) -> Study:
    """Return the study with displacements kept."""
    mechanics = study.mechanics.model_copy(update={"store_displacement": True})
    return unmirrored(study.model_copy(update={"mechanics": mechanics}))


def _storing(variation: Variation) -> Variation:
    without = variation.without and storing(variation.without)
    instead = variation.instead and _storing(variation.instead)
    return replace(variation, study=storing(variation.study), without=without, instead=instead)


def moved_by(task: tuple[Solver, Study, PlannedCell, Mapping[str, Variation]]) -> Moved | str:
    """Return how an indentation moves the gel in a study, with derivatives along variations, or why it is not solved.

    Variations that could not be solved are missing.
    """
    solver, study, planned, variations = task
    study, laws = storing(study), dict(solver.laws)
    asked = {key: _storing(variation) for key, variation in variations.items()}
    about = {key: variation.inputs for key, variation in asked.items()}
    source = source_digest("mismatch/images/flow_model.py")
    content = ["moved", inputs_digest(study, laws, planned), about, source]

    def solve() -> dict[str, np.ndarray] | str:
        try:
            cell, along = each_derivative(study, laws, planned, asked)
        except NotConverged as failure:
            return str(failure)
        names = {"nodes": "gel_node_mm", "boxes": "gel_hex", "base": "gel_displacement_mm"}
        fields = {
            key: one.gel for key, one in along.items() if not isinstance(one, str) and one.gel is not None
        }
        return {key: cell.arrays[array] for key, array in names.items()} | fields

    kept = once(solver, content, solve)
    if isinstance(kept, str):
        return kept
    along = {key: field for key, field in kept.items() if key not in ("nodes", "boxes", "base")}
    return Moved(kept["nodes"], kept["boxes"], kept["base"], along)


def motions_of(
    solver: Solver, study: Study, planned: Sequence[PlannedCell], asked: Sequence[Asked] | None = None
) -> list[Moved]:
    """Return how each indentation moves the gel in a study, mirror images carried. Raises NotConverged.

    asked: also all derivatives that an indentation shows, and those along the laws.
    """
    laws = {} if asked is None else along_laws(solver, storing(study))

    def solve(distinct: list[PlannedCell]) -> list[Moved]:
        tasks = [(solver, study, one, laws | observed_by(asked or (), one)) for one in distinct]
        moved = solver.each(moved_by, tasks)
        for one, path in zip(moved, distinct):
            if isinstance(one, str):
                raise NotConverged(f"at ({path.x_mm:g}, {path.y_mm:g}) mm: {one}")
        return moved

    moved, symmetries = solved_for_all(solver.study, planned, solve)
    width = study.sensor.width_x_mm
    return [one.carried(symmetry, asked or (), width) for one, symmetry in zip(moved, symmetries)]


class FlowUnknown(ValueError):
    """The flow with an effect could not be computed."""


@dataclass(frozen=True, eq=False)
class Motion:
    """How the gel moves at an indentation with images."""

    planned: PlannedCell  # the loading through the depths of its site
    step: int  # of that loading, at which it was seen
    points: np.ndarray  # (P, 3) [mm] displacement of all particles
    even: np.ndarray  # (Q, 3) [mm] that of the even points
    coarse: np.ndarray  # (Q, 3) [mm] the same on the coarser mesh
    per_depth: np.ndarray  # (Q, 3) its slope over the depth
    along: Mapping[str, np.ndarray]  # (m, 2) [px per unit] mean motion in the image along derivatives
    asked: frozenset[str]  # derivatives that it can show


@dataclass(frozen=True, eq=False)
class FlowModel:
    """Displacements behind the flow of F indentations with images."""

    solver: Solver
    base: Base
    seen: Sequence[FlowObservation]
    particles: Particles
    motions: Sequence[Motion]  # by indentation
    known: frozenset[str]  # derivatives that the study has
    even: np.ndarray  # (Q, 3) [mm], points that fill the layers with particles

    @property
    def eyes(self) -> list[CameraView]:
        """Return the camera of each indentation."""
        return [press.eye for press in self.seen]

    @cached_property
    def drawn(self) -> np.ndarray:
        """Return flows (F, K, m, 2) [px] that the base could show: the real image's warp and the rest of each placement."""
        warps = [
            flow_of_warp(Flow(press.untouched, PRESET), press.untouched, field, press.eye.imaging)
            for press, field in zip(self.seen, self.fields)
        ]
        return np.stack(warps)[:, None] + self.by_height(self.eyes, self.particles)

    @cached_property
    def fields(self) -> list[np.ndarray]:
        """Return the gel's mean motion in the base (H, W, 2) [px] near each pixel, at each indentation."""
        return [motion_field(eye, self.even, one.even) for eye, one in zip(self.eyes, self.motions)]

    def by_height(self, eyes: Sequence[CameraView], particles: Particles) -> np.ndarray:
        """Return by how much flows (F, K, m, 2) [px] are other than a warp's, as particles of other heights move otherwise.

        In the first placements, with other eyes or another diameter of the particles.
        """
        count, workers = len(particles.points), self.solver.workers
        seen_by: dict[str, list[int]] = {}
        for k, eye in enumerate(eyes):
            seen_by.setdefault(repr(eye), []).append(k)
        # One scene draws many indentations; they are shared out, so that all workers draw.
        parts = [part for rows in seen_by.values() for part in np.array_split(rows, workers) if len(part)]
        tasks = [
            (eyes[part[0]], particles, [(self.motions[k].points[:count], self.fields[k]) for k in part])
            for part in parts
        ]
        flows = np.concatenate(each(_drawn_by, tasks, workers, "scenes drawn"))
        return flows[np.argsort(np.concatenate(parts))]

    @cached_property
    def mean(self) -> np.ndarray:
        """Return the mean motion (F, m, 2) [px] in the base."""
        return self._means([0.0] * len(self.seen), self.eyes)

    @cached_property
    def share_found(self) -> np.ndarray:
        """Return what part (F, 1, 1) of the mean motion the search finds at each indentation."""
        drawn = self.drawn.mean(axis=1)
        both, square = drawn * self.mean, self.mean**2
        return np.sum(both, axis=(1, 2), keepdims=True) / np.sum(square, axis=(1, 2), keepdims=True)

    def other_heights(self, share: float) -> np.ndarray:
        """Return the change of the flow (F, m, 2) [px] if the highest particles count by a share more, the lowest less."""
        z = self.even[:, 2]
        counts = 1 + share * (2 * (z - z.min()) / np.ptp(z) - 1)
        return self.share_found * (self._means([0.0] * len(self.seen), self.eyes, counts) - self.mean)

    def change(
        self, more: Sequence[np.ndarray | float], eyes: Sequence[CameraView] | None = None
    ) -> np.ndarray:
        """Return the change of the flow (F, m, 2) [px] by further displacements (Q, 3) of the even points, or other eyes."""
        return self.share_found * (self._means(more, eyes or self.eyes) - self.mean)

    def _means(
        self,
        more: Sequence[np.ndarray | float],
        eyes: Sequence[CameraView],
        counts: np.ndarray | float = 1.0,
    ) -> np.ndarray:
        moved = [one.even + du for one, du in zip(self.motions, more)]
        return np.stack([mean_motion(eye, self.even, u, counts) for eye, u in zip(eyes, moved)])

    def change_along(self, key: str) -> np.ndarray:
        """Return the change of the flow (F, m, 2) [px per unit] along a derivative; 0 where it is not observable.

        That may be everywhere, as of a defect far from all images. Raises FlowUnknown where it could not be had.
        """
        lacking = any(key in one.asked and key not in one.along for one in self.motions)
        if lacking or not (key in self.known or key.startswith("law ")):
            raise FlowUnknown(key)
        nothing = np.zeros(self.mean.shape[1:])
        return self.share_found * np.stack([one.along.get(key, nothing) for one in self.motions])

    def slope(self, step_mm: float = 0.05) -> np.ndarray:
        """Return d flow / d depth (F, m, 2) [px/mm], over a step."""
        return -self.change([-step_mm * one.per_depth for one in self.motions]) / step_mm

    def columns(self, effect: Effect, hyperparameters: Hyperparameters, number: int) -> np.ndarray:
        """Return the change of the flow (F, m, 2, P) [px per unit] by each value of an effect. Raises FlowUnknown."""
        if effect.to_camera is not None:
            steps = [effect.unit_step(k, 1.0) for k in range(len(effect.parameters))]
            nothing = [0.0] * len(self.seen)
            changes = [self.change(nothing, self.seen_by([(effect, np.array(step))])) for step in steps]
            return np.stack(
                [change / step[k] for k, (change, step) in enumerate(zip(changes, steps))], axis=-1
            )
        if isinstance(effect.to_forces, FirstOrder):
            return np.stack([self.change_along(key) for key in effect.to_forces.keys(number)], axis=-1)
        return self._by_parts(effect, hyperparameters)

    def _by_parts(self, effect: Effect, hyperparameters: Hyperparameters) -> np.ndarray:
        """Return the change of the flow (F, m, 2, P) [px per unit] by an effect that is made of others' derivatives.

        Its share of each derivative is that of the force at the indentation; others move nothing while the stage waits.
        """
        assert effect.to_forces is not None
        context, rows = self.base.context, [int(press.row.name) for press in self.seen]
        columns = np.zeros((*self.mean.shape, len(effect.parameters)))
        parts = [key for name in effect.depends_on for key in _keys_of(name)]
        for key in parts if effect.family in ("history", "kinematics") else ():
            alone = context.with_derivative(key)
            along = alone.derivative(key)[rows]
            size = np.maximum(np.sum(along**2, axis=1), np.finfo(float).tiny)
            for k in range(len(effect.parameters)):
                step = effect.unit_step(k, UNIT)
                change = (effect.to_forces(alone, hyperparameters, alone.force, step) - alone.force)[
                    rows
                ] / step[k]
                share = np.sum(change * along, axis=1) / size
                if share.any():
                    columns[..., k] += share[:, None, None] * self.change_along(key)
        return columns

    def seen_by(self, cameras: Sequence[tuple[Effect, np.ndarray]]) -> list[CameraView]:
        """Return the eye of each indentation with effects of the camera in it."""
        return [replace(eye, camera=self._camera_with(eye.camera, cameras)) for eye in self.eyes]

    def _camera_with(self, camera: Camera, cameras: Sequence[tuple[Effect, np.ndarray]]) -> Camera:
        for effect, theta in cameras:
            assert effect.to_camera is not None
            camera = effect.to_camera(self.solver.study, camera, tuple(theta))
        return camera

    def solved(self, studied: Sequence[tuple[Effect, Hyperparameters, np.ndarray]]) -> list[np.ndarray]:
        """Return the further displacement (Q, 3) of the even points at each indentation with effects of the finite elements.

        Raises NotConverged.
        """
        study = self.solver.study
        for effect, hyperparameters, theta in studied:
            if effect.to_study is not None:
                study = effect.to_study(study, hyperparameters, tuple(theta))
        solver = replace(self.solver, study=study)
        moved = motions_of(solver, solver.coarse, [one.planned for one in self.motions])
        return [
            one.at(one.weights(self.even))[motion.step] - motion.coarse
            for one, motion in zip(moved, self.motions)
        ]


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
    planned = []
    for site in sites:
        whole = base.ways[site]
        deepest = max(p.row["depth_mm"] for p in seen if int(p.row["site"]) == site)
        planned.append(replace(whole, depths_mm=tuple(d for d in whole.depths_mm if d <= deepest + 1e-6)))
    try:
        fine = motions_of(solver, solver.study, planned)
        coarse = motions_of(solver, solver.coarse, planned, asked)
    except NotConverged as failure:
        raise SolverFailed(
            f"the gel's motion at an indentation with images does not converge {failure}"
        ) from None
    motions: dict[int, Motion] = {}  # by indentation
    for site, path, one, other in zip(sites, planned, fine, coarse):
        points, evenly = one.at(one.weights(particles.points)), one.at(one.weights(even))
        weights, knots = other.weights(even), np.concatenate([[0.0], path.depths_mm])
        coarsely = other.at(weights)
        curve = PchipInterpolator(knots, np.concatenate([np.zeros_like(evenly[:1]), evenly]))
        shown = frozenset(observed_by(asked, path))
        for k, press in enumerate(seen):
            if int(press.row["site"]) == site:
                d = int(np.argmin(np.abs(np.array(path.depths_mm) - press.row["depth_mm"])))
                slope = mean_motion_slope(press.eye, even, evenly[d], weights)
                along = {key: np.tensordot(slope, field[d], 2) for key, field in other.along.items()}
                per_depth = curve.derivative()(press.row["depth_mm"])
                motions[k] = Motion(path, d, points[d], evenly[d], coarsely[d], per_depth, along, shown)
    known = frozenset(one.key for one in asked)
    return FlowModel(solver, base, seen, particles, [motions[k] for k in range(len(seen))], known, even)


def _drawn_by(task: tuple[CameraView, Particles, list[tuple[np.ndarray, np.ndarray]]]) -> np.ndarray:
    """Return `Scene.flows` (F, K, m, 2) [px] of one scene at some motions and fields."""
    eye, particles, motions = task
    scene = Scene(eye, particles)
    return np.stack([scene.flows(moved, field) for moved, field in motions])
