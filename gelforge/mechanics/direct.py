"""Derivatives of converged states by direct differentiation, path history included.

At a converged step R(u, p, history) = 0, so that K du/dp = -dR/dp with the consistent tangent K: one factorisation, and one
back-substitution of all parameters together. dR/dp is a difference of forces at the base's own displacements: internal ones
of the bodies (force_differences), and those of the contact (contact_differences), into which the history enters by how the
displacements of the steps before follow the parameter. No parameter needs an iteration of its own.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gelforge.mechanics.body import Body
from gelforge.mechanics.contact_differences import (
    Held,
    beside,
    force_change,
    held_at,
    moved_before,
    seen_at,
    stiffness_at,
)
from gelforge.mechanics.equilibrium import Press, Settings, State, _padded
from gelforge.mechanics.force_differences import ForceDifferences
from gelforge.mechanics.indenters import Indenter
from gelforge.mechanics.surface_contact import SurfaceContact
from gelforge.mechanics.unsymmetric import UnsymmetricTangent


@dataclass(frozen=True)
class Varied:
    """What a press has that differs from a base by a small amount of one parameter.

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
    """Yield the base's state at each centre (D, 3) or (D, 6) in turn, with its derivatives along each varied press.

    seconds: to it the wall seconds of every step's derivatives are added. Raises NotConverged as the base does, ValueError
    where a mesh has other elements or the body remembers.
    """
    centres = np.asarray(centres, dtype=float)
    chain = _Chain(base, varied)
    path = np.vstack([_padded(start.centre, centres.shape[1]), centres])
    shifts = np.array([np.vstack([_padded(v.start, centres.shape[1]), v.centres]) - path for v in varied])
    shifts = shifts.reshape(len(varied), *path.shape)
    reached = 0  # the last place of the path that the base has reached

    def watch(before: State, after: State) -> None:
        step = np.linalg.norm(path[reached + 1] - path[reached])
        share = np.linalg.norm(after.centre - path[reached]) / step if step else 1.0
        clock = time.perf_counter()
        chain.advance(before, after, (1 - share) * shifts[:, reached] + share * shifts[:, reached + 1])
        if seconds is not None:
            seconds.append(time.perf_counter() - clock)

    chain.begin(shifts[:, 0])
    for state in base.follow(start, centres, watch):
        reached += 1
        yield state, chain.slopes


class _Chain:
    """Derivatives carried from step to step."""

    def __init__(self, base: Press, varied: Sequence[Varied]):
        for one in varied:
            if not np.array_equal(one.body.mesh.elements, base.body.mesh.elements):
                raise ValueError(
                    "a varied press has a mesh of other elements than the base's; subtract two solutions instead"
                )
        self.base, self.varied = base, varied
        self.amounts = np.array([one.amount for one in varied]).reshape(-1, 1, 1)
        self.internal = ForceDifferences(base.body, [one.body for one in varied], self.amounts.ravel())
        self.tangent: UnsymmetricTangent | None = None  # made when it is first needed
        self.values = np.empty(len(base.body.pattern.indices))
        P, N, S = len(varied), len(base.body.mesh.X), len(base.surface)
        self.slopes = Slopes(np.zeros((P, S, 3)), np.zeros((P, N, 3)))
        self.moved = np.zeros((P, S, 3))  # slope of the surface nodes' last motion

    def begin(self, shifts: np.ndarray) -> None:
        """Take shifts (P, 3) or (P, 6) of the indenter at the start, by which the varied starts differ from the base's."""
        self.shift, self.turn_of_path = shifts, np.zeros_like(shifts)

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
        for k, one in enumerate(self.varied):
            other = beside(contact, held, one.body.mesh, one.indenter, one.settings)
            old = moved_before(
                other,
                held,
                one.amount * u[k],
                one.amount * self.moved[k, held.nodes],
                _padded(before.centre, shifts.shape[1]) + self.shift[k],
                None if before.travel is None else before.travel + self.turn_of_path[k],
            )
            seen = seen_at(other, old, held.centre + shifts[k], held.u, held.pressure, held.active)
            found[k] = force_change(held, held.seen.change_to(seen, one.amount))
        return found

    def _solved(self, after: State, nodes: np.ndarray, blocks: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Return du / d amount (P, N, 3) under loads (P, N, 3) [N/unit], with contact blocks (n, 3, 3) of surface nodes."""
        base = self.base
        if self.tangent is None:
            self.tangent = UnsymmetricTangent(base.body.pattern, base.surface, base.solver.name)
        base.body.response(after.u, after.pressure, self.values)
        everywhere = np.zeros((len(base.surface), 3, 3))
        everywhere[nodes] = blocks
        self.tangent.factor(self.values, everywhere)
        du = np.zeros_like(load)
        du[:, base.free] = self.tangent.solve(load[:, base.free])
        if base.body.mesh.ties is None:
            return du
        P, N, _ = du.shape
        spread = base.body.spread(du.transpose(1, 0, 2).reshape(N, -1))
        return np.ascontiguousarray(spread.reshape(N, P, 3).transpose(1, 0, 2))
