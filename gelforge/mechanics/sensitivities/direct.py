"""Derivatives of converged states by direct differentiation, path history included.

At a converged step R(u, p, history) = 0, so that K du/dp = -dR/dp with the consistent tangent K: one factorisation, and one
back-substitution of all parameters together. dR/dp is a difference of forces at the base's own displacements: internal ones
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
)
from gelforge.mechanics.sensitivities.force_differences import ForceDifferences
from gelforge.mechanics.solving.equilibrium import Press, padded

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
    u: np.ndarray  # (P, N, 3) [mm/unit]


def follow_with_slopes(
    base: Press,
    start: State,
    centres: np.ndarray,
    varied: Sequence[Varied],
    seconds: list[float] | None = None,
) -> Iterator[tuple[State, Slopes]]:
    """Yield the base's state at each centre (D, 3) or (D, 6) in turn, with its derivatives along each varied indentation.

    seconds: to it the wall seconds of every step's derivatives are added. Raises NotConverged as the base does, ValueError
    where a mesh has other elements or the body remembers.
    """
    centres = np.asarray(centres, dtype=float)
    chain = _Chain(base, varied)
    path = np.vstack([padded(start.centre, centres.shape[1]), centres])
    shifts = np.array([np.vstack([padded(v.start, centres.shape[1]), v.centres]) - path for v in varied])
    shifts = shifts.reshape(len(varied), *path.shape)
    reached = 0  # the last place of the path that the base has reached

    def watch(before: State, after: State) -> None:
        step = np.linalg.norm(path[reached + 1] - path[reached])
        share = np.linalg.norm(after.centre - path[reached]) / step if step else 1.0
        clock = time.perf_counter()
        chain.advance(before, after, (1 - share) * shifts[:, reached] + share * shifts[:, reached + 1])
        if seconds is not None:
            seconds.append(time.perf_counter() - clock)

    shifts += chain.begin(start, shifts[:, 0])[:, None]
    for state in base.follow(start, centres, watch):
        reached += 1
        yield state, chain.slopes


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

    def __init__(self, base: Press, varied: Sequence[Varied]):
        for one in varied:
            if not np.array_equal(one.body.mesh.elements, base.body.mesh.elements):
                raise ValueError(
                    "a varied indentation has a mesh of other elements than the base's; subtract two solutions instead"
                )
        self.base, self.varied = base, varied
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
        self.tangent: UnsymmetricTangent | None = None  # made when it is first needed
        self.free = np.flatnonzero(base.free)
        self.values = np.empty(len(base.body.pattern.indices))
        P, N, S = len(varied), len(base.body.mesh.X), len(base.surface)
        self.slopes = Slopes(np.zeros((P, S, 3)), np.zeros((P, N, 3)))
        self.moved = np.zeros((P, S, 3))  # slope of the surface nodes' last motion

    def begin(self, start: State, shifts: np.ndarray) -> np.ndarray:
        """Take shifts (P, 3) or (P, 6) of the indenter at the start, by which the varied starts differ from the base's.

        Return by how much more they do (P, 1, 3 or 6): a residual stretch moves the surface before it is touched, and every
        path begins where it then touches.
        """
        lifts = np.zeros_like(shifts)
        if not self.varied:
            return lifts
        load = -self.internal.at(start.u, start.pressure)
        balanced = [k for k in range(len(load)) if load[k].any()]
        if balanced:
            base = self.base
            none = np.empty(0, int), np.empty((0, 3, 3))
            self.slopes.u[balanced] = self._solved(start, *none, load[balanced])
            for k in balanced:
                ends = [
                    base.contact.gap(start.u + sign * LITTLE * self.slopes.u[k], start.centre)[0].min()
                    for sign in (1, -1)
                ]
                lifts[k, :3] = (ends[0] - ends[1]) / (2 * LITTLE) * self.amounts[k, 0] * DOWN
        self.shift, self.turn_of_path = shifts + lifts, np.zeros_like(shifts)
        return lifts

    def advance(self, before: State, after: State, shifts: np.ndarray) -> None:
        """Carry the derivatives over a step of the base, at whose end the varied indenters are moved by shifts."""
        if not self.varied:
            return
        base = self.base
        held, contact = held_at(base.contact, before, after)
        by_contact = self._contact_differences(contact, held, before, shifts)
        load = -self.internal.at(after.u, after.pressure)
        load[:, base.surface[held.nodes]] += by_contact
        blocks = stiffness_at(contact, held)
        du = self._solved(after, held.nodes, blocks, load)
        on_surface = du[:, base.surface]
        force = np.zeros_like(on_surface)
        force[:, held.nodes] = by_contact - np.einsum("sij,psj->psi", blocks, on_surface[:, held.nodes])
        self.moved = on_surface - self.slopes.u[:, base.surface]
        self.turn_of_path, self.shift = shifts - self.shift, shifts
        self.slopes = Slopes(force, du)

    def _contact_differences(
        self, contact: SurfaceContact, held: Held, before: State, shifts: np.ndarray
    ) -> np.ndarray:
        """Return d contact force / d amount (P, n, 3) at the held nodes, which stay where they are at the step's end."""
        u = self.slopes.u[:, self.base.surface[held.nodes]]
        found = np.empty((len(self.varied), len(held.nodes), 3))
        # Of what leaves indenter, path, settings and nodes alone only the history counts: all of it is looked at together.
        together = np.flatnonzero(self.only_body & ~shifts.any(axis=1) & ~self.shift.any(axis=1))
        if len(together) and len(held.nodes):
            found[together] = self._by_history(contact, held, together)
        for k in np.setdiff1d(np.arange(len(self.varied)), together):
            one = self.varied[k]
            other = beside(contact, held, one.body.mesh, one.indenter, one.settings)
            old = moved_before(
                other,
                held,
                one.amount * u[k],
                one.amount * self.moved[k, held.nodes],
                padded(before.centre, shifts.shape[1]) + self.shift[k],
                None if before.travel is None else before.travel + self.turn_of_path[k],
            )
            seen = seen_at(other, old, held.centre + shifts[k], held.u, held.pressure, held.active)
            found[k] = force_change(held, held.seen.change_to(seen, one.amount))
        return found

    def _by_history(self, contact: SurfaceContact, held: Held, which: np.ndarray) -> np.ndarray:
        """Return d contact force / d amount (m, n, 3) of parameters (m,) that only the history brings to the contact."""
        many, all_of_them = repeated(contact, held, len(which))
        nodes, amounts = self.base.surface[held.nodes], self.amounts[which]
        du = (amounts * self.slopes.u[which][:, nodes]).reshape(-1, 3)
        dmoved = (amounts * self.moved[which][:, held.nodes]).reshape(-1, 3)
        before = held.old
        old = moved_before(
            many, all_of_them, du, dmoved, padded(before.centre, len(held.centre)), before.travel
        )
        seen = seen_at(many, old, held.centre, all_of_them.u, all_of_them.pressure, all_of_them.active)
        change = force_change(all_of_them, all_of_them.seen.change_to(seen, 1.0))
        return change.reshape(len(which), -1, 3) / amounts

    def _solved(self, after: State, nodes: np.ndarray, blocks: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Return du / d amount (P, N, 3) under loads (P, N, 3) [N/unit], with contact blocks (n, 3, 3) of surface nodes."""
        base = self.base
        if self.tangent is None:
            self.tangent = UnsymmetricTangent(base.body.pattern, base.surface, base.corrections.solver.name)
        base.body.response(after.u, after.pressure, self.values)
        everywhere = np.zeros((len(base.surface), 3, 3))
        everywhere[nodes] = blocks
        self.tangent.factor(self.values, everywhere)
        flat, du = load.reshape(len(load), -1), np.zeros((len(load), load[0].size))
        du[:, self.free] = self.tangent.solve(np.take(flat, self.free, axis=1))
        return np.stack([base.body.spread(one) for one in du.reshape(load.shape)])
