"""The finite elements behind a verdict: base forces at every reading, how they follow each effect, and forces with effects.

Base forces are those of the study's own mesh, during loading. Derivatives, unloading and everything with an effect are
solved on a coarser mesh (mismatch.coarser), and only their difference from the base on that same mesh is used, times what
the finer mesh makes of the pressing force: the mesh's error of a change is a small part of a small change. Most changes
are solved during loading, and unloading changes as the pressing force does from loading to unloading. All solutions
are kept by the digest of what decides them, and an indentation stands for its mirror images where the sensor has them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.error_bars import COARSER
from gelforge.indentation.solving.sensitivities import unmirrored
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.fem.asked import Asked, asked_of, carried_derivatives, observed_by, reaches
from gelforge.mismatch.fem.base_bars import PART, base_bars, known_resolution
from gelforge.mismatch.fem.solutions import (
    Solver,
    SolverFailed,
    Unsolved,
    fine,
    follow,
    in_time,
    own_cell,
    unloading_key,
)
from gelforge.mismatch.model.effect import Context, Curves, Effect, Hyperparameters
from gelforge.mismatch.model.images_of_presses import (
    carried,
    image_of,
    solved_for_all,
)
from gelforge.mismatch.readings.observations import Observations
from gelforge.mismatch.readings.runs import Runs, runs_of, timed_runs_of

Choice = tuple[Effect, Hyperparameters, np.ndarray]


@dataclass(frozen=True)
class Base:
    """Base forces at the readings and what they follow."""

    context: Context
    ways: tuple[PlannedCell, ...]  # loadings, per site
    coarse: np.ndarray  # (R, 3) [N] base forces on the coarser mesh
    loading: np.ndarray  # (R, 3) [N] the same, during unloading those of loading at the same depth
    finer: np.ndarray  # (R, 1) by which changes on the coarser mesh are multiplied
    law: np.ndarray  # (R, 3, q) [N] per standard deviation of each uncertain direction of the laws
    floor: np.ndarray  # (R, 3) [N] discretisation error, one standard deviation
    solution: np.ndarray  # (R,) number of the indentation that was solved for each, whose error all share
    failed: Mapping[str, str]  # derivatives that could not be had, and why
    # (3, 3) by which a change of the force on the sensor is read: none, unless the force sensor's errors are known
    sensor: np.ndarray = field(default_factory=lambda: np.eye(3))


def base_of(solver: Solver, observations: Observations, effects: Iterable[Effect]) -> Base:
    """Return the base of observations with the derivatives of all effects that need the solver.

    Derivatives and the mesh's error are those of the study without what remembers.

    Parameters
    ----------
    solver : Solver
        Of the study.
    observations : Observations
        R readings.
    effects : iterable of Effect
        That could be there.

    Returns
    -------
    Base
        Forces (R, 3) [N] and what they follow.

    Raises
    ------
    SolverFailed
        Where base indentations do not converge (nominal.py leaves those out).
    """
    remembering, solver = solver, forgetting(solver)
    runs = runs_of(observations)
    ways = runs.ways
    depths = tuple(np.array(way.depths_mm) for way in ways)
    curves = Curves(depths, tuple(_base_curves(solver, ways)))
    blank = Context(solver.study, observations, np.zeros_like(observations.force), curves, {}, {})
    asked = list(asked_of(solver, effects, blank))
    by_way = _followed(solver, ways, asked, runs.unloadings)
    on_coarse = Curves(depths, tuple(one["base"] for one in by_way))
    coarse = _as_it_was(remembering, observations, _with_unloading(runs, by_way))
    loading = runs.loading(on_coarse.values)
    loading = _as_it_was(remembering, observations, loading, unloading=False)
    force = coarse + (blank.on_readings(curves) - blank.on_readings(on_coarse))
    finer = _share(force, coarse)
    of_loading = finer * _share(coarse, loading)
    finer_along = [_share(values, finer_mesh) for values, finer_mesh in zip(curves.values, on_coarse.values)]
    failed: dict[str, str] = {}
    at_readings, along = {}, {}
    for key in [one.key for one in asked]:
        if missing := [str(one[f"reason {key}"]) for one in by_way if f"reason {key}" in one]:
            failed[key] = missing[0]
            continue
        down = [one.get(key, np.zeros_like(one["base"])) for one in by_way]
        at_readings[key] = of_loading * runs.loading(down)
        along[key] = Curves(depths, tuple(f * finer_mesh for f, finer_mesh in zip(finer_along, down)))
    laws = [key for key in by_way[0] if key.startswith("law ")]
    law = [of_loading * runs.loading([one[key] for one in by_way]) for key in laws]
    context = Context(remembering.study, observations, force, curves, along, at_readings)
    stacked = np.stack(law, axis=-1) if law else np.zeros((*force.shape, 0))
    companion = _companion_curves(solver, ways, curves.values) or on_coarse.values
    by_site = zip(ways, curves.values, companion)
    bars = Curves(
        depths,
        tuple(
            base_bars(own, other, known_resolution(solver.study, solver.laws, way))
            for way, own, other in by_site
        ),
    )
    solution = _solved_once(solver, ways)[observations.table["site"].to_numpy()]
    return Base(context, ways, coarse, loading, finer, stacked, blank.on_readings(bars), solution, failed)


def _companion_curves(
    solver: Solver, ways: Sequence[PlannedCell], base: Sequence[np.ndarray]
) -> list[np.ndarray] | None:
    """Return the base forces (D, 3) of every loading on the mesh that shows the error of the base's.

    Where the study knows its error these are forces that differ as much as it. None where that mesh is the coarser one
    itself, or where it cannot be solved: the coarser one is farther off.
    """
    settings = solver.study.mismatch
    if settings.discretisation is not None:
        return [(1 - settings.discretisation / PART) * force for force in base]
    if settings.coarser == COARSER:
        return None
    study = solver.study.model_copy(update={"mismatch": settings.model_copy(update={"coarser": COARSER})})
    try:
        companions = _followed(replace(solver, study=study, uncertain={}), ways)
    except SolverFailed:
        return None
    return [one["base"] for one in companions]


def _solved_once(solver: Solver, ways: Sequence[PlannedCell]) -> np.ndarray:
    """Return for each loading (S,) the number of the place that stands for it and its mirror images."""
    images = [image_of(solver.study, way)[0] for way in ways]
    return np.unique([[image.x_mm, image.y_mm] for image in images], axis=0, return_inverse=True)[1].ravel()


def _base_curves(solver: Solver, ways: Sequence[PlannedCell]) -> list[np.ndarray]:
    """Return the base forces (D, 3) of every loading: the study's own site's where it is that indentation, else solved."""
    stored_forces = [own_cell(solver, way) for way in ways]
    missing = [way for way, stored in zip(ways, stored_forces) if stored is None]
    solved, symmetries = solved_for_all(
        solver.study, missing, lambda distinct: _base(solver.each(fine, [(solver, way) for way in distinct]))
    )
    others = iter([carried(total, symmetry) for total, symmetry in zip(solved, symmetries)])
    return [next(others) if stored is None else stored for stored in stored_forces]


def _followed(
    solver: Solver,
    ways: Sequence[PlannedCell],
    asked: Sequence[Asked] = (),
    unloadings: Sequence[tuple[int, PlannedCell]] = (),
) -> list[dict]:
    """Return per loading the forces (D, 3) on the coarser mesh, and all derivatives that it can show or reasons why not.

    unloadings: runs by the number of the loading from whose depths they unload, whose forces it has too. Raises
    SolverFailed.
    """
    back: dict[PlannedCell, dict[PlannedCell, None]] = {}  # by loading; a set in order
    for way, run in unloadings:
        runs_of = back.setdefault(image_of(solver.study, ways[way])[0], {})
        runs_of[image_of(solver.study, run)[0]] = None

    for one in asked:
        assert one.variation.inputs  # found once, not by every task

    def solve(distinct: list[PlannedCell]) -> list:
        tasks = [(solver, way, observed_by(asked, way), *back.get(way, ())) for way in distinct]
        return _base(solver.each(follow, tasks))

    at_images, symmetries = solved_for_all(solver.study, ways, solve)
    width = solver.study.sensor.width_x_mm
    return [carried_derivatives(*one, asked, width) for one in zip(at_images, symmetries)]


def _with_unloading(runs: Runs, by_way: Sequence[dict]) -> np.ndarray:
    """Return the forces of loadings (`_followed`) at the readings (R, 3), unloading as it was solved, where it was."""
    at_readings = runs.loading([one["base"] for one in by_way])
    for number, (way, run) in enumerate(runs.unloadings):
        if (forces := by_way[way].get(unloading_key(run))) is not None:
            rows = runs.unloading == number
            at_readings[rows] = forces[runs.back[rows]]
    return at_readings


def _base(solved: list) -> list:
    """Return solutions of the base as they are. Raises SolverFailed, with all of them, where some are Unsolved."""
    unsolved = [one for one in solved if isinstance(one, Unsolved)]
    if unsolved:
        words = "; ".join(one.words for one in unsolved)
        raise SolverFailed(f"the nominal model does not converge {words}", unsolved)
    return solved


def forgetting(solver: Solver) -> Solver:
    """Return the finite elements of the study without relaxation and softening, which its own sites have."""
    mechanics = solver.study.mechanics
    if not mechanics.effects.history.any:
        return solver
    history = mechanics.effects.history.model_copy(update={"viscoelastic": {}, "mullins": {}})
    effects = mechanics.effects.model_copy(update={"history": history})
    mechanics = mechanics.model_copy(update={"effects": effects})
    return replace(solver, study=solver.study.model_copy(update={"mechanics": mechanics}), cells=None)


def _as_it_was(
    solver: Solver, observations: Observations, at_rest: np.ndarray, unloading: bool = True
) -> np.ndarray:
    """Return the base forces (R, 3) on the coarser mesh in the time, age and warmth of the readings.

    at_rest: those at the study's own age of layers that remember nothing; a study that knows no time has no others. Raises
    SolverFailed.
    """
    effects = solver.study.mechanics.effects
    if not (effects.history.any or _feels_circumstances(solver.study)):
        return at_rest
    try:
        return _solved_with(solver, unmirrored(solver.study), observations, unloading)
    except NotConverged as failure:
        raise SolverFailed(
            f"the nominal model, followed in the time of the readings, does not converge: {failure}"
        ) from None


def _feels_circumstances(study: Study) -> bool:
    """Return whether a study's laws depend on the age or the temperature of a session."""
    circumstances = study.mechanics.effects.material.circumstances
    return bool(circumstances.ageing_per_day or circumstances.stiffening_per_K)


