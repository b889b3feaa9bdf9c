"""Derivatives of converged states: neighbouring presses follow the base press step by step.

A neighbour differs a little in one parameter (a constant of a law, a stiffness, the place of nodes, the indenter, its
path, a setting). At each converged state of the base it starts from that state, moved by what it differed before, and is
brought to its own equilibrium with the factorisation at hand, unsymmetric terms of contact included. So friction and
contact carry their history through the steps as in a run of its own, at the cost of a few back-substitutions.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.state import Settings, State
from gelforge.mechanics.contact.surface import Iterate, SurfaceContact
from gelforge.mechanics.indenters.shapes import Indenter
from gelforge.mechanics.solving.equilibrium import Press, unknowns

# The last correction over all of them: each is a third of the one before or less, so that less than this is left.
DIFFERENCE_TOLERANCE = 3e-4
MAX_CORRECTIONS = 15


class Neighbour(Press):
    """A press beside a base press, with its own body, indenter, settings and path (D, 3) or (D, 6) [mm, rad].

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
        tolerance: float = DIFFERENCE_TOLERANCE,
    ):
        if not np.array_equal(body.mesh.elements, base.body.mesh.elements):
            raise ValueError(
                "the neighbour's mesh has other elements than the base's; solve it by itself instead"
            )
        vars(self).update(vars(base))  # shares the linear solver and what it has factorised
        self.base, self.body = base, body
        self.indenter, self.settings = indenter, settings
        self.contact = SurfaceContact(body, indenter, settings)
        self.area = self.contact.area
        self.centres, self.tolerance = np.asarray(centres, dtype=float), tolerance
        self.undeformed = self.start_at(_as_long(start, self.centres[0]))
        self.seconds = 0.0  # wall seconds spent beside the base

    def beside(self, old: State, before: State, after: State, centre: np.ndarray) -> State:
        """Return the state at centre beside the base's state `after`, from the state `old` beside `before`.

        To be called while the base's factorisation is that of `after`. Raises NotConverged.
        """
        self._factored_blocks, contact = self.base._factored_blocks, self.contact
        u, pressure, lam, friction = (
            now + own - then for now, own, then in zip(unknowns(after), unknowns(old), unknowns(before))
        )
        active = after.contact_pressure > 0
        lam = np.where(active, np.maximum(lam, 0.0), 0.0)
        move = contact.step(old, centre)
        at = Iterate(u, pressure, lam, friction, active, *contact.gap(u, centre))
        moved, last = 0.0, np.inf  # lengths of all corrections and of the last one
        for iteration in range(MAX_CORRECTIONS):
            response, forces = self._evaluate(at), contact.forces(at, move)
            if last <= self.tolerance * max(moved, np.linalg.norm(at.u - after.u)):
                residual = self._residual(response, forces)
                return self._converged(old, centre, at, response, forces, iteration, 0, residual)
            du = self._correction(response, forces, consistent=True)
            last = np.linalg.norm(du)
            moved += last
            if not np.isfinite(last):
                break
            at = contact.corrected(at, forces, du, self.body.linearised_pressure(response, du), centre)
        # Too far for the base's factorisation: a step of its own. The base factorises anew at its next step anyway.
        state = self.step(None, old, centre)
        self.base._factored_blocks = self._factored_blocks
        return state


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
