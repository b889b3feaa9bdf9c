"""Derivatives of converged states by differences: neighbouring presses follow the base press step by step.

A neighbour differs a little in one parameter (a constant of a law, a stiffness, the place of nodes, the indenter, its
path, a setting). At each converged state of the base it begins at that state, moved by what it differed before, and is
brought to its own equilibrium. So friction and contact carry their history through the steps as in a run of its own.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.state import Settings, State
from gelforge.mechanics.indenters.shapes import Indenter
from gelforge.mechanics.solving.equilibrium import Press, unknowns

# A difference of two states needs both to be converged far beyond what it is of them.
EXACT = {"force_tolerance": 1e-9, "gap_tolerance": 1e-8, "volume_tolerance": 1e-9}


class Neighbour(Press):
    """A press next to a base press, with its own body, indenter, settings and path (D, 3) or (D, 6) [mm, rad].

    Its mesh must have the base's elements: nodes may lie elsewhere, but not be others.
    """

    def __init__(
        self,
        base: Press,
        body: Body,
        indenter: Indenter,
        settings: Settings,
        start: np.ndarray,
        centres: np.ndarray,
    ):
        if not np.array_equal(body.mesh.elements, base.body.mesh.elements):
            raise ValueError(
                "the neighbour's mesh has other elements than the base's; solve it by itself instead"
            )
        super().__init__(body, indenter, settings, base.corrections.solver.name)
        self.centres = np.asarray(centres, dtype=float)
        self.undeformed = self.start_at(_as_long(start, self.centres[0]))
        self.seconds = 0.0  # wall seconds spent next to the base

    def beside(self, old: State, before: State, after: State, centre: np.ndarray) -> State:
        """Return the state at centre next to the base's state `after`, from the state `old` next to `before`.

        Raises NotConverged.
        """
        u, pressure, lam, friction = (
            now + own - then for now, own, then in zip(unknowns(after), unknowns(old), unknowns(before))
        )
        lam = np.where(after.contact_pressure > 0, np.maximum(lam, 0.0), 0.0)
        guess = replace(after, u=u, pressure=pressure, contact_pressure=lam, friction_force=friction)
        return self.step(None, old, centre, guess)


def follow_beside(
    base: Press, start: State, centres: np.ndarray, neighbours: list[Neighbour]
) -> Iterator[tuple[State, list[State]]]:
    """Yield the base's state at each centre (D, 3) or (D, 6) in turn, and its neighbours' states there.

    Raises NotConverged.
    """
    centres = np.asarray(centres, dtype=float)
    path = np.vstack([_as_long(start.centre, centres[0]), centres])
    shifts = [np.vstack([near.undeformed.centre, near.centres]) - path for near in neighbours]
    states = [near.undeformed for near in neighbours]
    reached = 0  # the last place of the path that the base has reached

    def watch(before: State, after: State) -> None:
        step = np.linalg.norm(path[reached + 1] - path[reached])
        share = np.linalg.norm(after.centre - path[reached]) / step if step else 1.0
        for k, near in enumerate(neighbours):
            shift = (1 - share) * shifts[k][reached] + share * shifts[k][reached + 1]
            clock = time.perf_counter()
            states[k] = near.beside(states[k], before, after, after.centre + shift)
            near.seconds += time.perf_counter() - clock

    for state in base.follow(start, centres, watch):
        reached += 1
        yield state, list(states)


def _as_long(vector: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return a vector with zeros after it, to be as long as another."""
    return np.concatenate([vector, np.zeros(len(other) - len(vector))])