def _share(fine: np.ndarray, coarse: np.ndarray) -> np.ndarray:
    """Return by how much changes on the coarser mesh are to be multiplied (R, 1): as the pressing force itself."""
    known = np.abs(coarse[:, 2:]) > 0
    share = np.divide(fine[:, 2:], coarse[:, 2:], out=np.ones_like(fine[:, 2:]), where=known)
    return np.clip(share, 1 / 1.5, 1.5)  # beyond it (the unloading's last touch) the ratio says nothing


def forces_with(
    solver: Solver, base: Base, chosen: Sequence[Choice], readings: np.ndarray | None = None
) -> np.ndarray:
    """Return the forces (R, 3) [N] at readings (R,) bool with some effects, by the finite elements; nan at the others.

    Indentations are followed as a whole, whatever was chosen of them, and where the gel softens all of them: what
    remembers, or looks at the way before a reading, must not take the others for missing. What leaves the contact as it is
    and remembers nothing is solved during loading: unloading changes by the same share at the same depth. Effects that are
    not solved act on the forces that result. Raises NotConverged.
    """
    context = base.context
    press = context.observations.table["press"].to_numpy()
    rows = np.ones(len(press), bool) if readings is None else readings
    switched_on = [c for c in chosen if c[0].solved and np.any(c[2])]
    softens = _with(solver.study, switched_on).mechanics.effects.history.softens
    whole = np.isin(press, press[rows]) | softens
    part = context.observations.chosen(whole)
    changes = np.zeros_like(context.force[whole])
    for observable, there in _by_observable_parts(part, switched_on):
        study = _with(solver.study, observable)
        unloading = _changes_unloading(solver.study, study)
        solved = _solved_with(solver, study, part.chosen(there), unloading)
        before, more = (base.coarse, 1.0) if unloading else (base.loading, _share(base.coarse, base.loading))
        changes[there] = (base.finer * more)[whole][there] * (solved - before[whole][there])
    force = context.force.copy()
    force[whole] += changes @ base.sensor.T
    return np.where(rows[:, None], read_with(base, chosen, force), np.nan)


