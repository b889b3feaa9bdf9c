"""One cell: the finite-element solution of one position with all its depths, and mirrored cells."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass

import numpy as np

import gelforge
from gelforge.config import Bins, Indenter, Mechanics, Mesh, Sensor, Study
from gelforge.files import digest, source_digest
from gelforge.indentation import binning
from gelforge.indentation.cell_file import Cell
from gelforge.indentation.plan import PlannedCell
from gelforge.indentation.symmetry import transform_bins, transform_points, transform_vectors
from gelforge.mechanics.balances import force_balance, moment_balance
from gelforge.mechanics.body import Body, SmallStrainBody
from gelforge.mechanics.equilibrium import NotConverged, Press, Settings, State
from gelforge.mechanics.indenters import Sphere
from gelforge.mechanics.laws import Ogden
from gelforge.mechanics.meshes import Block, HexMesh, Sizes, layered_block


@dataclass(frozen=True)
class Trajectory:
    """The depths [mm] that one indenter visits in turn at one position, with their phases ("load" or "unload")."""

    x_mm: float
    y_mm: float
    depths_mm: tuple[float, ...]
    phases: tuple[str, ...]

    @classmethod
    def loading(cls, planned: PlannedCell) -> Trajectory:
        return cls(planned.x_mm, planned.y_mm, planned.depths_mm, ("load",) * len(planned.depths_mm))


def simulate_cell(study: Study, laws: dict[str, Ogden], planned: PlannedCell) -> Cell:
    """Return the solved cell of a plan; laws are named by material. A cell that fails says so in its attributes."""
    by_layer = {layer.name: laws[layer.material] for layer in study.sensor.layers}
    cell = simulate_trajectory(study.sensor, study.indenter, study.mechanics, by_layer, Trajectory.loading(planned))
    identity = {"cell": planned.name, "inputs_digest": inputs_digest(study, laws, planned), "source": ""}
    return Cell(cell.arrays, cell.attributes | identity)


def inputs_digest(study: Study, laws: dict[str, Ogden], planned: PlannedCell) -> str:
    """Return the digest of everything that decides a cell's numbers: settings, laws, position, depths, sources."""
    materials = {layer.material for layer in study.sensor.layers}
    return digest(
        {
            "sensor": study.sensor.model_dump(mode="json"),
            "indenter": study.indenter.model_dump(mode="json"),
            "mechanics": study.mechanics.model_dump(mode="json"),
            "laws": {name: [laws[name].mu, laws[name].alpha] for name in materials},
            "cell": [planned.x_mm, planned.y_mm, planned.depths_mm, planned.source, planned.symmetry],
            "sources": source_digest("mechanics", "indentation"),
        }
    )


def simulate_trajectory(
    sensor: Sensor, indenter: Indenter, mechanics: Mechanics, laws: dict[str, Ogden], trajectory: Trajectory
) -> Cell:
    """Return the solution of a trajectory; laws are named by layer. What fails ends the cell, with its reason."""
    wall_clock, cpu_clock = time.perf_counter(), time.process_time()
    mesh = sensor_mesh(sensor, mechanics.mesh, trajectory.x_mm, trajectory.y_mm)
    small = mechanics.strain == "small"
    region_laws = {name: laws.get(name, laws[sensor.layers[-1].name]) for name in mesh.regions}
    body = (SmallStrainBody if small else Body)(mesh, region_laws, mechanics.bulk_to_shear)
    press = Press(body, Sphere(indenter.radius_mm), _settings(mechanics), mechanics.solver.linear_solver)
    start = press.start(trajectory.x_mm, trajectory.y_mm)
    centres = start.centre - np.outer(trajectory.depths_mm, [0.0, 0.0, 1.0])
    states: list[State] = []
    reason = ""
    try:
        states.extend(press.follow(start, centres))
    except NotConverged as failure:
        reason = str(failure)
    done = len(states)
    arrays = {"depth_mm": np.array(trajectory.depths_mm[:done])}
    arrays |= _force_arrays(mesh, states, sensor, mechanics)
    arrays |= _section_arrays(mesh, states, trajectory.y_mm)
    if mechanics.store_displacement:
        arrays |= _gel_arrays(mesh, states, [layer.name for layer in sensor.layers if layer.particle_volume_fraction > 0])
    attributes = {
        "x_mm": trajectory.x_mm,
        "y_mm": trajectory.y_mm,
        "status": "failed" if reason else "converged",
        "reason": reason,
        "last_good_depth_mm": trajectory.depths_mm[done - 1] if done else 0.0,
        "phases": list(trajectory.phases[:done]),
        "regions": list(mesh.regions),
        "code_version": gelforge.__version__,
        "settings": _settings_text(sensor, indenter, mechanics, laws),
        "linear_solver": press.solver.name,
        "degrees_of_freedom": body.pattern.size,
        "iterations": [state.iterations for state in states],
        "factorisations": [state.factorisations for state in states],
        "residual": [state.residual for state in states],
        "force_balance": [force_balance(state) for state in states],
        "moment_balance": [moment_balance(mesh, state, indenter.radius_mm, not small) for state in states],
        "energy_mJ": [state.energy for state in states],
        "smallest_J": [state.smallest_J for state in states],
        "binning_moment_shift_Nmm": _moment_shift(arrays, sensor),
        "seconds": time.perf_counter() - wall_clock,
        "cpu_seconds": time.process_time() - cpu_clock,
    }
    return Cell(arrays, attributes)


