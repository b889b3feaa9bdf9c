"""How a site's forces, and the gel's displacement, follow the effects that the finite elements know, at value zero.

Effects that leave the elements and the kind of path alone are differentiated along one base run, all together
(mechanics.sensitivities.direct); an indentation at another place takes the touched part of the mesh along. For effects that
bring another mesh or turn every indentation into a path of its own, and where the base remembers or yields, two solutions
are subtracted.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gelforge.config import ConfigError, Study
from gelforge.files import digest
from gelforge.indentation.cells.binning import bin_forces, bin_shares
from gelforge.indentation.cells.cell_arrays import gel_arrays, gel_elements
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.effects.catalogue import CATALOGUE
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.solving.inputs import model_inputs
from gelforge.indentation.solving.model import Model, model_of
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.indentation.solving.site_contents import Solution
from gelforge.mechanics.contact.state import State
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.sensitivities.direct import Varied, follow_with_slopes, slopes_along
from gelforge.mechanics.solving.equilibrium import NotConverged, Press
from gelforge.progress import tracked

# Derivatives against differences of full solutions (tests/indentation/test_stored_sensitivities.py):
# Of what carries nodes per unit, by which they are moved to see how their bins share the forces
LITTLE_WAY = 1e-3


@dataclass(frozen=True)
class Variation:
    """A study close to another one: what a derivative is taken along."""

    study: Study
    laws: Mapping[str, PrincipalLaw]  # by material
    amount: float  # by which it differs, in the derivative's unit
    alone: bool = False  # solved by itself, not along the base: its mesh or its paths are others
    without: Study | None = None  # what an `alone` one is compared with; None: the base
    # An `alone` one, in place of this where it has no derivative along the base
    instead: Variation | None = None
    # Of how the indenter's path differs, at each step; None: all of it
    share: tuple[float, ...] | None = None

    @cached_property
    def inputs(self) -> str:
        """The digest of all that decides the derivative in addition to the run that it belongs to."""
        without = self.without and model_inputs(self.without, self.laws)
        parts = [model_inputs(self.study, self.laws), self.amount, self.alone, without, self.share]
        return digest([*parts, self.instead and self.instead.inputs])


@dataclass(frozen=True)
class Derivative:
    """d force / d amount along a variation, and d displacement / d amount where the study stores displacements."""

    total: np.ndarray  # (D, 3) [N/unit]
    bins: np.ndarray  # (D, B, 3) [N/unit]
    seconds: float  # wall seconds beyond the base run
    gel: np.ndarray | None = None  # (D, G, 3) [mm/unit], of the nodes of gel_displacement_mm


def derivable(name: str) -> bool:
    """Return whether an effect has a derivative at zero: not one that is on or off.

    Parameters
    ----------
    name : str
        A key of CATALOGUE.

    Returns
    -------
    bool
        False for a binary effect.
    """
    return not CATALOGUE[name].binary


def sensitivities(
    study: Study,
    laws: dict[str, PrincipalLaw],
    planned: PlannedCell,
    names: Sequence[str],
    solution: Solution | None = None,
) -> dict[str, Derivative]:
    """Return the derivatives of a site's forces with respect to the named effects of the catalogue, in their order.

    solution: see derivatives. Raises ConfigError as variations_of, NotConverged as the solver does.
    """
    return derivatives(study, laws, planned, variations_of(study, laws, names), solution)[1]


def variations_of(study: Study, laws: dict[str, PrincipalLaw], names: Sequence[str]) -> dict[str, Variation]:
    """Return a small value of each named effect of the catalogue.

    Raises ConfigError for a name that is not there, has no derivative, or is of no meaning for this study.
    """
    unknown = [name for name in names if name not in CATALOGUE or not derivable(name)]
    if unknown:
        known = sorted(name for name in CATALOGUE if derivable(name))
        raise ConfigError(f"mechanics.sensitivities: {unknown} have no derivative; choose among {known}")
    study, variations = unmirrored(study), {}
    for name in names:
        effect = CATALOGUE[name]
        amount = effect.step * effect.width
        alone = effect.history or effect.mesh_changes
        try:
            without = effect(study, 0.0) if alone else None
            variations[name] = Variation(effect(study, amount), laws, amount, alone, without)
        except ConfigError as error:
            raise ConfigError(
                f"mechanics.sensitivities: {name} does not apply to this study ({error}); leave it out"
            ) from None
    return variations


def derivatives(
    study: Study,
    laws: Mapping[str, PrincipalLaw],
    planned: PlannedCell,
    variations: Mapping[str, Variation],
    solution: Solution | None = None,
) -> tuple[Cell, dict[str, Derivative]]:
    """Return a site's forces with their derivatives along variations of the study.

    Parameters
    ----------
    study : Study
        The study as it is.
    laws : mapping of str to PrincipalLaw
        By material [MPa].
    planned : PlannedCell
        The site.
    variations : mapping of str to Variation
        Changed study, models and amount, by name.
    solution : Solution, optional
        The site's own, to its end. Without it, or where it is one in time, the site is solved anew.

    Returns
    -------
    Cell
        Forces [N], and the displacement of the gel if the study stores it.
    dict of str to Derivative
        By variation, in their order, per unit of its amount.

    Raises
    ------
    NotConverged
        Where a depth was not reached.
    """
    study = unmirrored(study)
    if solution and not solution.followed.steps:
        solution = None
    base = solution.model if solution else _model(study, laws, planned)
    along, others = {}, []
    for name, variation in variations.items():
        varied = None
        if not variation.alone:
            varied = _model(unmirrored(variation.study), variation.laws, planned, base)
            if variation.share is not None:
                away = varied.centres - base.centres
                varied = replace(varied, centres=base.centres + np.array(variation.share)[:, None] * away)
        if varied is None or not _along_it(base, varied):
            others.append(name)
        else:
            along[name] = (varied, variation.amount)
    # A residual stretch has to find its balance first, as simulate_cell lets it.
    if base.yielding is None and not base.body.remembers and base.body.at_rest:
        cell, slopes = _along(study, base, along, solution)
    else:
        cell, slopes = _solved(study, laws, planned), {}
    for name in others:
        slopes[name] = subtracted(cell, laws, planned, variations[name].instead or variations[name])
    return cell, {name: slopes[name] for name in variations}


def unmirrored(study: Study) -> Study:
    """Return the study for one site by itself, for which it does not matter whether an effect allows mirrored sites.

    Only `d4` asks for symmetry and is refused where it does not hold; `auto` then mirrors nothing.

    Parameters
    ----------
    study : Study
        Stays as it is.

    Returns
    -------
    Study
        With `plan.symmetry: none` in place of `d4`.
    """
    return study.with_values({"plan": {"symmetry": "none"}}) if study.plan.symmetry == "d4" else study


def _model(
    study: Study, laws: Mapping[str, PrincipalLaw], planned: PlannedCell, base: Model | None = None
) -> Model:
    trajectory, by_layer = Trajectory.of(planned, study.plan.approach), study.sensor.by_layer(laws)
    return model_of(study.sensor, study.indenter, study.mechanics, by_layer, trajectory, base)


def _along_it(base: Model, varied: Model) -> bool:
    """Return whether a varied model can be differentiated along the base: same elements, no memory, nothing that yields.

    Elsewhere, the mesh must have come along: an indenter that goes over its nodes changes the force from node to node.
    """
    yields = base.yielding is not None or varied.yielding is not None
    same = type(base.body) is type(varied.body) and np.array_equal(base.mesh.elements, varied.mesh.elements)
    there = np.array_equal(base.place, varied.place) or varied.drawn is not base.drawn
    return same and there and not yields and not base.body.remembers and base.body.at_rest


def _along(
    study: Study, base: Model, varied: dict[str, tuple[Model, float]], solution: Solution | None
) -> tuple[Cell, dict[str, Derivative]]:
    others = [
        Varied(model.body, model.shape, model.settings, model.start, model.centres, amount)
        for model, amount in varied.values()
    ]
    stored = study.mechanics.store_displacement
    gel = np.unique(gel_elements(base.mesh, study.sensor)) if stored else None
    carried = [_carried(base, model, amount) for model, amount in varied.values()]
    slopes, motions, reached, forces = [], [], [], []
    seconds: list[float] = []
    if solution:
        states = slopes_along(solution.press, solution.followed, others, seconds, not stored)
    else:
        press = Press(base.body, base.shape, base.settings, study.mechanics.solver.linear_solver)
        start = press.start_at(base.start)
        states = follow_with_slopes(press, start, base.centres, others, seconds, not stored)
    for state, along in tracked(states, "steps of the indenter, with derivatives", len(base.centres)):
        forces.append(state.normal_force + state.friction_force)
        slopes.append(along.force)
        if stored:
            reached.append(state)
            motions.append([_at_its_place(base, state, *one)[gel] for one in zip(along.u, carried)])
    shares = bin_shares(base.mesh, study.sensor, study.mechanics.binning)
    arrays = {"total_force_N": np.sum(forces, axis=1), "bin_force_N": bin_forces(np.array(forces), shares)}
    if stored:
        arrays |= gel_arrays(base.mesh, reached, study.sensor)
    derivatives = {}
    for k, name in enumerate(varied):
        nodal = np.array([step[k] for step in slopes])
        motion = np.array([step[k] for step in motions], np.float32) if stored else None
        bins = bin_forces(nodal, shares)
        if (away := carried[k]) is not None:  # the same forces on nodes that lie elsewhere among the bins
            mesh = replace(base.mesh, X=base.mesh.X + LITTLE_WAY * away)
            there = bin_shares(mesh, study.sensor, study.mechanics.binning)
            bins = bins + bin_forces(np.array(forces), (there - shares) / LITTLE_WAY)
        derivatives[name] = Derivative(nodal.sum(axis=1), bins, sum(seconds) / len(varied), motion)
    return Cell(arrays, {}), derivatives


def _carried(base: Model, varied: Model, amount: float) -> np.ndarray | None:
    """Return how nodes (N, 3) [mm/unit] are carried to an indentation at another place; None where it is at the base's."""
    return None if varied.drawn is base.drawn else (varied.drawn.X - base.drawn.X) / amount


