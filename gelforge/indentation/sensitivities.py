"""How a cell's forces follow the effects that the finite elements know: derivatives at amount zero.

Effects that leave mesh and path alone are neighbouring presses beside one base run (mechanics.sensitivity); for those that
change the mesh or turn every press into a path of its own, two solutions are subtracted.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gelforge.config import ConfigError, Study
from gelforge.indentation.binning import bin_forces, bin_shares
from gelforge.indentation.cell_file import Cell
from gelforge.indentation.effects.catalogue import CATALOGUE
from gelforge.indentation.plan import PlannedCell
from gelforge.indentation.simulate import Model, model_of, simulate_cell
from gelforge.indentation.trajectory import Trajectory
from gelforge.mechanics.equilibrium import Press
from gelforge.mechanics.laws import PrincipalLaw
from gelforge.mechanics.sensitivity import Neighbour, follow_beside

AMOUNT = 1e-2  # of an effect's plausible width


@dataclass(frozen=True)
class Derivative:
    """d force / d amount of one effect."""

    name: str
    unit: str  # of the amount
    total: np.ndarray  # (D, 3) [N/unit]
    bins: np.ndarray  # (D, B, 3) [N/unit]
    seconds: float  # wall seconds beyond the base run


def derivable(name: str) -> bool:
    """Return whether an effect has a derivative at zero: not one that is on or off, or seen on the way up only."""
    effect = CATALOGUE[name]
    return not (effect.switch or effect.unloading)


def sensitivities(
    study: Study, laws: dict[str, PrincipalLaw], planned: PlannedCell, names: Sequence[str]
) -> list[Derivative]:
    """Return the derivatives of a cell's forces with respect to the named effects of the catalogue, in their order.

    Raises ConfigError for a name that is not there or has no derivative, NotConverged as the solver does.
    """
    unknown = [name for name in names if name not in CATALOGUE or not derivable(name)]
    if unknown:
        known = sorted(name for name in CATALOGUE if derivable(name))
        raise ConfigError(f"mechanics.sensitivities: {unknown} have no derivative; choose among {known}")
    # One cell is solved here; whether its images could be mirrored with the effect does not matter.
    study = study.model_copy(update={"plan": study.plan.model_copy(update={"symmetry": "none"})})
    base = _model(study, laws, planned)
    neighbours, found = {}, {}
    for name in names:
        effect, clock = CATALOGUE[name], time.perf_counter()
        amount = AMOUNT * effect.width
        varied = None
        if not (effect.history or effect.mesh_changes):
            varied = _model(effect(study, amount), laws, planned, base)
        if varied is None or not _beside_it(base, varied):
            found[name] = _subtracted(study, laws, planned, name, amount, clock)
        else:
            neighbours[name] = (varied, amount)
    found |= _beside(study, base, neighbours)
    return [found[name] for name in names]


def _model(study: Study, laws, planned: PlannedCell, base: Model | None = None) -> Model:
    by_layer = {layer.name: laws[layer.material] for layer in study.sensor.layers}
    trajectory = Trajectory.of(planned, study.plan.approach)
    pattern = base.body.pattern if base else None
    return model_of(study.sensor, study.indenter, study.mechanics, by_layer, trajectory, pattern)


def _beside_it(base: Model, varied: Model) -> bool:
    """Return whether a varied model can be followed beside the base: same elements, no balance to find first."""
    yields = base.yielding is not None or varied.yielding is not None
    return not yields and varied.body.at_rest and np.array_equal(base.mesh.elements, varied.mesh.elements)


def _beside(study: Study, base: Model, varied: dict[str, tuple[Model, float]]) -> dict[str, Derivative]:
    if not varied:
        return {}
    press = Press(base.body, base.shape, base.settings, study.mechanics.solver.linear_solver)
    near = [
        Neighbour(press, model.body, model.shape, model.settings, model.start, model.centres)
        for model, _ in varied.values()
    ]
    slopes: dict[str, list] = {name: [] for name in varied}
    start = press.start_at(base.start)
    for state, states in follow_beside(press, start, base.centres, near):
        own = state.normal_force + state.friction_force
        for (name, (_, amount)), beside in zip(varied.items(), states):
            slopes[name].append((beside.normal_force + beside.friction_force - own) / amount)
    shares = bin_shares(base.mesh, study.sensor, study.mechanics.binning)
    seconds = {name: one.seconds for name, one in zip(varied, near)}
    return {
        name: Derivative(
            name,
            CATALOGUE[name].unit,
            np.sum(nodal, axis=1),
            bin_forces(np.array(nodal), shares),
            seconds[name],
        )
        for name, nodal in slopes.items()
    }


def _subtracted(study: Study, laws, planned, name: str, amount: float, clock: float) -> Derivative:
    effect = CATALOGUE[name]
    with_effect, without = (simulate_cell(effect(study, a), laws, planned) for a in (amount, 0.0))
    total, bins = (
        (with_effect.arrays[array] - without.arrays[array]) / amount
        for array in ("total_force_N", "bin_force_N")
    )
    return Derivative(name, effect.unit, total, bins, time.perf_counter() - clock)


def with_sensitivities(cell: Cell, derivatives: Sequence[Derivative]) -> Cell:
    """Return a cell with derivatives stored in the order of the attribute sensitivity_names."""
    arrays = {
        "sensitivity_total": np.array([d.total for d in derivatives]),
        "sensitivity_bin": np.array([d.bins for d in derivatives], np.float32),
    }
    attributes = {
        "sensitivity_names": [d.name for d in derivatives],
        "sensitivity_units": [f"N per {d.unit}" for d in derivatives],
        "sensitivity_seconds": [d.seconds for d in derivatives],
    }
    return Cell(cell.arrays | arrays, cell.attributes | attributes)
