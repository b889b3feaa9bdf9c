"""One cell: the finite-element solution of one position with all its depths."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass

import numpy as np

import gelforge
from gelforge.config import Indenter, Mechanics, Mesh, Sensor, Study
from gelforge.indentation.cell_arrays import force_arrays, gel_arrays, moment_shift, section_arrays
from gelforge.indentation.cell_file import Cell
from gelforge.indentation.inputs import inputs_digest
from gelforge.indentation.plan import PlannedCell
from gelforge.indentation.stretch_range import Outside, element_stretches, stretch_ranges
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


def simulate_cell(
    study: Study, laws: dict[str, Ogden], planned: PlannedCell, outside: dict[str, Outside] | None = None
) -> Cell:
    """Return the solved cell of a plan; laws are named by material. A cell that fails says so in its attributes.

    outside: by material, whether principal stretches leave the range in which its law was tested.
    """
    layers = study.sensor.layers
    by_layer = {layer.name: laws[layer.material] for layer in layers}
    tested = {layer.name: (outside or {}).get(layer.material) for layer in layers}
    trajectory = Trajectory.loading(planned)
    cell = simulate_trajectory(study.sensor, study.indenter, study.mechanics, by_layer, trajectory, tested)
    identity = {"cell": planned.name, "inputs_digest": inputs_digest(study, laws, planned), "source": ""}
    return Cell(cell.arrays, cell.attributes | identity)


def simulate_trajectory(
    sensor: Sensor,
    indenter: Indenter,
    mechanics: Mechanics,
    laws: dict[str, Ogden],
    trajectory: Trajectory,
    outside: dict[str, Outside | None] | None = None,
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
    arrays |= force_arrays(mesh, states, sensor, mechanics)
    arrays |= section_arrays(mesh, states, trajectory.y_mm)
    if mechanics.store_displacement:
        arrays |= gel_arrays(
            mesh, states, [layer.name for layer in sensor.layers if layer.particle_volume_fraction > 0]
        )
    top = sensor.layers[-1].name  # its material makes the wall and the flange too
    tested = [(outside or {}).get(name if name in laws else top) for name in mesh.regions]
    stretches = [element_stretches(body.gradient, body.weight, mesh.hexahedra, state.u) for state in states]
    attributes = stretch_ranges(stretches, body.element_volume, mesh.region, tested) | {
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
        "binning_moment_shift_Nmm": moment_shift(arrays, sensor),
        "seconds": time.perf_counter() - wall_clock,
        "cpu_seconds": time.process_time() - cpu_clock,
    }
    return Cell(arrays, attributes)


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
        growth=mesh.growth,
        far=mesh.far_mm,
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
    content = {
        name: part.model_dump(mode="json") for name, part in [("sensor", sensor), ("indenter", indenter)]
    }
    content["mechanics"] = mechanics.model_dump(mode="json")
    content["laws_by_layer"] = {
        name: {"law": "ogden", "mu_MPa": law.mu, "alpha": law.alpha} for name, law in laws.items()
    }
    return json.dumps(content, sort_keys=True)