def mirror_cell(source: Cell, study: Study, laws: dict[str, Ogden], planned: PlannedCell) -> Cell:
    """Return the cell that the symmetry of the plan makes of its source, without section and gel displacement."""
    name, width, n = planned.symmetry, study.sensor.width_x_mm, study.sensor.bins.nx
    arrays = {"depth_mm": source.arrays["depth_mm"]}
    for key in ("total_force_N", "reaction_N", "node_normal_N", "node_shear_N", "node_displacement_mm"):
        arrays[key] = transform_vectors(name, source.arrays[key])
    for key in ("bin_force_N", "bin_normal_N", "bin_shear_N"):
        arrays[key] = transform_bins(name, source.arrays[key], n)
    arrays["node_xy_mm"] = transform_points(name, source.arrays["node_xy_mm"], width)
    arrays["node_area_mm2"], arrays["node_state"] = source.arrays["node_area_mm2"], source.arrays["node_state"]
    identity = {
        "cell": planned.name,
        "x_mm": planned.x_mm,
        "y_mm": planned.y_mm,
        "source": planned.source,
        "symmetry": name,
        "inputs_digest": inputs_digest(study, laws, planned),
        "source_inputs_digest": source.attributes["inputs_digest"],
    }
    return Cell(arrays, source.attributes | identity)


def sensor_mesh(sensor: Sensor, mesh: Mesh, x_mm: float, y_mm: float) -> HexMesh:
    """Return the sensor's mesh, fine around (x, y)."""
    flange = sensor.flange
    block = Block(
        width_x=sensor.width_x_mm,
        width_y=sensor.width_y_mm,
        layers=tuple((layer.name, layer.thickness_mm) for layer in sensor.layers),
        wall=sensor.wall_mm,
        flange_width=flange.width_mm if flange else 0.0,
        flange_height=flange.height_mm if flange else 0.0,
    )
    sizes = Sizes(
        near=mesh.near_mm,
        near_radius=mesh.near_radius_mm,
        far=mesh.far_mm,
        growth=mesh.growth,
        vertical_far=mesh.vertical_far_mm,
        vertical_growth=mesh.vertical_growth,
        wall_elements=mesh.wall_elements,
    )
    return layered_block(block, x_mm, y_mm, sizes)


def _settings(mechanics: Mechanics) -> Settings:
    return Settings(
        friction=mechanics.friction,
        normal_stiffness=mechanics.contact.normal_stiffness_N_per_mm3,
        tangential_stiffness=mechanics.contact.tangential_stiffness_N_per_mm3,
        force_tolerance=mechanics.solver.force_tolerance,
        gap_tolerance=mechanics.solver.gap_tolerance_mm,
        max_iterations=mechanics.solver.max_iterations,
        max_halvings=mechanics.solver.max_halvings,
        initial_normals=mechanics.contact_normals == "initial",
    )


def _settings_text(sensor: Sensor, indenter: Indenter, mechanics: Mechanics, laws: dict[str, Ogden]) -> str:
    content = {name: part.model_dump(mode="json") for name, part in [("sensor", sensor), ("indenter", indenter)]}
    content["mechanics"] = mechanics.model_dump(mode="json")
    content["laws_by_layer"] = {
        name: {"law": "ogden", "mu_MPa": law.mu, "alpha": law.alpha} for name, law in laws.items()
    }
    return json.dumps(content, sort_keys=True)


