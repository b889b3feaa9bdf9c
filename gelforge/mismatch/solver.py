"""The finite elements behind a verdict: base forces at every reading, how they follow each effect, and forces with effects.

Base forces are those of the study's own mesh, on the way down. Derivatives, ways up and everything with an effect are
solved on a mesh of COARSER sizes, and only their difference from the base on that same mesh is used, multiplied by what
the finer mesh makes of the pressing force: the mesh's error of a change is a small part of a small change. All solutions
are kept by the digest of what decides them.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gelforge.config import ConfigError, Study
from gelforge.files import atomic, digest, source_digest
from gelforge.indentation.cell_file import CellError, read_cell
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.indentation.error_bars import AMOUNT as LAW_AMOUNT
from gelforge.indentation.error_bars import COARSER, PART_TOTALS
from gelforge.indentation.inputs import inputs_digest
from gelforge.indentation.plan import PlannedCell
from gelforge.indentation.sensitivities import AMOUNT, Variation, derivatives, unmirrored
from gelforge.indentation.simulate import simulate_cell, simulate_in_order, simulate_trajectory
from gelforge.indentation.trajectory import Trajectory
from gelforge.mechanics.equilibrium import NotConverged
from gelforge.mechanics.laws import PrincipalLaw
from gelforge.mismatch.context import Context, Curves
from gelforge.mismatch.effect import Effect, Shape
from gelforge.mismatch.observations import Observations
from gelforge.mismatch.places import FirstOrderAt
from gelforge.mismatch.runs import Runs, runs_of, timed_runs_of
from gelforge.mismatch.solver_effects import FirstOrder

SCREEN_TOLERANCE = 1e-2  # of a neighbour's difference may be left: the screen asks for a few per cent
MOST_MESH_ERROR = 1.5  # factor; beyond it (the way up's last touch) the ratio says nothing
REACH_MM = 4.0  # a weak place farther than this outside its own radius is not felt by a press
Amounts = tuple[Effect, Shape, np.ndarray]


class SolverFailed(ValueError):
    """A base press that could not be solved: there is nothing to compare the readings with."""


@dataclass(frozen=True)
class Solver:
    """A study with its laws, where its solutions are kept, and how many are solved side by side."""

    study: Study
    laws: Mapping[str, PrincipalLaw]  # by material
    uncertain: Mapping[
        str, Sequence[PrincipalLaw]
    ]  # by material, laws moved by LAW_AMOUNT of a standard deviation
    kept: Path
    cells: Path | None = None  # folder of the study's own cells
    workers: int = 1
    zero_by: str = (
        "press"  # what depth zero was found for, once: a press or the session; tilt is seen differently
    )

    @property
    def coarse(self) -> Study:
        """Return the study on the coarser mesh."""
        sizes = self.study.mechanics.mesh
        mesh = sizes.model_copy(update={"near_mm": COARSER * sizes.near_mm, "far_mm": COARSER * sizes.far_mm})
        mechanics = self.study.mechanics.model_copy(update={"mesh": mesh})
        coarse = unmirrored(self.study.model_copy(update={"mechanics": mechanics}))
        return coarse if self.zero_by == "press" else with_keys(coarse, kinematics={"zero_by": self.zero_by})

    def each(self, work: Callable, tasks: Sequence) -> list:
        """Return work(task) of every task, side by side."""
        if self.workers == 1 or len(tasks) < 2:
            return [work(task) for task in tasks]
        context = multiprocessing.get_context("forkserver")
        with ProcessPoolExecutor(min(self.workers, len(tasks)), context) as pool:
            return list(pool.map(work, tasks))


@dataclass(frozen=True)
class Base:
    """Base forces at the readings and what they follow."""

    context: Context
    runs: Runs
    coarse: np.ndarray  # (R, 3) [N] base forces on the coarser mesh
    finer: np.ndarray  # (R, 1) by which changes on the coarser mesh are multiplied
    law: np.ndarray  # (R, 3, q) [N] per standard deviation of each uncertain direction of the laws
    floor: np.ndarray  # (R, 3) [N] signed pattern of the discretisation error, one standard deviation
    failed: Mapping[str, str]  # derivatives that could not be had, and why


def base_of(solver: Solver, observations: Observations, effects: Iterable[Effect]) -> Base:
    """Return the base of observations with the derivatives of all effects that need the solver.

    Raises SolverFailed where a base press does not converge.
    """
    runs = runs_of(observations)
    fine = solver.each(_fine, [(solver, planned) for planned in _ways_down(runs)])
    by_site = {int(runs.site[n]): k for k, n in enumerate(_deepest_runs(runs))}
    depths = tuple(np.array(_ways_down(runs)[by_site[s]].depths_mm) for s in range(len(observations.sites)))
    curves = Curves(depths, tuple(fine[by_site[s]] for s in range(len(observations.sites))))
    blank = Context(solver.study, observations, np.zeros_like(observations.force), curves, {}, {})
    asked = list(_asked(solver, effects, blank))
    followed = solver.each(_follow, [(solver, planned, _near(asked, planned)) for planned in runs.planned])
    coarse_by_run = [result["base"] for result in followed]
    coarse = runs.at_readings(coarse_by_run)
    on_coarse = _loading_curves(runs, by_site, depths, coarse_by_run, len(observations.sites))
    correction = blank.on_readings(curves) - blank.on_readings(on_coarse)
    force = coarse + correction
    finer = _share(force, coarse)
    finer_along = [_share(fine, own) for fine, own in zip(curves.values, on_coarse.values)]
    failed: dict[str, str] = {}
    at_readings, along = {}, {}
    for key in [key for key, *_ in asked]:
        missing = [str(r[f"reason {key}"]) for r in followed if f"reason {key}" in r]
        if missing:
            failed[key] = missing[0]
            continue
        by_run = [r[key] if key in r else np.zeros_like(r["base"]) for r in followed]
        at_readings[key] = finer * runs.at_readings(by_run)
        down = _loading_curves(runs, by_site, depths, by_run, len(observations.sites))
        along[key] = Curves(depths, tuple(share * own for share, own in zip(finer_along, down.values)))
    laws = [key for key in followed[0] if key.startswith("law ")]
    law = [finer * runs.at_readings([r[key] for r in followed]) for key in laws]
    context = Context(solver.study, observations, force, curves, along, at_readings)
    stacked = np.stack(law, axis=-1) if law else np.zeros((*force.shape, 0))
    return Base(context, runs, coarse, finer, stacked, PART_TOTALS * correction, failed)


def _share(fine: np.ndarray, coarse: np.ndarray) -> np.ndarray:
    """Return by how much changes on the coarser mesh are to be multiplied (R, 1): as the pressing force itself."""
    known = np.abs(coarse[:, 2:]) > 0
    share = np.divide(fine[:, 2:], coarse[:, 2:], out=np.ones_like(fine[:, 2:]), where=known)
    return np.clip(share, 1 / MOST_MESH_ERROR, MOST_MESH_ERROR)


def forces_with(
    solver: Solver, base: Base, chosen: Sequence[Amounts], readings: np.ndarray | None = None
) -> np.ndarray:
    """Return the forces (R, 3) [N] at readings (R,) bool with some effects, by the finite elements; nan at the others.

    Effects without `to_study` act on the forces that result. Raises NotConverged.
    """
    observations = base.context.observations
    rows = np.ones(len(observations.table), bool) if readings is None else readings
    part = observations.chosen(rows)
    study, switched_on = (
        unmirrored(solver.study),
        [c for c in chosen if c[0].to_study is not None and np.any(c[2])],
    )
    for effect, shape, amounts in switched_on:
        study = effect.to_study(study, shape, amounts)
    force = base.context.force[rows]
    if switched_on:
        force = force + base.finer[rows] * (_solved_with(solver, study, part) - base.coarse[rows])
    context = replace(base.context.chosen(rows), force=force)
    for effect, shape, amounts in chosen:
        if effect.to_study is None and effect.to_forces is not None:
            force = effect.to_forces(context, shape, force, np.asarray(amounts, dtype=float))
    found = np.full(observations.force.shape, np.nan)
    found[rows] = force
    return found


def _solved_with(solver: Solver, study: Study, observations: Observations) -> np.ndarray:
    """Return the forces (R, 3) at all readings on the coarser mesh with a study's effects, sessions as they were."""
    table, force = observations.table, np.empty_like(observations.force)
    circumstances = study.mechanics.effects.material.circumstances
    stands = ["age_days", "temperature_C"]
    if not (circumstances.ageing_per_day or circumstances.stiffening_per_K):
        return _coarse_forces(solver, study, observations)
    for _, rows in table.groupby(stands, dropna=False).indices.items():
        own = {
            name: float(table[name].iloc[rows[0]])
            for name in stands
            if np.isfinite(table[name].iloc[rows[0]])
        }
        chosen = np.zeros(len(table), bool)
        chosen[rows] = True
        there = with_keys(study, material={"circumstances": own})
        force[chosen] = _coarse_forces(solver, there, observations.chosen(chosen))
    return force


