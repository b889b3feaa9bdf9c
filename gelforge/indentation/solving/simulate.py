"""One site: the finite-element solution of one position with all its depths."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import gelforge
from gelforge.config import ConfigError, Effects, Indenter, Mechanics, Sensor, Study
from gelforge.config.parts.mechanics import QUALITIES
from gelforge.indentation.cells.cell_arrays import force_arrays, gel_arrays, moment_shift, section_arrays
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.effects.fields import element_stiffness
from gelforge.indentation.effects.geometry import carried_mesh, moved_mesh, region_prestretch
from gelforge.indentation.effects.history import (
    TimedPath,
    empty_grid,
    in_time,
    quadrature_points,
    relaxation_of,
    softening_of,
)
from gelforge.indentation.effects.kinematics import (
    in_machine,
    machine_frame,
    path_over_flat_top,
    real_place,
    yielding,
)
from gelforge.indentation.effects.material import check_laws, region_bulk, region_laws, stretches_ahead
from gelforge.indentation.paths.first_contact import centre_at_contact, surface_point
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.planning.reach import block_tops, check_reach, reach_of, soft_base
from gelforge.indentation.planning.touching import touched_parts
from gelforge.indentation.sensor.indenter_shapes import real_indenter, shape_of
from gelforge.indentation.sensor.sensor_mesh import sensor_mesh
from gelforge.indentation.sensor.surface_files import file_digests, surface_digests
from gelforge.indentation.solving.inputs import inputs_digest
from gelforge.indentation.solving.stretch_range import (
    Outside,
    element_stretches,
    stretch_ranges,
    unstable_shares,
)
from gelforge.mechanics.bodies.body import Body, SmallStrainBody
from gelforge.mechanics.bodies.memory import RememberingBody
from gelforge.mechanics.bodies.peak_grid import PeakGrid
from gelforge.mechanics.contact.state import Settings, State
from gelforge.mechanics.indenters.shapes import DOWN, rotation_of
from gelforge.mechanics.indenters.shapes import Indenter as Shape
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.meshes.elements import mean_gradient
from gelforge.mechanics.meshes.mesh import Mesh
from gelforge.mechanics.sensitivities.direct import Followed
from gelforge.mechanics.solving.balances import force_balance, moment_balance
from gelforge.mechanics.solving.equilibrium import NotConverged, Press
from gelforge.mechanics.solving.yielding import follow_yielding
from gelforge.progress import tracked


def simulate_cell(
    study: Study,
    laws: dict[str, PrincipalLaw],
    planned: PlannedCell,
    outside: dict[str, Outside] | None = None,
) -> Cell:
    """Return the solved site of a plan; laws are named by material. A site that fails says so in its attributes.

    outside: by material, whether principal stretches leave the range in which its law was tested.
    """
    return solved_cell(study, laws, planned, outside)[0]


def solved_cell(
    study: Study,
    laws: dict[str, PrincipalLaw],
    planned: PlannedCell,
    outside: dict[str, Outside] | None = None,
) -> tuple[Cell, Solution]:
    """Return what simulate_cell does, and the solution along which derivatives can be taken."""
    layers = study.sensor.layers
    by_layer = {layer.name: laws[layer.material] for layer in layers}
    tested = {layer.name: (outside or {}).get(layer.material) for layer in layers}
    trajectory = Trajectory.of(planned, study.plan.approach)
    cell, _, solution = _simulated(
        study.sensor, study.indenter, study.mechanics, by_layer, trajectory, tested, None
    )
    identity = {"cell": planned.name, "inputs_digest": inputs_digest(study, laws, planned), "source": ""}
    return Cell(cell.arrays, cell.attributes | identity), solution


AWAY_MM = 1.0  # the indenter's distance while a residual stretch finds its balance
TOUCH_STEPS = 20


@dataclass(frozen=True)
class Model:
    """The finite-element model of a trajectory, before anything is solved."""

    mesh: Mesh
    body: Body
    shape: Shape
    settings: Settings
    start: np.ndarray  # (3,) the indenter's centre at the first touch [mm]
    centres: (
        np.ndarray
    )  # (D, 3) or (D, 6) poses, see Trajectory.centres; where the machine yields, the commanded ones
    yielding: np.ndarray | None  # (3,) [mm/N] of machine and base plate, along the path
    drawn: Mesh  # of the sensor as drawn
    drawn_for: tuple  # all that decides it
    place: np.ndarray  # (2,) where the indentation really is [mm]


@dataclass(frozen=True)
class Solution:
    """A model, what has solved it, and the path that was gone."""

    model: Model
    press: Press
    followed: Followed


def model_of(
    sensor: Sensor,
    indenter: Indenter,
    mechanics: Mechanics,
    laws: dict[str, PrincipalLaw],
    trajectory: Trajectory,
    base: Model | None = None,
) -> Model:
    """Return the model of a trajectory; laws are named by layer.

    base: one that lends what is the same of both. An indentation that is elsewhere than the base's then takes the touched
    part of a block's mesh along, where there is room to the walls.
    """
    effects = mechanics.effects
    effects.check(sensor)
    described = shape_of(indenter)
    drawn_for = sensor, indenter, mechanics.mesh, effects.geometry.base, trajectory
    place = np.array(real_place(sensor, effects, trajectory.x_mm, trajectory.y_mm))
    if base is not None and base.drawn_for == drawn_for:
        off_plan = [*(base.place - [trajectory.x_mm, trajectory.y_mm]), 0.0]
        drawn = _taken_along(base, sensor, touched_discs(described, trajectory) + off_plan, place)
        mesh = moved_mesh(drawn, sensor, effects)
    else:
        drawn, mesh = meshes_of(sensor, described, mechanics, trajectory)
    shape = real_indenter(described, effects)
    body = _body(mesh, drawn, sensor, mechanics, laws, base.body if base else None)
    start, centres, shape = _path(mesh, shape, sensor, effects, trajectory)
    tops = block_tops(sensor, effects, centres)
    if sensor.shape.kind != "block":
        tops = np.full(len(centres), surface_point(mesh, *place)[0][2])
    reach = reach_of(shape, centres, tops, soft_base(sensor, effects))
    where = f"the indentation at ({trajectory.x_mm:g}, {trajectory.y_mm:g}) mm"
    check_reach(reach, max(trajectory.depths_mm), where)
    known = base is not None and base.body.laws == body.laws  # a base that was checked differs little
    if mechanics.strain == "finite" and not known:  # small strains use the laws at rest only
        check_laws(body.laws, stretches_ahead(sensor, effects, laws, mesh.regions, reach.share))
    yields = yielding(sensor, effects, *place)
    return Model(mesh, body, shape, _settings(mechanics), start, centres, yields, drawn, drawn_for, place)


def _taken_along(base: Model, sensor: Sensor, touched: np.ndarray, place: np.ndarray) -> Mesh:
    """Return the drawn mesh of a base for an indentation at another place (2,) [mm]; its own where that cannot be had.

    touched (n, 3): discs (x, y, radius) [mm] of the base.
    """
    by = place - base.place
    if not by.any() or sensor.shape.kind != "block" or base.drawn.elements.shape[1] != 8:
        return base.drawn
    return carried_mesh(base.drawn, sensor, touched, by) or base.drawn


def meshes_of(
    sensor: Sensor, described: Shape, mechanics: Mechanics, trajectory: Trajectory
) -> tuple[Mesh, Mesh]:
    """Return the mesh for a trajectory of the sensor as drawn, in which effects have their places, and as it really is."""
    effects = mechanics.effects
    drawn = sensor_mesh(
        sensor,
        mechanics.mesh,
        trajectory.x_mm,
        trajectory.y_mm,
        touched_discs(described, trajectory),
        effects.geometry.base,
    )
    return drawn, moved_mesh(drawn, sensor, effects)


def _body(
    mesh: Mesh,
    drawn: Mesh,
    sensor: Sensor,
    mechanics: Mechanics,
    laws: dict[str, PrincipalLaw],
    like: Body | None,
) -> Body:
    """Return the body of a mesh; drawn is the mesh of the sensor as drawn, in which effects have their places."""
    by_region = region_laws(sensor, mechanics.effects, mesh.regions, laws)
    bulk = region_bulk(sensor, mechanics, mesh.regions)
    stiffness, bulk_stiffness = element_stiffness(drawn, sensor, mechanics)
    if mechanics.strain == "small":
        return SmallStrainBody(mesh, by_region, bulk, stiffness, bulk_stiffness)
    if like is not None and not np.array_equal(like.mesh.elements, mesh.elements):
        like = None
    prestretch = region_prestretch(sensor, mechanics.effects, mesh.regions)
    relaxation = relaxation_of(sensor, mechanics.effects, mesh.regions)
    softening = softening_of(sensor, mechanics.effects, mesh.regions)
    if relaxation or softening:
        return RememberingBody(
            mesh,
            by_region,
            bulk,
            relaxation,
            softening,
            like=like,
            stiffness=stiffness,
            bulk_stiffness=bulk_stiffness,
            prestretch=prestretch,
        )
    return Body(mesh, by_region, bulk, None, stiffness, bulk_stiffness, prestretch, like)


def _path(
    mesh: Mesh, shape: Shape, sensor: Sensor, effects: Effects, trajectory: Trajectory
) -> tuple[np.ndarray, np.ndarray, Shape]:
    """Return the indenter's centre at the first touch, its path, and its shape as it stands in the sensor's frame."""
    if sensor.shape.kind == "block" and trajectory.approach == "vertical":
        return path_over_flat_top(sensor, effects, shape, trajectory)
    place = real_place(sensor, effects, trajectory.x_mm, trajectory.y_mm)
    frame, along = None, _direction(mesh, trajectory, place)
    if any(effects.kinematics.tilt_deg):
        frame = machine_frame(effects)
        along, shape = frame @ along, in_machine(shape, frame)
    start = centre_at_contact(shape, mesh, *place, along)
    lead = effects.kinematics.contact_zero_mm
    return start, trajectory.centres(start, along, lead, frame), shape


def simulate_trajectory(
    sensor: Sensor,
    indenter: Indenter,
    mechanics: Mechanics,
    laws: dict[str, PrincipalLaw],
    trajectory: Trajectory,
    outside: dict[str, Outside | None] | None = None,
) -> Cell:
    """Return the solution of a trajectory; laws are named by layer. What fails ends the site, with its reason."""
    return _simulated(sensor, indenter, mechanics, laws, trajectory, outside, None)[0]


def simulate_in_order(
    sensor: Sensor,
    indenter: Indenter,
    mechanics: Mechanics,
    laws: dict[str, PrincipalLaw],
    trajectories: Iterable[Trajectory],
    grid: PeakGrid | None = None,
) -> Iterator[tuple[Cell, PeakGrid | None]]:
    """Yield the solution of each trajectory in the order recorded, and the softening that is left after it.

    Each begins relaxed, with the softening of all before it: grid is what was left by others, None for an untouched sensor.
    """
    for trajectory in trajectories:
        cell, grid, _ = _simulated(sensor, indenter, mechanics, laws, trajectory, None, grid)
        yield cell, grid


def _solved(
    model: Model,
    press: Press,
    start: State,
    sensor: Sensor,
    mechanics: Mechanics,
    path: TimedPath | None,
    grid: PeakGrid | None,
) -> tuple[Followed, str, PeakGrid | None]:
    """Return the states that were reached, why no more, and the softening left; path: where history matters."""
    followed = Followed(start, model.centres, [], [])
    states = followed.states
    body, mesh, effects = model.body, model.mesh, mechanics.effects
    presses = path.presses if path else (slice(0, len(model.centres)),)
    times = np.array(path.trajectory.times_s) if path and body.remembers else None
    grid = grid or empty_grid(sensor, effects, mesh.regions)
    points = np.empty((0, 0, 3)) if grid is None else quadrature_points(mesh)
    try:
        for poses in presses:
            if grid is not None and isinstance(body, RememberingBody):
                body.forget(grid.read(points, mesh.region, mesh.regions))
                start = replace(start, memory=body.initial)
            steps = follow_yielding(
                press, start, model.centres[poses], model.yielding, None if times is None else times[poses],
                None if path else lambda *step: followed.steps.append(step),
            )  # fmt: skip
            last = start
            steps = tracked(steps, "steps of the indenter", len(model.centres[poses]))
            for number, last in enumerate(steps, start=poses.start):
                if path is None or number in path.readings:
                    states.append(last)
            if grid is not None and isinstance(body, RememberingBody):
                grid = grid.updated(points, mesh.region, mesh.regions, body.initial.peak, last.memory.peak)
    except NotConverged as failure:
        return followed, str(failure), grid
    return followed, "", grid


def _simulated(
    sensor: Sensor,
    indenter: Indenter,
    mechanics: Mechanics,
    laws: dict[str, PrincipalLaw],
    trajectory: Trajectory,
    outside: dict[str, Outside | None] | None,
    grid: PeakGrid | None,
) -> tuple[Cell, PeakGrid | None, Solution]:
    wall_clock, cpu_clock = time.perf_counter(), time.process_time()
    history = mechanics.effects.history
    path = in_time(trajectory, history.timing) if history.any else None
    model = model_of(sensor, indenter, mechanics, laws, path.trajectory if path else trajectory)
    mesh, body, shape = model.mesh, model.body, model.shape
    small = mechanics.strain == "small"
    press = Press(body, shape, model.settings, mechanics.solver.linear_solver)
    start = press.start_at(model.start)
    _check_start(press, start)
    model, start, reason = (
        _balanced(model, press, start) if mechanics.effects.geometry.prestretch else (model, start, "")
    )
    followed = Followed(start, model.centres, [], [])
    if not reason:
        followed, reason, grid = _solved(model, press, start, sensor, mechanics, path, grid)
    states = followed.states
    done = len(states)
    arrays = {
        "depth_mm": np.array(trajectory.depths_mm[:done]),
        "shear_mm": trajectory.shears[:done],
        "tilt_deg": trajectory.tilts[:done],
        "indenter_mm": np.array([state.centre[:3] for state in states]).reshape(done, 3),
    }
    if trajectory.twists_deg:
        arrays["twist_deg"] = trajectory.twists[:done]
    arrays |= force_arrays(mesh, states, sensor, mechanics)
    arrays |= section_arrays(mesh, states, trajectory.y_mm)
    if mechanics.store_displacement:
        arrays |= gel_arrays(mesh, states, sensor)
    top = sensor.layers[-1].name  # its material makes the wall and the flange too
    tested = [(outside or {}).get(name if name in laws else top) for name in mesh.regions]
    gradient, rest = mean_gradient(body.gradient, body.weight), body.rest[mesh.region]
    stretches = [element_stretches(gradient, mesh.elements, state.u, rest) for state in states]
    attributes: dict[str, Any] = stretch_ranges(stretches, body.element_volume, mesh.region, tested)
    used = [None if small else body.laws[name] for name in mesh.regions]
    attributes |= unstable_shares(stretches, body.element_volume, mesh.region, used)
    attributes |= {
        "x_mm": trajectory.x_mm,
        "y_mm": trajectory.y_mm,
        "status": "failed" if reason else "converged",
        "reason": reason,
        "last_good_depth_mm": trajectory.depths_mm[done - 1] if done else 0.0,
        "phases": list(trajectory.phases[:done]),
        "touched_parts": touched_parts(shape, mesh, states),
        "side_contact": [bool(force.any()) for force in arrays["side_force_N"]],
        "regions": list(mesh.regions),
        "code_version": gelforge.__version__,
        "settings": _settings_text(sensor, indenter, mechanics, laws),
        "linear_solver": press.corrections.solver.name,
        "degrees_of_freedom": body.pattern.size,
        "iterations": [state.iterations for state in states],
        "factorisations": [state.factorisations for state in states],
        "residual": [state.residual for state in states],
        "force_balance": [force_balance(state, press.contact.least_force) for state in states],
        "moment_balance": [
            moment_balance(mesh, state, shape.size, not small, press.contact.least_force) for state in states
        ],
        "energy_mJ": [state.energy for state in states],
        "smallest_J": [state.smallest_J for state in states],
        "binning_moment_shift_Nmm": moment_shift(arrays, sensor),
        "seconds": time.perf_counter() - wall_clock,
        "cpu_seconds": time.process_time() - cpu_clock,
    }
    if path:
        attributes["time_s"] = [path.trajectory.times_s[number] for number in path.readings[:done]]
    return Cell(arrays, attributes), grid, Solution(model, press, followed)


def _balanced(model: Model, press: Press, start: State) -> tuple[Model, State, str]:
    """Return the model and its start after the residual stretch has found its balance; why it has not, if so.

    The indenter's path begins where it touches the surface as that then is.
    """
    away = start.centre + [0.0, 0.0, AWAY_MM]
    try:
        relaxed = press.step(None, replace(start, centre=away), away)
    except NotConverged as failure:
        return model, start, f"the residual stretch finds no balance: {failure}"
    centre = start.centre
    for _ in range(
        TOUCH_STEPS
    ):  # the surface has moved: so does the touch, by what the smallest gap has changed
        gap = press.contact.gap(relaxed.u, centre)[0]
        centre = centre + (gap.min() - start.gap.min()) * DOWN
    moved = centre - start.centre
    gap = press.contact.gap(relaxed.u, centre)[0]
    centres = model.centres + np.pad(moved, (0, model.centres.shape[1] - 3))
    return replace(model, start=centre, centres=centres), replace(relaxed, centre=centre, gap=gap), ""


def touched_discs(shape: Shape, trajectory: Trajectory) -> np.ndarray:
    """Return discs (n, 3) = (x, y, radius) [mm] of the top surface that a trajectory touches, over-estimated a little."""
    footprint = shape.footprint(max(trajectory.depths_mm))
    places = trajectory.shears + [trajectory.x_mm, trajectory.y_mm]
    poses = np.unique(np.column_stack([places, trajectory.twists]), axis=0)
    discs = [_twisted(footprint, twist) + [x, y, 0.0] for x, y, twist in poses]
    return np.concatenate(discs)


def _twisted(discs: np.ndarray, twist_deg: float) -> np.ndarray:
    """Return discs (n, 3) = (x, y, radius) turned about the z axis."""
    if not twist_deg:
        return discs
    turn = rotation_of(np.radians([0.0, 0.0, twist_deg]))[:2, :2]
    return np.column_stack([discs[:, :2] @ turn.T, discs[:, 2]])


def _direction(mesh: Mesh, trajectory: Trajectory, place: tuple[float, float]) -> np.ndarray:
    """Return the unit vector (3,) along which the indenter comes."""
    if trajectory.approach == "vertical":
        return DOWN
    return -surface_point(mesh, *place)[1]


def _check_start(press: Press, start: State) -> None:
    points = press.contact.X + start.u[press.surface]
    inside = -float(press.indenter.gap(points, start.centre)[0].min())
    if inside > 1e-9:
        raise ConfigError(
            f"the indenter starts {inside:.3g} mm inside the gel at the first touch of its lowest point; "
            "correct its offset_mm or the sensor's surface"
        )


def _settings(mechanics: Mechanics) -> Settings:
    contact = mechanics.effects.contact
    return Settings(
        friction=mechanics.friction,
        normal_augmentation=mechanics.contact.normal_augmentation,
        tangential_augmentation=mechanics.contact.tangential_augmentation,
        force_tolerance=mechanics.solver.force_tolerance,
        gap_tolerance=mechanics.solver.gap_tolerance,
        longest_step=QUALITIES[mechanics.mesh.quality].step * mechanics.solver.longest_step,
        max_iterations=mechanics.solver.max_iterations,
        max_halvings=mechanics.solver.max_halvings,
        facets=mechanics.contact.facets,
        initial_normals=mechanics.contact_normals == "initial",
        friction_exponents=(contact.pressure_exponent, *(term.exponent for term in contact.pressure_terms)),
        friction_pressures=(
            contact.reference_pressure_MPa,
            *(term.reference_pressure_MPa for term in contact.pressure_terms),
        ),
        adhesion_work=contact.adhesion.work_N_per_mm,
        adhesion_approach=contact.adhesion.approach_N_per_mm,
        adhesion_range=contact.adhesion.range_mm,
        film_thickness=contact.film.thickness_mm,
        film_pressure=contact.film.pressure_MPa,
    )


def _settings_text(
    sensor: Sensor, indenter: Indenter, mechanics: Mechanics, laws: dict[str, PrincipalLaw]
) -> str:
    content = {
        name: part.model_dump(mode="json") for name, part in [("sensor", sensor), ("indenter", indenter)]
    }
    content["indenter_files"], content["sensor_files"] = file_digests(indenter), surface_digests(sensor)
    content["mechanics"] = mechanics.model_dump(mode="json")
    content["laws_by_layer"] = {name: law.description() for name, law in laws.items()}
    return json.dumps(content, sort_keys=True)