def _stack(states: list[State], name: str, shape: tuple[int, ...]) -> np.ndarray:
    return np.stack([getattr(state, name) for state in states]) if states else np.zeros((0, *shape))


def _force_arrays(mesh: HexMesh, states: list[State], sensor: Sensor, mechanics: Mechanics) -> dict[str, np.ndarray]:
    S = len(mesh.surface)
    normal, shear = _stack(states, "normal_force", (S, 3)), _stack(states, "friction_force", (S, 3))
    share = binning.hat_shares if mechanics.binning == "shape_function" else binning.node_shares
    shares_x = share(mesh.surface_x, sensor.width_x_mm, sensor.bins.nx)
    shares_y = share(mesh.surface_y, sensor.width_y_mm, sensor.bins.ny)
    bin_normal, bin_shear = (binning.bin_forces(force, shares_x, shares_y) for force in (normal, shear))
    return {
        "total_force_N": (normal + shear).sum(axis=1),
        "reaction_N": _stack(states, "reaction", (3,)),
        "bin_force_N": binning.without_dust(bin_normal + bin_shear),
        "bin_normal_N": binning.without_dust(bin_normal),
        "bin_shear_N": binning.without_dust(bin_shear),
        "node_xy_mm": mesh.X[mesh.surface, :2],
        "node_area_mm2": mesh.surface_area,
        "node_normal_N": normal,
        "node_shear_N": shear,
        "node_state": _stack(states, "contact_state", (S,)).astype(np.int8),
        "node_displacement_mm": _displacement(states, mesh.surface),
    }


def _displacement(states: list[State], nodes: np.ndarray) -> np.ndarray:
    """Return the displacement (D, n, 3) of some nodes [mm] as float32: 1e-7 mm is beyond any camera."""
    return np.array([state.u[nodes] for state in states], dtype=np.float32).reshape(len(states), len(nodes), 3)


def _section_arrays(mesh: HexMesh, states: list[State], y_mm: float) -> dict[str, np.ndarray]:
    """Return the mesh plane y = const nearest the cell, for drawing."""
    lines = mesh.surface_y[:-1]
    plane = lines[np.argmin(np.abs(lines - y_mm))]
    face = mesh.hexahedra[:, [0, 1, 5, 4]]
    on_plane = np.isclose(mesh.X[face, 1], plane, atol=1e-9).all(axis=1)
    nodes, quads = np.unique(face[on_plane], return_inverse=True)
    return {
        "section_node_mm": mesh.X[nodes],
        "section_quad": quads.reshape(-1, 4).astype(np.int32),
        "section_region": mesh.region[on_plane],
        "section_displacement_mm": _displacement(states, nodes),
    }


def _gel_arrays(mesh: HexMesh, states: list[State], layers: list[str]) -> dict[str, np.ndarray]:
    """Return mesh and displacement of the layers that carry particles."""
    chosen = np.isin(mesh.region, [mesh.regions.index(name) for name in layers])
    nodes, hexahedra = np.unique(mesh.hexahedra[chosen], return_inverse=True)
    return {
        "gel_node_mm": mesh.X[nodes],
        "gel_hex": hexahedra.reshape(-1, 8).astype(np.int32),
        "gel_displacement_mm": _displacement(states, nodes),
    }


def _moment_shift(arrays: dict[str, np.ndarray], sensor: Sensor) -> list[float]:
    """Return per depth how much the moment about the sensor's centre differs between bins and nodes [N mm]."""
    bins: Bins = sensor.bins
    middle = np.array([sensor.width_x_mm, sensor.width_y_mm]) / 2
    centres = binning.bin_centres(sensor.width_x_mm, sensor.width_y_mm, bins.nx, bins.ny) - middle
    nodes = arrays["node_xy_mm"] - middle

    def moment(arms, forces):  # of forces in the plane z = 0
        x, y = arms[:, 0], arms[:, 1]
        fx, fy, fz = np.moveaxis(forces, -1, 0)
        return np.stack([(y * fz).sum(-1), (-x * fz).sum(-1), (x * fy - y * fx).sum(-1)], axis=-1)

    shift = moment(centres, arrays["bin_force_N"]) - moment(nodes, arrays["node_normal_N"] + arrays["node_shear_N"])
    return [float(value) for value in np.linalg.norm(shift, axis=-1)]