def _coarse_forces(solver: Solver, study: Study, observations: Observations) -> np.ndarray:
    own = replace(solver, study=study)
    history = study.mechanics.effects.history
    if not history.any:
        runs = runs_of(observations)
        found = solver.each(_plain, [(own, planned) for planned in runs.planned])
        return runs.at_readings(_solved(found))
    timed = timed_runs_of(
        observations, history.timing.step_mm, any(m.amount for m in history.mullins.values())
    )
    if any(m.amount for m in history.mullins.values()):
        return timed.at_readings(_solved([*_in_order(own, timed.trajectories)]))
    return timed.at_readings(_solved(solver.each(_timed, [(own, path) for path in timed.trajectories])))


def _solved(found: list[np.ndarray | str]) -> list[np.ndarray]:
    for result in found:
        if isinstance(result, str):
            raise NotConverged(result)
    return found


def _deepest_runs(runs: Runs) -> list[int]:
    """Return per site, in the order of sites as they come, the run that goes through all its depths."""
    first = {}
    for number, site in enumerate(runs.site):
        first.setdefault(int(site), number)
    return list(first.values())


def _ways_down(runs: Runs) -> list[PlannedCell]:
    """Return per site its way down through all depths."""
    found = []
    for number in _deepest_runs(runs):
        planned = runs.planned[number]
        found.append(way_down(planned))
    return found


