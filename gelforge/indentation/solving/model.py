"""The finite-element model of an indentation: mesh, body, indenter and path, before anything is solved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gelforge.config import Effects, Indenter, Mechanics, Sensor
from gelforge.config.parts.mechanics import QUALITIES
from gelforge.indentation.effects.fields import element_stiffness
from gelforge.indentation.effects.geometry import carried_mesh, moved_mesh, region_prestretch
from gelforge.indentation.effects.history import relaxation_of, softening_of
from gelforge.indentation.effects.kinematics import (
    in_machine,
    machine_frame,
    path_over_flat_top,
    real_place,
    yielding,
)
from gelforge.indentation.effects.material import check_laws, region_bulk, region_laws, stretches_ahead
from gelforge.indentation.paths.first_contact import centre_at_contact, surface_point
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.planning.reach import block_tops, check_reach, reach_of, soft_base
from gelforge.indentation.sensor.indenter_shapes import real_indenter, shape_of
from gelforge.indentation.sensor.sensor_mesh import sensor_mesh
from gelforge.mechanics.bodies.body import Body, SmallStrainBody
from gelforge.mechanics.bodies.memory import RememberingBody
from gelforge.mechanics.contact.state import Settings
from gelforge.mechanics.indenters.shapes import DOWN, rotation_of
from gelforge.mechanics.indenters.shapes import Indenter as Shape
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.meshes.mesh import Mesh


@dataclass(frozen=True)
class Model:
    """The finite-element model of a trajectory, before anything is solved."""

    mesh: Mesh
    body: Body
    shape: Shape
    settings: Settings
    start: np.ndarray  # (3,) the indenter's centre at the first touch [mm]
    centres: np.ndarray  # (D, 3) or (D, 6) poses of Trajectory.centres, as commanded where the machine yields
    yielding: np.ndarray | None  # (3,) [mm/N] of machine and base plate, along the path
    drawn: Mesh  # of the sensor as drawn
    drawn_for: tuple  # all that decides it
    place: np.ndarray  # (2,) where the indentation really is [mm]


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
    """Return the meshes for a trajectory: of the sensor as drawn, in which effects have their places, and as it really is.

    Parameters
    ----------
    sensor : Sensor
        As drawn.
    described : Shape
        The indenter, as the configuration describes it.
    mechanics : Mechanics
        Sizes of the mesh [mm], and effects.
    trajectory : Trajectory
        Position and poses [mm, deg].

    Returns
    -------
    tuple of Mesh
        As drawn and as it is; the elements are the same.
    """
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
    factors: dict[str, Any] = {"stiffness": stiffness, "bulk_stiffness": bulk_stiffness}
    if mechanics.strain == "small":
        return SmallStrainBody(mesh, by_region, bulk, **factors)
    if like is not None and not np.array_equal(like.mesh.elements, mesh.elements):
        like = None
    prestretch = region_prestretch(sensor, mechanics.effects, mesh.regions)
    relaxation = relaxation_of(sensor, mechanics.effects, mesh.regions)
    softening = softening_of(sensor, mechanics.effects, mesh.regions)
    if relaxation or softening:
        return RememberingBody(
            mesh, by_region, bulk, relaxation, softening, **factors, prestretch=prestretch, like=like
        )
    return Body(mesh, by_region, bulk, **factors, prestretch=prestretch, like=like)


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


def _direction(mesh: Mesh, trajectory: Trajectory, place: tuple[float, float]) -> np.ndarray:
    """Return the unit vector (3,) along which the indenter comes."""
    if trajectory.approach == "vertical":
        return DOWN
    return -surface_point(mesh, *place)[1]


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
        friction_exponents=contact.friction_exponents,
        friction_pressures=contact.friction_pressures_MPa,
        adhesion_work=contact.adhesion.work_N_per_mm,
        adhesion_approach=contact.adhesion.approach_N_per_mm,
        adhesion_range=contact.adhesion.range_mm,
        film_thickness=contact.film.thickness_mm,
        film_pressure=contact.film.pressure_MPa,
    )