def _at_its_place(base: Model, state: State, slope: np.ndarray, carried: np.ndarray | None) -> np.ndarray:
    """Return d displacement / d amount (N, 3) where nodes were, of that of nodes (N, 3) which are carried along."""
    if carried is None:
        return slope
    elements, N = base.mesh.elements, len(base.mesh.X)
    gradient = np.einsum("eai,eqaj->eij", state.u[elements], base.body.gradient) / base.body.gradient.shape[1]
    nodes, A = elements.ravel(), elements.shape[1]
    sums = np.stack([np.bincount(nodes, np.repeat(g, A), N) for g in gradient.reshape(-1, 9).T])
    at_nodes = (sums / np.bincount(nodes, minlength=N)).T.reshape(N, 3, 3)
    return slope - np.einsum("nij,nj->ni", at_nodes, carried)


def subtracted(
    base: Cell, laws: Mapping[str, PrincipalLaw], planned: PlannedCell, variation: Variation
) -> Derivative:
    """Return a derivative as the difference of two solutions: the varied one less the base, or less what it is to be
    compared with.

    Parameters
    ----------
    base : Cell
        The solved site.
    laws : mapping of str to PrincipalLaw
        By material [MPa], of the base.
    planned : PlannedCell
        The site.
    variation : Variation
        Changed study, models and amount.

    Returns
    -------
    Derivative
        Per unit of the variation's amount.

    Raises
    ------
    NotConverged
        Where a depth was not reached.
    ConfigError
        Where one solution has other gel nodes than the base.
    """
    clock = time.perf_counter()
    with_it = _solved(variation.study, variation.laws, planned)
    without = _solved(variation.without, laws, planned) if variation.without else base

    def slope(array: str) -> np.ndarray:
        return (with_it.arrays[array] - without.arrays[array]) / variation.amount

    gel = None
    if "gel_displacement_mm" in base.arrays:
        for cell in (with_it, without):
            nodes = cell.arrays.get("gel_node_mm", np.empty((0, 3)))
            if len(nodes) != len(base.arrays["gel_node_mm"]):
                raise ConfigError(
                    f"no derivative of the gel's displacement: {len(nodes)} gel nodes with the effect, "
                    f"{len(base.arrays['gel_node_mm'])} without; leave it or store_displacement out"
                )
        gel = slope("gel_displacement_mm")
    return Derivative(slope("total_force_N"), slope("bin_force_N"), time.perf_counter() - clock, gel)


def _solved(study: Study, laws, planned: PlannedCell) -> Cell:
    cell = simulate_cell(study, laws, planned)
    if not cell.converged:
        raise NotConverged(cell.attributes["reason"])
    return cell


def with_sensitivities(cell: Cell, derivatives: Mapping[str, Derivative]) -> Cell:
    """Return a site with derivatives by effect stored in the order of the attribute sensitivity_names."""
    arrays = {
        "sensitivity_total": np.array([d.total for d in derivatives.values()]),
        "sensitivity_bin": np.array([d.bins for d in derivatives.values()], np.float32),
    }
    if "gel_displacement_mm" in cell.arrays:
        gel = np.array([d.gel for d in derivatives.values()], np.float32)
        arrays["sensitivity_gel_displacement"] = gel
    attributes = {
        "sensitivity_names": list(derivatives),
        "sensitivity_units": [f"N per {CATALOGUE[name].unit}" for name in derivatives],
        "sensitivity_seconds": [d.seconds for d in derivatives.values()],
    }
    return Cell(cell.arrays | arrays, cell.attributes | attributes)