def _changes_unloading(study: Study, other: Study) -> bool:
    """Return whether another study unloads otherwise than by the share of the force that its loading changes by."""
    one, two = study.mechanics, other.mechanics
    return two.effects.history.any or (one.friction, one.contact) != (two.friction, two.contact)


def read_with(base: Base, chosen: Sequence[Choice], force: np.ndarray) -> np.ndarray:
    """Return forces (R, 3) [N] as those effects read them that are not solved."""
    context = replace(base.context, force=force)
    for effect, hyperparameters, theta in chosen:
        if not effect.solved and effect.to_forces is not None:
            force = effect.to_forces(context, hyperparameters, force, tuple(theta))
    return force


def _with(study: Study, chosen: Sequence[Choice]) -> Study:
    """Return the study, without mirror images, with some effects."""
    study = unmirrored(study)
    for effect, hyperparameters, theta in chosen:
        if effect.to_study is not None:
            study = effect.to_study(study, hyperparameters, tuple(theta))
    return study


def _by_observable_parts(
    observations: Observations, chosen: Sequence[Choice]
) -> Iterator[tuple[list[Choice], np.ndarray]]:
    """Yield effects with the readings (R,) bool that feel just these: what has a place does not reach all sites.

    Where something remembers, all indentations stay together: each finds what those before it have left.
    """
    site = observations.table["site"].to_numpy()
    if any(effect.history for effect, *_ in chosen):
        yield list(chosen), np.ones(len(site), bool)
        return
    feels = {s: tuple(reaches(at, *observations.sites[s]) for _, at, _ in chosen) for s in np.unique(site)}
    for observable in dict.fromkeys(feels.values()):
        if any(observable):
            own = [one for one, reached in zip(chosen, observable) if reached]
            yield own, np.isin(site, [s for s in feels if feels[s] == observable])


