"""Indentations as paths in time, and what regions remember of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gelforge.config import Effects, Sensor
from gelforge.config.parts.effects import PressTiming
from gelforge.indentation.effects.material import by_region
from gelforge.indentation.effects.surfaces import layer_heights
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.mechanics.bodies.memory import Relaxation, Softening
from gelforge.mechanics.bodies.peak_grid import PeakGrid
from gelforge.mechanics.meshes.elements import ELEMENTS
from gelforge.mechanics.meshes.mesh import Mesh


@dataclass(frozen=True)
class TimedPath:
    """Poses in time of one indentation after another, each from rest, and those that are readings."""

    trajectory: Trajectory  # with times_s
    presses: tuple[slice, ...]
    readings: tuple[int, ...]


def relaxation_of(sensor: Sensor, effects: Effects, regions: tuple[str, ...]) -> dict[str, Relaxation]:
    """Return the branches of each region that relaxes; those without modulus are left out."""
    chosen = by_region(effects.history.viscoelastic, regions, sensor.layers[-1].name, None)
    return {
        name: Relaxation(tuple(prony.relative_moduli), tuple(prony.times_s))
        for name, prony in chosen.items()
        if prony and any(prony.relative_moduli)
    }


def softening_of(sensor: Sensor, effects: Effects, regions: tuple[str, ...]) -> dict[str, Softening]:
    """Return the softening of each region that softens."""
    chosen = by_region(effects.history.mullins, regions, sensor.layers[-1].name, None)
    return {
        name: Softening(mullins.amount, mullins.m_kPa * 1e-3, mullins.beta)
        for name, mullins in chosen.items()
        if mullins and mullins.amount
    }


def in_time(trajectory: Trajectory, timing: PressTiming) -> TimedPath:
    """Return a trajectory as paths in time.

    One that has times keeps them; one with phases of its own gets them from the speed, a pose that does not move is a wait.
    Planned depths become indentations of their own: down in steps, then the wait; the reading is at its end.

    Parameters
    ----------
    trajectory : Trajectory
        Depths [mm], with or without phases and times [s].
    timing : PressTiming
        Speed [mm/s], wait [s] and steps.

    Returns
    -------
    TimedPath
        The trajectory with times, its indentations, and which of its poses are readings.
    """
    if trajectory.times_s or trajectory.is_path:
        count = len(trajectory.depths_mm)
        timed = trajectory.changed(times_s=tuple(trajectory.times_s or _times_along(trajectory, timing)))
        return TimedPath(timed, (slice(0, count),), tuple(range(count)))
    depths: list[float] = []
    times: list[float] = []
    phases: list[str] = []
    presses, readings = [], []
    for depth in trajectory.depths_mm:
        first = len(depths)
        steps = max(1, math.ceil(depth / timing.step_mm - 1e-9))
        down = [depth * k / steps for k in range(1, steps + 1)]
        depths += down
        times += [d / timing.speed_mm_per_s for d in down]
        phases += ["load"] * steps
        if timing.dwell_s:
            # relaxation slows down: ten steps span a factor of 2^10 in time
            ends = np.cumsum(2.0 ** np.arange(timing.dwell_steps))
            depths += [depth] * timing.dwell_steps
            times += [float(t) for t in depth / timing.speed_mm_per_s + timing.dwell_s * ends / ends[-1]]
            phases += ["dwell"] * timing.dwell_steps
        presses.append(slice(first, len(depths)))
        readings.append(len(depths) - 1)
    timed = trajectory.changed(depths_mm=tuple(depths), phases=tuple(phases), times_s=tuple(times))
    return TimedPath(timed, tuple(presses), tuple(readings))


def _times_along(trajectory: Trajectory, timing: PressTiming) -> list[float]:
    """Return when each pose is reached at the stated speed."""
    moves = np.diff(np.column_stack([trajectory.depths_mm, trajectory.shears]), axis=0, prepend=0.0)
    way = np.linalg.norm(moves, axis=1)
    waits = np.where(way > 0, way / timing.speed_mm_per_s, timing.dwell_s)
    return [float(t) for t in np.cumsum(waits)]


def empty_grid(sensor: Sensor, effects: Effects, regions: tuple[str, ...]) -> PeakGrid | None:
    """Return the grid that keeps the softening of a sensor that nobody has pressed; None where nothing softens."""
    softens = list(softening_of(sensor, effects, regions))
    if not softens:
        return None
    heights = layer_heights(sensor)
    spans = {layer.name: (heights[k], heights[k + 1]) for k, layer in enumerate(sensor.layers)}
    spans |= {"wall": (heights[0], heights[-2]), "flange": (heights[0], heights[-2])}
    if effects.geometry.base:
        spans["base"] = (heights[0] - effects.geometry.base.thickness_mm, heights[0])
    beyond = sensor.flange.width_mm if sensor.flange else 0.0
    extents = {
        name: (
            np.array([-beyond, -beyond, spans[name][0]]),
            np.array([sensor.width_x_mm + beyond, sensor.width_y_mm + beyond, spans[name][1]]),
        )
        for name in softens
    }
    return PeakGrid.empty(extents, effects.history.grid_mm, softens)


def quadrature_points(mesh: Mesh) -> np.ndarray:
    """Return the undeformed quadrature points (E, Q, 3) [mm]."""
    kind = ELEMENTS[mesh.elements.shape[1]]
    return np.einsum("qa,eai->eqi", kind.shape(kind.points), mesh.X[mesh.elements])
