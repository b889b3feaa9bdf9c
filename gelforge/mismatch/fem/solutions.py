"""Solutions by the finite elements that a verdict needs, each kept by the digest of all that decides it.

A solution is of one place: a loading on the study's own mesh (`fine`); on a coarser mesh a loading with derivatives and
unloading from its depths (`follow`), or paths in time, one after another on a sensor that remembers (`in_time`).
Kept are forces in the sensor's axes; those returned are in the axes of the force sensor (`Solver.axes`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from gelforge.config import ConfigError, Study
from gelforge.files import FileError, atomic, check_seal, digest, source_digest
from gelforge.indentation.cells.cell_file import Cell, CellError, read_cell
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.indentation.effects.kinematics import machine_frame
from gelforge.indentation.effects.surfaces import top_slope
from gelforge.indentation.paths.places import gaps_to, within
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.planning.plan import plan_cells
from gelforge.indentation.solving.error_bars import AMOUNT as LAW_AMOUNT
from gelforge.indentation.solving.inputs import inputs_digest
from gelforge.indentation.solving.sensitivities import (
    Derivative,
    Variation,
    derivatives,
    subtracted,
    unmirrored,
)
from gelforge.indentation.solving.simulate import (
    Solution,
    simulate_cell,
    simulate_in_order,
    solved_cell,
)
from gelforge.indentation.solving.unloading import unloaded
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.fem.stored import place_digest, read_stored, slope_digest
from gelforge.workers import each

SITES = "sites solved"
OWN_MESH, COARSER_MESH = "the study's mesh", "the coarser mesh (mismatch.coarser)"


class SolverFailed(ValueError):
    """A base that could not be solved: there is nothing to compare the readings with. `presses` says where, if known."""

    def __init__(self, message: str, presses: Sequence[Unsolved] = ()):
        super().__init__(message)
        self.presses = tuple(presses)


@dataclass(frozen=True)
class Unsolved:
    """An indentation of the base, or the mirror image that stands for it, that finds no equilibrium."""

    x_mm: float
    y_mm: float
    mesh: str  # in words
    reason: str
    beyond_mm: float = np.inf  # the deepest that was solved during loading
    unloading_from_mm: float = np.inf  # unloading from here or deeper are not solved

    @property
    def words(self) -> str:
        where = f"at ({self.x_mm:g}, {self.y_mm:g}) mm, or at a mirror image of that,"
        if np.isfinite(self.beyond_mm):
            return f"{where} beyond {self.beyond_mm:g} mm on {self.mesh}: {self.reason}"
        return f"{where} during unloading from {self.unloading_from_mm:g} mm on {self.mesh}: {self.reason}"


@dataclass(frozen=True)
class Solver:
    """A study with its laws, where its solutions are kept, and how many are solved side by side."""

    study: Study
    laws: Mapping[str, PrincipalLaw]  # by material
    uncertain: Mapping[
        str, Sequence[PrincipalLaw]
    ]  # by material, laws moved by LAW_AMOUNT of a standard deviation
    kept: Path
    cells: Path | None = None  # folder of the study's own sites
    workers: int = 1
    zero_by: str = "press"  # what depth zero was found for, once: an indentation or the session; tilt is seen differently
    stored: Path | None = None  # folder of the derivatives of the study's own sites
    turns_with: str = "sensor"  # what the axes of the force sensor keep to: the sensor or the stage

    def axes(self, study: Study) -> np.ndarray:
        """Return the axes (3, 3) of the force sensor as columns, in those of a study's sensor."""
        tilted = self.turns_with == "stage"
        return machine_frame(study.mechanics.effects) if tilted else np.eye(3)

    @cached_property
    def planned(self) -> list[PlannedCell]:
        """Return the study's own sites; none where nothing of them is stored."""
        return list(plan_cells(self.study).values()) if self.cells or self.stored else []

    def planned_at(self, x_mm: float, y_mm: float) -> Iterator[PlannedCell]:
        """Yield the study's own sites at a position."""
        for cell in self.planned:
            if within(gaps_to((cell.x_mm, cell.y_mm), (x_mm, y_mm))[0]):
                yield cell

    def stored_at(self, x_mm: float, y_mm: float) -> Path | None:
        """Return the file with the derivatives of a position; None where nothing is stored of it."""
        names = (cell.source or cell.name for cell in self.planned_at(x_mm, y_mm))
        return next((self.stored / f"{name}.h5" for name in names), None) if self.stored else None

    @cached_property
    def coarse(self) -> Study:
        """Return the study on the coarser mesh."""
        mesh = self.study.mechanics.mesh.coarser(self.study.mismatch.coarser)
        mechanics = self.study.mechanics.model_copy(update={"mesh": mesh})
        return self.seen(unmirrored(self.study.model_copy(update={"mechanics": mechanics})))

    def seen(self, study: Study) -> Study:
        """Return a study with depth counted as the recording counts it; on a level top that is all the same."""
        effects = study.mechanics.effects
        if self.zero_by == "press" or not (any(effects.kinematics.tilt_deg) or top_slope(effects).any()):
            return study
        return with_keys(study, kinematics={"zero_by": self.zero_by})

    def each(self, work: Callable, tasks: Sequence) -> list:
        """Return work(task) of every task, side by side."""
        return each(work, tasks, self.workers, SITES)