def _solved_with(solver: Solver, study: Study, observations: Observations, unloading: bool) -> np.ndarray:
    """Return the forces (R, 3) at all readings on the coarser mesh with a study's effects, sessions as they were.

    unloading: False: of readings during unloading those of loading at the same depth, where nothing remembers.
    """
    table, force = observations.table, np.empty_like(observations.force)
    stands = ["age_days", "temperature_C"]
    if not _feels_circumstances(study):
        return _coarse_forces(solver, study, observations, unloading)
    for _, rows in table.groupby(stands, dropna=False).indices.items():
        chosen = np.isin(np.arange(len(table)), rows)
        stated = table.loc[chosen, stands].iloc[0].dropna().astype(float).to_dict()
        there = with_keys(study, material={"circumstances": stated})
        force[chosen] = _coarse_forces(solver, there, observations.chosen(chosen), unloading)
    return force


def _coarse_forces(solver: Solver, study: Study, observations: Observations, unloading: bool) -> np.ndarray:
    own = replace(solver, study=study, uncertain={})
    history = study.mechanics.effects.history
    if not history.any:
        runs = runs_of(observations)
        try:
            followed = _followed(own, runs.ways, unloadings=runs.unloadings if unloading else ())
        except SolverFailed as failure:
            raise NotConverged("; ".join(one.reason for one in failure.presses)) from None
        return _with_unloading(runs, followed)
    paths = timed_runs_of(observations, history.timing.step_mm, history.softens)
    if history.softens:
        return paths.at_readings(_solved([in_time((own, paths.trajectories))])[0])
    solved, symmetries = solved_for_all(
        study, paths.trajectories, lambda distinct: _solved(own.each(in_time, [(own, [p]) for p in distinct]))
    )
    return paths.at_readings([carried(total, symmetry) for (total,), symmetry in zip(solved, symmetries)])


def _solved(solved: list) -> list:
    """Return solutions as they are. Raises NotConverged where one of them is a reason why there are none."""
    if reasons := [one for one in solved if isinstance(one, str)]:
        raise NotConverged(reasons[0])
    return solved
