"""The indentations behind the readings: paths that the finite elements must follow, and the step of each reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gelforge.indentation.paths.places import DIGITS
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.mismatch.readings.observations import Observations
from gelforge.recording.tables.path_through import path_through

DEPTH_DIGITS = 4  # depths that agree so far [mm] are one


@dataclass(frozen=True)
class Runs:
    """Distinct paths of the readings, without time: where there is no memory, indentations to all depths share a loading."""

    ways: tuple[PlannedCell, ...]  # per site, in the order of its number: a loading through all depths
    way: np.ndarray  # (R,) number of each reading's loading
    step: np.ndarray  # (R,) of that loading, at the depth of the reading
    # number of a loading, and the run that unloads from its way
    unloadings: tuple[tuple[int, PlannedCell], ...]
    unloading: np.ndarray  # (R,) number of each reading's unloading; -1: none
    back: np.ndarray  # (R,) step of that run

    def loading(self, by_way: Sequence[np.ndarray]) -> np.ndarray:
        """Return a quantity (R, ...) at the readings from that along every loading (D, ...), whatever their phase."""
        return np.stack([by_way[way][step] for way, step in zip(self.way, self.step)])


def runs_of(observations: Observations) -> Runs:
    """Return the runs of observations: per site one loading through all depths, and one unloading per depth it begins at."""
    table = observations.table
    depth = table["depth_mm"].round(DEPTH_DIGITS).to_numpy()
    deepest = table["deepest_mm"].round(DEPTH_DIGITS).to_numpy()
    up = (table["phase"] == "unload").to_numpy()
    ways: list[PlannedCell] = []
    unloadings: list[tuple[int, PlannedCell]] = []
    way, step, back = np.zeros((3, len(table)), int)
    unloading = np.full(len(table), -1)
    for number, (site, rows) in enumerate(table.groupby("site").indices.items()):
        x, y = (round(float(v), DIGITS) for v in observations.sites[site])
        # those of unloading too: their base is known
        down = np.unique(np.concatenate([depth[rows], deepest[rows]]))
        ways.append(PlannedCell(f"site{site:04d}", x, y, tuple(map(float, down))))
        way[rows], step[rows] = number, np.searchsorted(down, depth[rows])
        for peak in np.unique(deepest[rows][up[rows]])[::-1]:
            unloaded = rows[up[rows] & (deepest[rows] == peak)]
            to, fro = down[down <= peak], np.unique(depth[unloaded])[::-1]
            unloading[unloaded], back[unloaded] = (
                len(unloadings),
                len(to) + np.searchsorted(-fro, -depth[unloaded]),
            )
            phases = ("load",) * len(to) + ("unload",) * len(fro)
            run = replace(ways[-1], depths_mm=(*map(float, to), *map(float, fro)), phases=phases)
            unloadings.append((number, run))
    return Runs(tuple(ways), way, step, tuple(unloadings), unloading, back)


@dataclass(frozen=True)
class TimedRuns:
    """The paths of the readings in time, with memory: indentations alike in site, depths and times are one run."""

    trajectories: tuple[Trajectory, ...]
    run: np.ndarray  # (R,) of each reading
    step: np.ndarray  # (R,) of its run

    def at_readings(self, by_run: list[np.ndarray]) -> np.ndarray:
        """Return a quantity (R, ...) at the readings from that along every run (D, ...)."""
        return np.stack([by_run[run][step] for run, step in zip(self.run, self.step)])


def timed_runs_of(observations: Observations, step_mm: float, path_dependent: bool) -> TimedRuns:
    """Return the timed runs of observations; path_dependent: every indentation is a run of its own, one after another.

    The way between two readings is solved in steps of at most step_mm.
    """
    table = observations.table
    known: dict[tuple, int] = {}
    trajectories: list[tuple[Trajectory, list[int]]] = []  # each with the steps at its readings
    run, step = np.empty(len(table), int), np.empty(len(table), int)
    rows_of = table.groupby("press").indices
    for press in table["press"].unique():
        rows = rows_of[press]
        part = table.iloc[rows]
        depths = part["depth_mm"].round(DEPTH_DIGITS).to_numpy()
        times = np.maximum.accumulate(part["press_time_s"].round(2).to_numpy())
        key = (int(part["site"].iloc[0]), tuple(depths), tuple(times), *((press,) if path_dependent else ()))
        if key not in known:
            known[key] = len(trajectories)
            path, where = _timed_path(observations.sites[key[0]], depths, times, step_mm)
            trajectories.append((path, where))
        run[rows] = known[key]
        step[rows] = trajectories[known[key]][1]
    return TimedRuns(tuple(path for path, _ in trajectories), run, step)


def _timed_path(place, depths, times, step_mm) -> tuple[Trajectory, list[int]]:
    """Return a path through readings at depths and times, from the first touch on, and which of its steps they are."""
    way = path_through(depths, times, step_mm)
    x, y = (round(float(v), DIGITS) for v in place)
    return Trajectory(x, y, way.depths_mm, way.phases, times_s=way.times_s), list(way.readings)