def fine(task: tuple[Solver, PlannedCell]) -> np.ndarray | Unsolved:
    """Return the base forces (D, 3) of a loading on the study's own mesh, or from where on there are none."""
    solver, planned = task
    study = unmirrored(solver.study)
    laws = dict(solver.laws)
    content = ["fine", inputs_digest(study, laws, planned)]
    kept = once(solver, content, lambda: _way_down_of(simulate_cell(study, laws, planned)))
    assert not isinstance(kept, str)
    return kept["total"] @ solver.axes(study) if "total" in kept else _unsolved(planned, OWN_MESH, kept)


def own_cell(solver: Solver, planned: PlannedCell) -> np.ndarray | None:
    """Return the forces of the study's own site at a position, where it has all these depths and these settings."""
    if solver.cells is None:
        return None
    for cell in solver.planned_at(planned.x_mm, planned.y_mm):
        where = [k for d in planned.depths_mm for k, own in enumerate(cell.depths_mm) if abs(own - d) < 1e-6]
        if cell.follows_a_path or len(where) != len(planned.depths_mm):
            continue
        try:
            found = read_cell(solver.cells / f"{cell.name}.h5", ["total_force_N"])
        except CellError:
            return None
        same = found.attributes["inputs_digest"] == inputs_digest(solver.study, dict(solver.laws), cell)
        if same and found.converged:
            return found.arrays["total_force_N"][where] @ solver.axes(solver.study)
    return None


