"""Derivatives of converged states by direct differentiation, path history included.

At a converged step R(u, p, history) = 0, so that K du/dp = -dR/dp with the consistent tangent K: one factorisation, and one
solve for all parameters together. dR/dp is a difference of forces at the base's own displacements: internal ones
of the bodies (force_differences), and those of the contact (contact_differences), into which the history enters by how the
displacements of the steps before follow the parameter. No parameter needs an iteration of its own.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.state import Settings, State
from gelforge.mechanics.contact.surface import SurfaceContact
from gelforge.mechanics.indenters.shapes import DOWN, Indenter
from gelforge.mechanics.linear.sparse import NotPositiveDefinite
from gelforge.mechanics.linear.unsymmetric import UnsymmetricTangent
from gelforge.mechanics.sensitivities.contact_differences import (
    Held,
    beside,
    force_change,
    held_at,
    moved_before,
    repeated,
    seen_at,
    stiffness_at,
    touching,
)
from gelforge.mechanics.sensitivities.force_differences import ForceDifferences
from gelforge.mechanics.solving.equilibrium import NotConverged, Press, padded

# Derivatives against differences of full solutions (tests/verification/test_direct_sensitivities.py):
LITTLE = 1e-4  # of what a residual stretch moves per unit


@dataclass(frozen=True)
class Varied:
    """What an indentation has that differs from a base by a small amount of one parameter.

    Nodes may lie elsewhere than the base's; elements must be the same.
    """

    body: Body
    indenter: Indenter
    settings: Settings
    start: np.ndarray  # (3,) of the indenter [mm]
    centres: np.ndarray  # (D, 3) or (D, 6) of its path [mm, rad]
    amount: float


@dataclass(frozen=True)
class Slopes:
    """Derivatives of a state along P parameters."""

    force: np.ndarray  # (P, S, 3) of the contact on the surface nodes [N/unit]
    u: np.ndarray  # (P, N, 3) [mm/unit]; (P, 0, 3) where only forces are wanted


@dataclass(frozen=True)
class Followed:
    """A path that a press has gone, as far as it came."""

    start: State
    centres: np.ndarray  # (D, 3) or (D, 6) of the whole path
    states: list[State]  # at the centres reached
    steps: list[tuple[State, State]]  # before and after each step, halves included


def follow_with_slopes(
    base: Press,
    start: State,
    centres: np.ndarray,
    varied: Sequence[Varied],
    seconds: list[float] | None = None,
    forces_only: bool = False,
) -> Iterator[tuple[State, Slopes]]:
    """Yield the state at each centre of the indenter, with its derivatives along varied indentations.

    The base goes its whole way before the first state is yielded.

    Parameters
    ----------
    base : Press
        Body, indenter and settings.
    start : State
        In equilibrium.
    centres : numpy.ndarray
        (D, 3) [mm], or (D, 6) with turns [rad].
    varied : sequence of Varied
        Indentations that differ by a small amount.
    seconds : list of float, optional
        As of slopes_along.
    forces_only : bool
        As of slopes_along.

    Yields
    ------
    State
        At one centre.
    Slopes
        Derivatives of forces [N] and displacements [mm] per unit of each amount.

    Raises
    ------
    NotConverged
        As the base raises it, after the states that it has reached.
    ValueError
        Where a mesh has other elements, or the body remembers.
    """
    _check(base, varied)
    path, failure = Followed(start, np.asarray(centres, dtype=float), [], []), None
    try:
        for state in base.follow(start, path.centres, lambda *step: path.steps.append(step)):
            path.states.append(state)
    except NotConverged as error:
        failure = error
    yield from slopes_along(base, path, varied, seconds, forces_only)
    if failure is not None:
        raise failure


def slopes_along(
    base: Press,
    followed: Followed,
    varied: Sequence[Varied],
    seconds: list[float] | None = None,
    forces_only: bool = False,
) -> Iterator[tuple[State, Slopes]]:
    """Yield the states of a path that the base has gone, with their derivatives along each varied indentation.

    Which nodes are in contact anywhere on it is known, and the derivatives are carried at these.

    Parameters
    ----------
    base : Press
        Body, indenter and settings.
    followed : Followed
        The path, with its states and steps.
    varied : sequence of Varied
        P indentations that differ by a small amount.
    seconds : list of float, optional
        To it the wall seconds of every step's derivatives are added.
    forces_only : bool
        The derivatives are carried at no other nodes.

    Yields
    ------
    State
        At one centre.
    Slopes
        Derivatives of forces [N] and displacements [mm] per unit of each amount.

    Raises
    ------
    ValueError
        Where a mesh has other elements, or the body remembers.
    """
    _check(base, varied)
    chain = _Chain(base, varied, forces_only)
    start, centres = followed.start, followed.centres
    path = np.vstack([padded(start.centre, centres.shape[1]), centres])
    shifts = np.array([np.vstack([padded(v.start, centres.shape[1]), v.centres]) - path for v in varied])
    shifts = shifts.reshape(len(varied), *path.shape)
    shifts += chain.begin(start, shifts[:, 0], [after for _, after in followed.steps])[:, None]
    steps = iter(followed.steps)
    for number, state in enumerate(followed.states):
        length = np.linalg.norm(path[number + 1] - path[number])
        for before, after in steps:
            share = np.linalg.norm(after.centre - path[number]) / length if length else 1.0
            clock = time.perf_counter()
            chain.advance(before, after, (1 - share) * shifts[:, number] + share * shifts[:, number + 1])
            if seconds is not None:
                seconds.append(time.perf_counter() - clock)
            if after.u is state.u:
                break
        yield state, chain.slopes


def _check(base: Press, varied: Sequence[Varied]) -> None:
    for one in varied:
        if not np.array_equal(one.body.mesh.elements, base.body.mesh.elements):
            raise ValueError(
                "a varied indentation has a mesh of other elements than the base's; subtract two solutions instead"
            )


def _same(one: Any, other: Any) -> bool:
    """Return whether two indenters, or what they are made of, are equal."""
    if one is other or type(one) is not type(other):
        return one is other
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(_same, one, other))
    if is_dataclass(one):
        return all(_same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    return one == other


class _Chain:
    """Derivatives carried from step to step."""

    def __init__(self, base: Press, varied: Sequence[Varied], forces_only: bool = False):
        self.base, self.varied, self.forces_only = base, varied, forces_only
        self.amounts = np.array([one.amount for one in varied]).reshape(-1, 1, 1)
        self.internal = ForceDifferences(base.body, [one.body for one in varied], self.amounts.ravel())
        self.only_body = np.array(
            [
                _same(one.indenter, base.indenter)
                and one.settings == base.settings
                and (one.body is base.body or np.array_equal(one.body.mesh.X, base.body.mesh.X))
                for one in varied
            ],
            dtype=bool,
        )
        self.free = np.flatnonzero(base.free)
        self.values = np.empty(len(base.body.pattern.indices))
        P, N, S = len(varied), len(base.body.mesh.X), len(base.surface)
        self.slopes = Slopes(np.zeros((P, S, 3)), np.zeros((P, 0 if forces_only else N, 3)))

    def begin(self, start: State, shifts: np.ndarray, afters: Sequence[State]) -> np.ndarray:
        """Take shifts (P, 3) or (P, 6) of the indenter at the start, by which the varied starts differ from the base's.

        afters: all states of the path. Return by how much more the starts differ (P, 1, 3 or 6): a residual stretch moves
        the surface before it is touched, and every path begins where it then touches.
        """
        lifts = np.zeros_like(shifts)
        if not self.varied:
            return lifts
        base, P = self.base, len(self.varied)
        touches = [touching(base.contact, after) for after in afters]
        # of the surface
        self.nodes = np.flatnonzero(np.any(touches, axis=0)) if touches else np.empty(0, int)
        nodes = base.surface[self.nodes]
        self.tangent = UnsymmetricTangent(base.body.pattern, nodes, base.corrections.solver.name)
        self.u = np.zeros((P, len(nodes), 3))  # slope at these nodes, and of their last motion
        self.moved = np.zeros_like(self.u)
        load = -self.internal.at(start.u, start.pressure)
        balanced = [k for k in range(P) if load[k].any()]
        if balanced:
            self._factor(start, np.zeros((len(nodes), 3, 3)))
            moves = self._everywhere(load[balanced])
            self.u[balanced] = moves[:, nodes]
            for k, move in zip(balanced, moves):
                ends = [start.u + sign * LITTLE * move for sign in (1, -1)]
                above, below = (base.contact.gap(u, start.centre)[0].min() for u in ends)
                lifts[k, :3] = (above - below) / (2 * LITTLE) * self.amounts[k, 0] * DOWN
        self.shift, self.turn_of_path = shifts + lifts, np.zeros_like(shifts)
        return lifts

    def advance(self, before: State, after: State, shifts: np.ndarray) -> None:
        """Carry the derivatives over a step of the base, at whose end the varied indenters are moved by shifts."""
        if not self.varied:
            return
        base = self.base
        held, contact = held_at(base.contact, before, after)
        place = np.searchsorted(self.nodes, held.nodes)
        by_contact = self._contact_differences(contact, held, place, before, shifts)
        load = -self.internal.at(after.u, after.pressure)
        load[:, base.surface[held.nodes]] += by_contact
        blocks = np.zeros((len(self.nodes), 3, 3))
        blocks[place] = stiffness_at(contact, held)
        self._factor(after, blocks)
        if self.forces_only:
            everywhere = self.slopes.u
            u = self.tangent.solve_at_nodes(self._right_hand_sides(load))
        else:
            everywhere = self._everywhere(load)
            u = everywhere[:, base.surface[self.nodes]]
        force = np.zeros_like(self.slopes.force)
        force[:, held.nodes] = by_contact - np.einsum("sij,psj->psi", blocks[place], u[:, place])
        self.moved, self.u = u - self.u, u
        self.turn_of_path, self.shift = shifts - self.shift, shifts
        self.slopes = Slopes(force, everywhere)

    def _contact_differences(
        self, contact: SurfaceContact, held: Held, place: np.ndarray, before: State, shifts: np.ndarray
    ) -> np.ndarray:
        """Return d contact force / d amount (P, n, 3) at the held nodes, which stay where they are at the step's end.

        place (n,): theirs among the nodes at which derivatives are carried.
        """
        u, moved = self.u[:, place], self.moved[:, place]
        differences = np.empty((len(self.varied), len(held.nodes), 3))
        # Of what leaves indenter, path, settings and nodes alone only the history counts: all of it is looked at together.
        together = np.flatnonzero(self.only_body & ~shifts.any(axis=1) & ~self.shift.any(axis=1))
        if len(together) and len(held.nodes):
            differences[together] = self._by_history(contact, held, together, u[together], moved[together])
        for k in np.setdiff1d(np.arange(len(self.varied)), together):
            one = self.varied[k]
            other = beside(contact, held, one.body.mesh, one.indenter, one.settings)
            begun = padded(before.centre, shifts.shape[1]) + self.shift[k]
            travel = None if before.travel is None else before.travel + self.turn_of_path[k]
            old = moved_before(other, held, one.amount * u[k], one.amount * moved[k], begun, travel)
            seen = seen_at(other, old, held.centre + shifts[k], held.u, held.pressure, held.active)
            differences[k] = force_change(held, held.seen.change_to(seen, one.amount))
        return differences

    def _by_history(
        self, contact: SurfaceContact, held: Held, which: np.ndarray, u: np.ndarray, moved: np.ndarray
    ) -> np.ndarray:
        """Return d contact force / d amount (m, n, 3) of parameters (m,) that only the history brings to the contact.

        u and moved (m, n, 3): slopes of the displacements before the step and of the motion that led there.
        """
        many, all_of_them = repeated(contact, held, len(which))
        amounts = self.amounts[which]
        du, dmoved = ((amounts * one).reshape(-1, 3) for one in (u, moved))
        begun = padded(held.old.centre, len(held.centre))
        old = moved_before(many, all_of_them, du, dmoved, begun, held.old.travel)
        seen = seen_at(many, old, held.centre, all_of_them.u, all_of_them.pressure, all_of_them.active)
        change = force_change(all_of_them, all_of_them.seen.change_to(seen, 1.0))
        return change.reshape(len(which), -1, 3) / amounts

    def _factor(self, at: State, blocks: np.ndarray) -> None:
        """Factorise the tangent of a state with contact blocks (n, 3, 3). Raises NotConverged."""
        self.base.body.response(at.u, at.pressure, self.values)
        try:
            self.tangent.factor(self.values, blocks)
        except NotPositiveDefinite as error:
            raise NotConverged(f"the derivatives' tangent cannot be factorised: {error}") from None

    def _right_hand_sides(self, load: np.ndarray) -> np.ndarray:
        return np.take(load.reshape(len(load), -1), self.free, axis=1)

    def _everywhere(self, load: np.ndarray) -> np.ndarray:
        """Return du / d amount (P, N, 3) under loads (P, N, 3) [N/unit]."""
        du = np.zeros((len(load), load[0].size))
        du[:, self.free] = self.tangent.solve(self._right_hand_sides(load))
        return np.stack([self.base.body.spread(one) for one in du.reshape(load.shape)])