def _loading_curves(runs: Runs, by_site, depths, by_run: list[np.ndarray], sites: int) -> Curves:
    """Return a quantity along the runs as curves over the depths of each site's way down."""
    values = []
    deepest = _deepest_runs(runs)
    for site in range(sites):
        number = deepest[by_site[site]]
        way = np.array(runs.planned[number].depths_mm)[: len(depths[site])]
        order = np.searchsorted(way, depths[site]).clip(0, len(way) - 1)
        values.append(by_run[number][order])
    return Curves(depths, tuple(values))


def _asked(solver: Solver, effects: Iterable[Effect], context: Context):
    """Yield key, place or None, and the variation of the coarser study for every derivative that the solver must give."""
    coarse, laws = solver.coarse, dict(solver.laws)
    seen_up = (context.observations.table["phase"] == "unload").any()
    for effect in effects:
        if not isinstance(effect.to_forces, (FirstOrder, FirstOrderAt)):
            continue
        if effect.unloading and not seen_up:
            continue
        alone = effect.mesh_changes or effect.switch or effect.history or effect.unloading
        for number, shape in enumerate(effect.shapes(context)):
            for which, parameter in enumerate(effect.parameters):
                amount = 1.0 if effect.switch else AMOUNT * parameter.width * (parameter.sign or 1)
                amounts = np.zeros(len(effect.parameters))
                amounts[which] = amount
                try:
                    varied = effect.to_study(coarse, shape, amounts)
                    still = effect.to_study(coarse, shape, 0 * amounts) if effect.mesh_changes else None
                except ConfigError:  # this sensor does not have what the effect is about
                    continue
                key = key_of(effect, number if len(shape) else None, which)
                yield key, shape, Variation(varied, laws, amount, alone, still)


def key_of(effect: Effect, shape: int | None, parameter: int) -> str:
    """Return the name of a derivative: effect[.parameter][@shape]."""
    name = (
        effect.name if len(effect.parameters) == 1 else f"{effect.name}.{effect.parameters[parameter].name}"
    )
    return name if shape is None else f"{name}@{shape}"


def _near(asked: list, planned: PlannedCell) -> dict[str, Variation]:
    """Return the variations that a press at a position can feel."""
    found = {}
    for key, shape, variation in asked:
        if "x_mm" in shape:
            away = np.hypot(shape["x_mm"] - planned.x_mm, shape["y_mm"] - planned.y_mm)
            if away > float(shape.get("radius_mm", 0.0)) + REACH_MM:
                continue
        found[key] = variation
    return found