def follow(task: tuple) -> dict[str, np.ndarray] | Unsolved:
    """Return of a loading on the coarser mesh its forces (D, 3) as `base`, and its derivatives along laws and variations.

    task: solver, loading, variations by name, and runs that unload from its depths (`unloading_key` names their forces). A
    derivative that could not be had is missing, "reason KEY" says why. Where forces could not be had: from where on.
    """
    solver, down, variations, *runs = task
    study, laws = solver.coarse, dict(solver.laws)
    asked = variations | along_laws(solver, study)
    known = _stored(solver, down, asked) if asked else {}
    own = [inputs_digest(study, laws, down), source_digest("mismatch/fem/solutions.py")]
    contents = {"base": ["followed", *own]}
    contents |= {key: ["along", *own, one.inputs] for key, one in asked.items()}
    contents |= {unloading_key(run): ["unloading", *own, run.depths_mm] for run in runs}
    names = {key: digest(content) for key, content in contents.items() if key not in known}
    known |= {key: kept for key, name in names.items() if (kept := found_before(solver, name))}
    missing = [key for key in names if key not in known]
    if missing and "reason" not in known.get("base", {}):
        some = {key: one for key, one in asked.items() if key in missing}
        solved = _followed(study, laws, down, some, [run for run in runs if unloading_key(run) in missing])
        known |= {key: keep(solver, names[key], solved[key]) for key in missing if key in solved}
        if "reason" in solved["base"]:  # the stored forces were solved by other steps
            known["base"] = solved["base"]
    if "reason" in known["base"]:
        return _unsolved(down, COARSER_MESH, known["base"])
    for run in sorted(runs, key=lambda run: max(run.depths_mm)):
        if "reason" in (there := known[unloading_key(run)]):
            x, y, peak = down.x_mm, down.y_mm, max(run.depths_mm)
            return Unsolved(x, y, COARSER_MESH, str(there["reason"]), unloading_from_mm=peak)
    force, axes = known["base"]["total"], solver.axes(study)
    found = {f"reason {key}": one["reason"] for key, one in known.items() if "reason" in one}
    for key, one in known.items():
        if key in asked and "total" in one:
            varied = solver.axes(asked[key].study)
            found[key] = one["total"] @ varied + force @ (varied - axes) / asked[key].amount
        elif "total" in one:
            found[key] = one["total"] @ axes
    return found


def _followed(
    study: Study, laws, down: PlannedCell, asked: Mapping[str, Variation], runs: Sequence[PlannedCell]
) -> dict[str, dict[str, np.ndarray]]:
    """Return what is kept of a loading, of its derivatives and of the runs that unload from its depths, by key."""
    cell, solution = solved_cell(study, laws, down)
    found = {"base": _way_down_of(cell)}
    if not cell.converged:
        return found
    for run in runs:
        peak = run.phases.index("unload") - 1
        unloading = np.searchsorted(down.depths_mm, run.depths_mm[peak + 1 :])
        try:
            up = unloaded(solution, peak, unloading)
        except NotConverged as failure:
            found[unloading_key(run)] = {"reason": np.array(str(failure))}
        else:
            forces = np.vstack([cell.arrays["total_force_N"][: peak + 1], up])
            found[unloading_key(run)] = {"total": forces}
    along = each_derivative(study, laws, down, asked, solution)[1] if asked else {}
    for key, one in along.items():
        found[key] = {"reason": np.array(one)} if isinstance(one, str) else {"total": one.total}
    return found


def unloading_key(run: PlannedCell) -> str:
    """Return the name of the forces of a run that unloads from one of a loading's depths."""
    return f"unloading {run.depths_mm}"


def _stored(
    solver: Solver, down: PlannedCell, asked: Mapping[str, Variation]
) -> dict[str, dict[str, np.ndarray]]:
    """Return what the study's stored derivatives say of a loading run: base and derivatives by key, or why none."""
    path = solver.stored_at(down.x_mm, down.y_mm)
    if not path:
        return {}
    place = place_digest(solver.coarse, solver.laws, down.x_mm, down.y_mm)
    if not (held := read_stored(path, place)):
        return {}
    depths, found = np.array(down.depths_mm), {}
    if (base := held.base_at(depths)) is not None:
        found["base"] = {"total": base}
    names = {key: slope_digest(place, variation) for key, variation in asked.items()}
    slopes = held.slopes_at(names.values(), depths)
    for key, name in names.items():
        if name in slopes:
            found[key] = {"total": slopes[name]}
        elif name in held.reasons:
            found[key] = {"reason": np.array(held.reasons[name])}
    return found


def along_laws(solver: Solver, study: Study) -> dict[str, Variation]:
    """Return the variations of a study along the directions in which its laws are uncertain."""
    return {
        f"law {material} {k}": Variation(study, {**solver.laws, material: law}, LAW_AMOUNT)
        for material, directions in sorted(solver.uncertain.items())
        for k, law in enumerate(directions)
    }


