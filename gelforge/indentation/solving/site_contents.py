"""What the file of a solved site holds: arrays over the states of its path, and attributes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import gelforge
from gelforge.config import Indenter, Mechanics, Sensor
from gelforge.indentation.cells.cell_arrays import force_arrays, gel_arrays, moment_shift, section_arrays
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.planning.touching import touched_parts
from gelforge.indentation.solving.inputs import described
from gelforge.indentation.solving.model import Model
from gelforge.indentation.solving.stretch_range import (
    Outside,
    element_stretches,
    stretch_ranges,
    unstable_shares,
)
from gelforge.mechanics.contact.state import State
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.meshes.elements import mean_gradient
from gelforge.mechanics.sensitivities.direct import Followed
from gelforge.mechanics.solving.balances import force_balance, moment_balance
from gelforge.mechanics.solving.equilibrium import Press


@dataclass(frozen=True)
class Solution:
    """A model, what has solved it, and the path that was gone."""

    model: Model
    press: Press
    followed: Followed

    @property
    def states(self) -> list[State]:
        """Those that were reached, in the order of the path."""
        return self.followed.states


def site_arrays(
    solution: Solution, sensor: Sensor, mechanics: Mechanics, trajectory: Trajectory
) -> dict[str, np.ndarray]:
    """Return the arrays of a site, by name; the first axis is that of the states reached."""
    mesh, states = solution.model.mesh, solution.states
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
    return arrays


def site_attributes(
    solution: Solution,
    arrays: dict[str, np.ndarray],
    sensor: Sensor,
    mechanics: Mechanics,
    trajectory: Trajectory,
    reason: str,
) -> dict[str, Any]:
    """Return where a site lies, whether it converged and how its states were found; reason: why the path ended early."""
    model, press, states = solution.model, solution.press, solution.states
    done, least_force = len(states), press.contact.least_force
    finite, size = mechanics.strain != "small", model.shape.size
    return {
        "x_mm": trajectory.x_mm,
        "y_mm": trajectory.y_mm,
        "status": "failed" if reason else "converged",
        "reason": reason,
        "last_good_depth_mm": trajectory.depths_mm[done - 1] if done else 0.0,
        "phases": list(trajectory.phases[:done]),
        "touched_parts": touched_parts(model.shape, model.mesh, states),
        "side_contact": [bool(force.any()) for force in arrays["side_force_N"]],
        "regions": list(model.mesh.regions),
        "code_version": gelforge.__version__,
        "linear_solver": press.corrections.solver.name,
        "degrees_of_freedom": model.body.pattern.size,
        "iterations": [state.iterations for state in states],
        "factorisations": [state.factorisations for state in states],
        "residual": [state.residual for state in states],
        "force_balance": [force_balance(state, least_force) for state in states],
        "moment_balance": [moment_balance(model.mesh, state, size, finite, least_force) for state in states],
        "energy_mJ": [state.energy for state in states],
        "smallest_J": [state.smallest_J for state in states],
        "binning_moment_shift_Nmm": moment_shift(arrays, sensor),
    }


def stretch_attributes(
    solution: Solution, mechanics: Mechanics, tested: Sequence[Outside | None]
) -> dict[str, np.ndarray]:
    """Return how far elements are stretched; tested: by region of the mesh, whether that leaves its law's tested range."""
    body, mesh = solution.model.body, solution.model.mesh
    gradient, rest = mean_gradient(body.gradient, body.weight), body.rest[mesh.region]
    stretches = [element_stretches(gradient, mesh.elements, state.u, rest) for state in solution.states]
    used = [None if mechanics.strain == "small" else body.laws[name] for name in mesh.regions]
    ranges = stretch_ranges(stretches, body.element_volume, mesh.region, tested)
    return ranges | unstable_shares(stretches, body.element_volume, mesh.region, used)


def settings_text(
    sensor: Sensor, indenter: Indenter, mechanics: Mechanics, laws: dict[str, PrincipalLaw]
) -> str:
    """Return everything that decides a site's solution in addition to its path, as JSON; laws by layer."""
    by_layer = {name: law.description() for name, law in laws.items()}
    return json.dumps(described(sensor, indenter, mechanics) | {"laws_by_layer": by_layer}, sort_keys=True)