def _fine(task: tuple[Solver, PlannedCell]) -> np.ndarray:
    """Return the base forces (D, 3) of a way down: from the study's own cell where it is that press, else solved."""
    solver, planned = task
    stored = _stored(solver, planned)
    if stored is not None:
        return stored
    study = unmirrored(solver.study)
    name = digest(["fine", inputs_digest(study, dict(solver.laws), planned)])
    kept = _kept(solver, name)
    if kept is None:
        cell = simulate_cell(study, dict(solver.laws), planned)
        if not cell.converged:
            raise SolverFailed(
                f"the base does not converge at ({planned.x_mm:g}, {planned.y_mm:g}) mm beyond "
                f"{cell.attributes['last_good_depth_mm']:g} mm: {cell.attributes['reason']}; leave deeper readings out"
            )
        kept = _keep(solver, name, {"total": cell.arrays["total_force_N"]})
    return kept["total"]


def _stored(solver: Solver, planned: PlannedCell) -> np.ndarray | None:
    """Return the forces of the study's own cell at a position, where it has all these depths and these settings."""
    if solver.cells is None:
        return None
    from gelforge.indentation.plan import POSITION_MATCH_MM, plan_cells

    for cell in plan_cells(solver.study).values():
        if max(abs(cell.x_mm - planned.x_mm), abs(cell.y_mm - planned.y_mm)) > POSITION_MATCH_MM:
            continue
        where = [k for d in planned.depths_mm for k, own in enumerate(cell.depths_mm) if abs(own - d) < 1e-6]
        if cell.follows_a_path or len(where) != len(planned.depths_mm):
            continue
        try:
            found = read_cell(solver.cells / f"{cell.name}.h5", ["total_force_N"])
        except CellError:
            return None
        same = found.attributes["inputs_digest"] == inputs_digest(solver.study, dict(solver.laws), cell)
        if same and found.converged:
            return found.arrays["total_force_N"][where]
    return None


def _follow(task: tuple[Solver, PlannedCell, dict[str, Variation]]) -> dict[str, np.ndarray]:
    """Return of a run on the coarser mesh the base forces (D, 3) and its derivatives along laws and variations.

    Derivatives are those of the way down; on the way up they have the value at the same depth.
    """
    solver, planned, variations = task
    study, laws = solver.coarse, dict(solver.laws)
    settings = {key: [v.study.model_dump(mode="json"), v.amount] for key, v in variations.items()}
    moved = {
        f"law {material} {k}": {**laws, material: law}
        for material, directions in sorted(solver.uncertain.items())
        for k, law in enumerate(directions)
    }
    described = {key: {m: law.description() for m, law in own.items()} for key, own in moved.items()}
    own = [inputs_digest(study, laws, planned), settings, described, source_digest("mismatch/solver.py")]
    name = digest(["follow", own])
    kept = _kept(solver, name)
    if kept is not None:
        return kept
    down = way_down(planned)
    by_law = {key: Variation(study, own, LAW_AMOUNT) for key, own in moved.items()}
    beside = {key: v for key, v in variations.items() if not v.alone}
    found: dict[str, np.ndarray] = {}
    try:
        base, along = derivatives(study, laws, down, by_law | beside, SCREEN_TOLERANCE)
    except NotConverged:
        base, along = _base_alone(study, laws, down, by_law)
        for key, variation in beside.items():
            found |= _one(study, laws, down, key, variation)
    for key, variation in variations.items():
        if variation.alone:
            found |= _difference(base, laws, down, key, variation)
    found |= {"base": base} | {key: derivative.total for key, derivative in along.items()}
    if planned.phases:
        step = np.searchsorted(np.array(down.depths_mm), np.array(planned.depths_mm) - 1e-9)
        found = {key: values if key.startswith("reason ") else values[step] for key, values in found.items()}
        found["base"] = _way_up(solver, planned)
    return _keep(solver, name, found)


def way_down(planned: PlannedCell) -> PlannedCell:
    """Return a run without its way up, through all its depths."""
    return replace(planned, depths_mm=tuple(float(d) for d in np.unique(planned.depths_mm)), phases=())


def _way_up(solver: Solver, planned: PlannedCell) -> np.ndarray:
    found = _plain((solver, planned))
    if isinstance(found, str):
        raise SolverFailed(
            f"the way up at ({planned.x_mm:g}, {planned.y_mm:g}) mm does not converge: {found}; leave its readings out"
        )
    return found