def each_derivative(
    study: Study,
    laws,
    planned: PlannedCell,
    asked: Mapping[str, Variation],
    solution: Solution | None = None,
) -> tuple[Cell, dict[str, Derivative | str]]:
    """Return the base's run and its derivatives, each one or the reason why there is none; solution: the base's own.

    Raises NotConverged where the base does not converge.
    """
    beside = {key: variation for key, variation in asked.items() if not variation.alone}
    along: dict[str, Derivative | str] = {}

    try:
        base, solved = derivatives(study, laws, planned, beside, solution)
        along |= solved
    except (NotConverged, ConfigError):  # one that fails must not take the others with it
        base, solved = derivatives(study, laws, planned, {}, solution)[0], {}
    for key, one in asked.items():
        if key not in solved:
            try:
                if one.alone:
                    along[key] = subtracted(base, laws, planned, one)
                else:
                    along[key] = derivatives(study, laws, planned, {key: one}, solution)[1][key]
            except (NotConverged, ConfigError) as failure:
                along[key] = str(failure)
    return base, along


def _way_down_of(cell: Cell) -> dict[str, np.ndarray]:
    """Return what is kept of a loading: its forces, or how deep it was solved and why no deeper."""
    if cell.converged:
        return {"total": cell.arrays["total_force_N"]}
    last, reason = cell.attributes["last_good_depth_mm"], cell.attributes["reason"]
    return {"beyond_mm": np.array(float(last)), "reason": np.array(str(reason))}


def _unsolved(planned: PlannedCell, mesh: str, kept: Mapping[str, np.ndarray]) -> Unsolved:
    """Return from where on a loading is not solved, as it was kept."""
    return Unsolved(planned.x_mm, planned.y_mm, mesh, str(kept["reason"]), float(kept["beyond_mm"]))


def in_time(task: tuple[Solver, Sequence[Trajectory]]) -> list[np.ndarray] | str:
    """Return the forces (D, 3) along paths in time on the coarser mesh, one after another, or why there are none."""
    solver, paths = task
    study, laws = solver.coarse, dict(solver.laws)
    first = PlannedCell("", paths[0].x_mm, paths[0].y_mm, paths[0].depths_mm, phases=paths[0].phases)
    all_paths = [[p.x_mm, p.y_mm, p.depths_mm, p.times_s] for p in paths]

    def solve() -> dict[str, np.ndarray] | str:
        by_layer = {layer.name: laws[layer.material] for layer in study.sensor.layers}
        totals: dict[str, np.ndarray] = {}
        for cell, _ in simulate_in_order(study.sensor, study.indenter, study.mechanics, by_layer, paths):
            if not cell.converged:
                return str(cell.attributes["reason"])
            totals[f"{len(totals):06d}"] = cell.arrays["total_force_N"]
        return totals

    kept = once(solver, ["in order", inputs_digest(study, laws, first), all_paths], solve)
    return kept if isinstance(kept, str) else [kept[key] @ solver.axes(study) for key in sorted(kept)]


def once(
    solver: Solver, content: list, solve: Callable[[], dict[str, np.ndarray] | str]
) -> dict[str, np.ndarray] | str:
    """Return what is kept under the digest of all that decides it, else what solve gives: kept, but for a reason why not."""
    name = digest(content)
    if (kept := found_before(solver, name)) is not None:
        return kept
    solved = solve()
    return solved if isinstance(solved, str) else keep(solver, name, solved)


def found_before(solver: Solver, name: str) -> dict[str, np.ndarray] | None:
    path = solver.kept / f"{name}.npz"
    if not path.is_file():
        return None
    try:
        check_seal(path, "it is solved again")
    except FileError:  # kept solutions cost time, not the run
        return None
    with np.load(path) as file:
        return dict(file)


def keep(solver: Solver, name: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    with atomic(solver.kept / f"{name}.npz", sealed=True) as temporary:
        with open(temporary, "wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]  # no array is called as its other keyword
    return arrays
