"""One site: the finite-element solution of one position with all its depths."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from gelforge.config import ConfigError, Indenter, Mechanics, Sensor, Study
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.effects.history import TimedPath, empty_grid, in_time, quadrature_points
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.solving.inputs import inputs_digest
from gelforge.indentation.solving.model import Model, model_of
from gelforge.indentation.solving.site_contents import (
    Solution,
    settings_text,
    site_arrays,
    site_attributes,
    stretch_attributes,
)
from gelforge.indentation.solving.stretch_range import Outside
from gelforge.mechanics.bodies.memory import RememberingBody
from gelforge.mechanics.bodies.peak_grid import PeakGrid
from gelforge.mechanics.contact.state import State
from gelforge.mechanics.indenters.shapes import DOWN
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.sensitivities.direct import Followed
from gelforge.mechanics.solving.equilibrium import NotConverged, Press
from gelforge.mechanics.solving.yielding import follow_yielding
from gelforge.progress import tracked


def simulate_cell(
    study: Study,
    laws: dict[str, PrincipalLaw],
    planned: PlannedCell,
    outside: dict[str, Outside] | None = None,
) -> Cell:
    """Return the solved site of a plan. A site that fails says so in its attributes.

    Parameters
    ----------
    study : Study
        Sensor, indenter, mechanics and approach.
    laws : dict of PrincipalLaw
        By material [MPa].
    planned : PlannedCell
        Position and path.
    outside : dict of Outside, optional
        By material, whether principal stretches leave the range in which its law was tested.

    Returns
    -------
    Cell
        Arrays by depth as in cell_file.DATASETS, without error bars and derivatives.
    """
    return solved_cell(study, laws, planned, outside)[0]


def solved_cell(
    study: Study,
    laws: dict[str, PrincipalLaw],
    planned: PlannedCell,
    outside: dict[str, Outside] | None = None,
) -> tuple[Cell, Solution]:
    """Return what `simulate_cell` does, and the solution along which derivatives can be taken.

    Parameters
    ----------
    study, laws, planned, outside
        As of `simulate_cell`.

    Returns
    -------
    Cell
        As of `simulate_cell`.
    Solution
        Model, solver and the states that were reached.
    """
    sensor = study.sensor
    tested = {layer.name: (outside or {}).get(layer.material) for layer in sensor.layers}
    trajectory = Trajectory.of(planned, study.plan.approach)
    cell, _, solution = _simulated(
        sensor, study.indenter, study.mechanics, sensor.by_layer(laws), trajectory, tested, None
    )
    identity = {"cell": planned.name, "inputs_digest": inputs_digest(study, laws, planned), "source": ""}
    return Cell(cell.arrays, cell.attributes | identity), solution


def simulate_trajectory(
    sensor: Sensor,
    indenter: Indenter,
    mechanics: Mechanics,
    laws: dict[str, PrincipalLaw],
    trajectory: Trajectory,
    outside: dict[str, Outside | None] | None = None,
) -> Cell:
    """Return the solution of a trajectory. What fails ends the site, with its reason.

    Parameters
    ----------
    sensor : Sensor
        Layers and bins.
    indenter : Indenter
        Its shape [mm].
    mechanics : Mechanics
        Mesh, contact, friction and effects.
    laws : dict of str to PrincipalLaw
        By layer [MPa].
    trajectory : Trajectory
        Position and poses [mm, deg].
    outside : dict of Outside, optional
        By layer, whether principal stretches leave the range in which its law was tested.

    Returns
    -------
    Cell
        As of `simulate_cell`.
    """
    return _simulated(sensor, indenter, mechanics, laws, trajectory, outside, None)[0]


def simulate_in_order(
    sensor: Sensor,
    indenter: Indenter,
    mechanics: Mechanics,
    laws: dict[str, PrincipalLaw],
    trajectories: Iterable[Trajectory],
    grid: PeakGrid | None = None,
) -> Iterator[tuple[Cell, PeakGrid | None]]:
    """Yield the solution of each trajectory in the order recorded, and the softening that is left after it. Each begins
    relaxed, with the softening of all before it.

    Parameters
    ----------
    sensor : Sensor
        Geometry and layers.
    indenter : Indenter
        Its shape.
    mechanics : Mechanics
        Mesh, contact and effects.
    laws : dict of str to PrincipalLaw
        By material [MPa].
    trajectories : iterable of Trajectory
        Paths of the indenter.
    grid : PeakGrid, optional
        Softening that is left by others; None for an untouched sensor.

    Yields
    ------
    Cell
        Forces [N] and states of each depth.
    PeakGrid or None
        Softening after it; None for a sensor that does not soften.
    """
    for trajectory in trajectories:
        cell, grid, _ = _simulated(sensor, indenter, mechanics, laws, trajectory, None, grid)
        yield cell, grid


def _solved(
    model: Model,
    press: Press,
    start: State,
    sensor: Sensor,
    mechanics: Mechanics,
    path: TimedPath | None,
    grid: PeakGrid | None,
) -> tuple[Followed, str, PeakGrid | None]:
    """Return the states that were reached, why no more, and the softening left; path: where history matters."""
    followed = Followed(start, model.centres, [], [])
    states = followed.states
    body, mesh = model.body, model.mesh
    presses = path.presses if path else (slice(0, len(model.centres)),)
    times = np.array(path.trajectory.times_s) if path and body.remembers else None
    grid = grid or empty_grid(sensor, mechanics.effects, mesh.regions)
    points = np.empty((0, 0, 3)) if grid is None else quadrature_points(mesh)
    try:
        for poses in presses:
            if grid is not None and isinstance(body, RememberingBody):
                body.forget(grid.read(points, mesh.region, mesh.regions))
                start = replace(start, memory=body.initial)
            steps = follow_yielding(
                press, start, model.centres[poses], model.yielding, None if times is None else times[poses],
                None if path else lambda *step: followed.steps.append(step),
            )  # fmt: skip
            last = start
            steps = tracked(steps, "steps of the indenter", len(model.centres[poses]))
            for number, last in enumerate(steps, start=poses.start):
                if path is None or number in path.readings:
                    states.append(last)
            if grid is not None and isinstance(body, RememberingBody):
                grid = grid.updated(points, mesh.region, mesh.regions, body.initial.peak, last.memory.peak)
    except NotConverged as failure:
        return followed, str(failure), grid
    return followed, "", grid


def _simulated(
    sensor: Sensor,
    indenter: Indenter,
    mechanics: Mechanics,
    laws: dict[str, PrincipalLaw],
    trajectory: Trajectory,
    outside: dict[str, Outside | None] | None,
    grid: PeakGrid | None,
) -> tuple[Cell, PeakGrid | None, Solution]:
    """Return the site of a trajectory, the softening that is left, and the solution; laws and outside by layer."""
    wall_clock, cpu_clock = time.perf_counter(), time.process_time()
    history = mechanics.effects.history
    path = in_time(trajectory, history.timing) if history.any else None
    model = model_of(sensor, indenter, mechanics, laws, path.trajectory if path else trajectory)
    press = Press(model.body, model.shape, model.settings, mechanics.solver.linear_solver)
    start, reason = press.start_at(model.start), ""
    _check_start(press, start)
    if mechanics.effects.geometry.prestretch:
        model, start, reason = _balanced(model, press, start)
    followed = Followed(start, model.centres, [], [])
    if not reason:
        followed, reason, grid = _solved(model, press, start, sensor, mechanics, path, grid)
    solution = Solution(model, press, followed)
    arrays = site_arrays(solution, sensor, mechanics, trajectory)
    top = sensor.layers[-1].name  # its material makes the wall and the flange too
    tested = [(outside or {}).get(name if name in laws else top) for name in model.mesh.regions]
    attributes: dict[str, Any] = stretch_attributes(solution, mechanics, tested)
    attributes |= site_attributes(solution, arrays, sensor, mechanics, trajectory, reason)
    attributes |= {
        "settings": settings_text(sensor, indenter, mechanics, laws),
        "seconds": time.perf_counter() - wall_clock,
        "cpu_seconds": time.process_time() - cpu_clock,
    }
    if path:
        times = path.trajectory.times_s
        attributes["time_s"] = [times[number] for number in path.readings[: len(solution.states)]]
    return Cell(arrays, attributes), grid, solution


def _balanced(model: Model, press: Press, start: State) -> tuple[Model, State, str]:
    """Return the model and its start after the residual stretch has found its balance; why it has not, if so.

    The indenter's path begins where it touches the surface as that then is.
    """
    away = start.centre + [0.0, 0.0, 1.0]  # mm: off the gel while a residual stretch finds its balance
    try:
        relaxed = press.step(None, replace(start, centre=away), away)
    except NotConverged as failure:
        return model, start, f"the residual stretch finds no balance: {failure}"
    centre = start.centre
    for _ in range(20):  # the touch moves with the surface, by what the smallest gap has changed
        gap = press.contact.gap(relaxed.u, centre)[0]
        centre = centre + (gap.min() - start.gap.min()) * DOWN
    moved = centre - start.centre
    gap = press.contact.gap(relaxed.u, centre)[0]
    centres = model.centres + np.pad(moved, (0, model.centres.shape[1] - 3))
    return replace(model, start=centre, centres=centres), replace(relaxed, centre=centre, gap=gap), ""


def _check_start(press: Press, start: State) -> None:
    points = press.contact.X + start.u[press.surface]
    inside = -float(press.indenter.gap(points, start.centre)[0].min())
    if inside > 1e-9:
        raise ConfigError(
            f"the indenter starts {inside:.3g} mm inside the gel at the first touch of its lowest point; "
            "correct its offset_mm or the sensor's surface"
        )