def _base_alone(study: Study, laws, planned: PlannedCell, by_law: dict[str, Variation]):
    """Return the base with its derivatives along the laws' directions only."""
    try:
        return derivatives(study, laws, planned, by_law, SCREEN_TOLERANCE)
    except NotConverged as failure:
        raise SolverFailed(
            f"the base on the coarser mesh does not converge at ({planned.x_mm:g}, {planned.y_mm:g}) mm: {failure}; "
            "leave deeper readings out"
        ) from None


def _one(study: Study, laws, planned: PlannedCell, key: str, variation: Variation) -> dict[str, np.ndarray]:
    """Return one derivative, or the reason why there is none."""
    try:
        return {key: derivatives(study, laws, planned, {key: variation})[1][key].total}
    except (NotConverged, ConfigError) as failure:
        return {f"reason {key}": np.array(str(failure))}


def _difference(
    base: np.ndarray, laws, planned: PlannedCell, key: str, variation: Variation
) -> dict[str, np.ndarray]:
    """Return one derivative as the difference of two solutions, or the reason why there is none."""
    totals = []
    for study in (variation.study, variation.without):
        try:
            cell = simulate_cell(study, laws, planned) if study else None
        except ConfigError as failure:
            return {f"reason {key}": np.array(str(failure))}
        if cell is not None and not cell.converged:
            return {f"reason {key}": np.array(str(cell.attributes["reason"]))}
        totals.append(base if cell is None else cell.arrays["total_force_N"])
    return {key: (totals[0] - totals[1]) / variation.amount}


def _plain(task: tuple[Solver, PlannedCell]) -> np.ndarray | str:
    """Return the forces (D, 3) of a run on the coarser mesh with the effects of the study, or why there are none."""
    solver, planned = task
    study, laws = solver.coarse, dict(solver.laws)
    name = digest(["plain", inputs_digest(study, laws, planned)])
    kept = _kept(solver, name)
    if kept is None:
        cell = simulate_cell(study, laws, planned)
        if not cell.converged:
            return str(cell.attributes["reason"])
        kept = _keep(solver, name, {"total": cell.arrays["total_force_N"]})
    return kept["total"]


def _timed(task: tuple[Solver, Trajectory]) -> np.ndarray | str:
    """The same along a path in time."""
    solver, path = task
    study, laws = solver.coarse, dict(solver.laws)
    planned = PlannedCell("", path.x_mm, path.y_mm, path.depths_mm, phases=path.phases)
    name = digest(["timed", inputs_digest(study, laws, planned), path.times_s])
    kept = _kept(solver, name)
    if kept is None:
        by_layer = {layer.name: laws[layer.material] for layer in study.sensor.layers}
        cell = simulate_trajectory(study.sensor, study.indenter, study.mechanics, by_layer, path)
        if not cell.converged:
            return str(cell.attributes["reason"])
        kept = _keep(solver, name, {"total": cell.arrays["total_force_N"]})
    return kept["total"]


def _in_order(solver: Solver, paths: Sequence[Trajectory]) -> list[np.ndarray | str]:
    """The same, one path after another on a sensor that remembers."""
    study, laws = solver.coarse, dict(solver.laws)
    first = PlannedCell("", paths[0].x_mm, paths[0].y_mm, paths[0].depths_mm, phases=paths[0].phases)
    all_paths = [[p.x_mm, p.y_mm, p.depths_mm, p.times_s] for p in paths]
    name = digest(["in order", inputs_digest(study, laws, first), all_paths])
    kept = _kept(solver, name)
    if kept is None:
        by_layer = {layer.name: laws[layer.material] for layer in study.sensor.layers}
        found = []
        for cell, _ in simulate_in_order(study.sensor, study.indenter, study.mechanics, by_layer, paths):
            if not cell.converged:
                return [str(cell.attributes["reason"])]
            found.append(cell.arrays["total_force_N"])
        kept = _keep(solver, name, {f"{k:06d}": total for k, total in enumerate(found)})
    return [kept[key] for key in sorted(kept)]


def _kept(solver: Solver, name: str) -> dict[str, np.ndarray] | None:
    path = solver.kept / f"{name}.npz"
    if not path.is_file():
        return None
    with np.load(path) as file:
        return dict(file)


def _keep(solver: Solver, name: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    with atomic(solver.kept / f"{name}.npz") as temporary:
        with open(temporary, "wb") as file:
            np.savez(file, **arrays)
    return arrays
