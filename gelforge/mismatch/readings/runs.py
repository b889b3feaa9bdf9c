"""The indentations behind the readings: paths that the finite elements must follow, and the step of each reading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.mismatch.readings.observations import PLACE_DIGITS, Observations
from gelforge.recording.tables.path_through import path_through

DEPTH_DIGITS = 4  # depths that agree so far [mm] are one
TIME_DIGITS = 2  # [s]


@dataclass(frozen=True)
class Runs:
    """Distinct paths of the readings, without time: where there is no memory, indentations to all depths share a loading."""

    planned: tuple[PlannedCell, ...]
    site: np.ndarray  # (n,) of each run
    run: np.ndarray  # (R,) of each reading
    step: np.ndarray  # (R,) of its run

    def at_readings(self, by_run: list[np.ndarray]) -> np.ndarray:
        """Return a quantity (R, ...) at the readings from that along every run (D, ...)."""
        return np.stack([by_run[run][step] for run, step in zip(self.run, self.step)])

    def of_sites(self, sites: np.ndarray) -> list[int]:
        """Return the numbers of the runs at some sites."""
        return [number for number, site in enumerate(self.site) if site in sites]


def runs_of(observations: Observations) -> Runs:
    """Return the runs of observations: per site one loading through all depths, and one unloading per indentation read so.

    The unloading from a site's deepest indentation continues its loading; from others the loading is followed again to
    their depth.
    """
    table = observations.table
    depth = table["depth_mm"].round(DEPTH_DIGITS).to_numpy()
    deepest = table["deepest_mm"].round(DEPTH_DIGITS).to_numpy()
    up = (table["phase"] == "unload").to_numpy()
    planned: list[PlannedCell] = []
    site_of, run, step = [], np.empty(len(table), int), np.empty(len(table), int)
    for site, rows in table.groupby("site").indices.items():
        down = np.unique(
            np.concatenate([depth[rows], deepest[rows]])
        )  # those of unloading too: their base is known there
        peaks = np.unique(deepest[rows][up[rows]])
        for peak in np.union1d(peaks, down[-1:])[::-1]:
            own = rows[up[rows] & (deepest[rows] == peak)]
            unloading = np.unique(depth[own])[::-1]
            way_down = down[down <= peak]
            phases = ("load",) * len(way_down) + ("unload",) * len(unloading)
            number = len(planned)
            x, y = (round(float(v), PLACE_DIGITS) for v in observations.sites[site])
            planned.append(
                PlannedCell(
                    f"site{site:04d}_{peak:g}mm",
                    x,
                    y,
                    (*map(float, way_down), *map(float, unloading)),
                    phases=phases if len(unloading) else (),
                )
            )
            site_of.append(site)
            run[own] = number
            step[own] = len(way_down) + np.searchsorted(-unloading, -depth[own])
            if peak == down[-1]:
                loads = rows[~up[rows]]
                run[loads], step[loads] = number, np.searchsorted(way_down, depth[loads])
    return Runs(tuple(planned), np.array(site_of), run, step)


@dataclass(frozen=True)
class TimedRuns:
    """The paths of the readings in time, with memory: indentations alike in site, depths and times are one run."""

    trajectories: tuple[Trajectory, ...]
    run: np.ndarray  # (R,)
    step: np.ndarray  # (R,)
    presses: tuple[str, ...]  # one indentation that each run stands for, in the order taken

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
    presses: list[str] = []
    run, step = np.empty(len(table), int), np.empty(len(table), int)
    rows_of = table.groupby("press").indices
    for press in table["press"].unique():
        rows = rows_of[press]
        part = table.iloc[rows]
        depths = part["depth_mm"].round(DEPTH_DIGITS).to_numpy()
        times = np.maximum.accumulate(part["press_time_s"].round(TIME_DIGITS).to_numpy())
        key = (int(part["site"].iloc[0]), tuple(depths), tuple(times), *((press,) if path_dependent else ()))
        if key not in known:
            known[key] = len(trajectories)
            path, where = _timed_path(observations.sites[key[0]], depths, times, step_mm)
            trajectories.append((path, where))
            presses.append(press)
        run[rows] = known[key]
        step[rows] = trajectories[known[key]][1]
    return TimedRuns(tuple(path for path, _ in trajectories), run, step, tuple(presses))


def _timed_path(place, depths, times, step_mm) -> tuple[Trajectory, list[int]]:
    """Return a path through readings at depths and times, from the first touch on, and which of its steps they are."""
    way = path_through(depths, times, step_mm)
    x, y = (round(float(v), PLACE_DIGITS) for v in place)
    return Trajectory(x, y, way.depths_mm, way.phases, times_s=way.times_s), list(way.readings)
