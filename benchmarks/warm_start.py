"""What a cell would win by starting from its neighbour: iterations and factorisations of a press, by where a depth begins.

A depth begins where the last two depths point (what the solver does), at the last depth, or at the last depth plus what the
neighbouring cell, 0.55 mm away and solved before, did between the two: its displacements and pressures, carried along with
the indenter and interpolated on the cell's own mesh.

usage: python benchmarks/warm_start.py [--x 20.4 --y 17.65]     (one thread; a minute)
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

from gelforge.api.studies import paper_study
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.solving.simulate import Model, model_of
from gelforge.laws_of_study import laws_of
from gelforge.mechanics.contact.state import State
from gelforge.mechanics.solving.equilibrium import NotConverged, Press

DEPTHS = tuple(0.25 * (k + 1) for k in range(8))
SPACING = 0.55  # mm, of the article's grid


def pressed(x: float, y: float) -> tuple[Model, Press, State]:
    """Return the model of a press at (x, y) [mm], its solver and its undeformed start."""
    study = paper_study()
    laws = laws_of(study, [])
    by_layer = {layer.name: laws[layer.material] for layer in study.sensor.layers}
    trajectory = Trajectory.of(PlannedCell("press", x, y, DEPTHS), study.plan.approach)
    model = model_of(study.sensor, study.indenter, study.mechanics, by_layer, trajectory)
    press = Press(model.body, model.shape, model.settings, study.mechanics.solver.linear_solver)
    return model, press, press.start_at(model.start)


def carried(model: Model, states: list[State], own: Model, shift: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    """Return what a neighbour's states (u, pressure, contact pressure) did from each depth to the next, on the own mesh."""
    middle, own_middle = (m.mesh.X[m.mesh.elements].mean(axis=1) for m in (model, own))
    top, own_top = (m.mesh.X[m.mesh.surface.nodes] for m in (model, own))
    moves = []
    for before, after in zip(states[:-1], states[1:]):
        du = after.u - before.u
        inside = LinearNDInterpolator(model.mesh.X, du)(own.mesh.X - shift)
        outside = NearestNDInterpolator(model.mesh.X, du)(own.mesh.X - shift)
        u = np.where(np.isnan(inside), outside, inside)
        u[own.mesh.fixed] = 0.0
        u = own.body.spread(u)
        pressure = NearestNDInterpolator(middle, after.pressure - before.pressure)(own_middle - shift)
        contact = NearestNDInterpolator(top, after.contact_pressure - before.contact_pressure)(
            own_top - shift
        )
        moves.append((u, pressure, contact))
    return moves


def begun(way: str, states: list[State], moves: list[tuple[np.ndarray, ...]]) -> State | None:
    """Return the state that a step begins at after these states, or None for the solver's own prediction."""
    last = states[-1]
    if way == "last two depths":
        return None
    if way == "last depth":
        return last
    u, pressure, contact = moves[len(states) - 1]
    contact = np.maximum(last.contact_pressure + contact, 0.0)
    return replace(last, u=last.u + u, pressure=last.pressure + pressure, contact_pressure=contact)


def followed(way: str, model: Model, press: Press, start: State, moves: list) -> dict:
    """Return the row of a way to begin: iterations, factorisations, and the force that all ways have to agree on."""
    states = [start]
    reason = ""
    try:
        for centre in model.centres:
            previous = states[-2] if len(states) > 1 else None
            states.append(press.step(previous, states[-1], centre, begun(way, states, moves)))
    except NotConverged as failure:
        reason = str(failure)[:60]
    done = states[1:]
    return {
        "a depth begins at": way,
        "depths": len(done),
        "iterations": sum(state.iterations for state in done),
        "factorisations": sum(state.factorisations for state in done),
        "iterations per depth": " ".join(str(state.iterations) for state in done),
        "-Fz at the last depth [N]": -done[-1].force[2] if done else None,
        "ended early": reason,
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--x", type=float, default=20.4)
    parser.add_argument("--y", type=float, default=17.65)
    arguments = parser.parse_args()
    beside, solver, start = pressed(arguments.x - SPACING, arguments.y)
    theirs = [start, *solver.follow(start, beside.centres)]
    model, press, start = pressed(arguments.x, arguments.y)
    moves = carried(beside, theirs, model, np.array([SPACING, 0.0, 0.0]))
    ways = ("last two depths", "last depth", "last depth + neighbour")
    print(pd.DataFrame([followed(way, model, press, start, moves) for way in ways]).to_markdown(index=False))


if __name__ == "__main__":
    main()
