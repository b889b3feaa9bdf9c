"""How the internal forces of a body change with its parameters where it stands: at the displacements of a solved state.

What only multiplies the moduli of elements is linear in the forces of each element, which are computed once for all
parameters. Everything else (another law, other places of nodes) is evaluated anew, for the elements that it changes.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from gelforge.mechanics.bodies.body import Body, SmallStrainBody
from gelforge.mechanics.meshes.elements import ELEMENTS

# Derivatives against differences of full solutions (tests/verification/test_direct_sensitivities.py):
# Share of a difference that is taken. With nodes elsewhere, displacements that stay change volumes, against a bulk modulus
# of a thousand shear moduli: the square of such a change must be little against what shears.
LESS = 1e-3
MODULI = ("stiffness", "element_bulk", "local_bulk")


class ForceDifferences:
    """Changes of the internal forces from a body to others with the same elements, per unit of the amounts between them."""

    def __init__(self, base: Body, bodies: Sequence[Body], amounts: Sequence[float] | np.ndarray):
        self.base, self.bodies, self.amounts = base, list(bodies), np.asarray(amounts, dtype=float)
        self._moduli: list[int] = []  # numbers of the bodies that differ by factors on moduli only
        self._others: dict[int, np.ndarray] = {}  # elements (n,) that differ, by the body's number
        self._linear = isinstance(base, SmallStrainBody)
        for number, body in enumerate(self.bodies):
            if type(body) is not type(base) or base.remembers:
                raise ValueError(
                    f"no direct derivative from {type(base).__name__} to {type(body).__name__}; subtract two solutions"
                )
            if body is base or self._linear:
                continue
            if (shape := _other_shape(base, body)).any():
                self._others[number] = np.flatnonzero(shape | _other_moduli(base, body))
            elif _other_moduli(base, body).any():
                self._moduli.append(number)
        if self._moduli or self._others:
            self._prepare()

    def _prepare(self) -> None:
        base, (E, A) = self.base, self.base.mesh.elements.shape
        apart = replace(base.mesh, X=np.zeros((E * A, 3)), elements=_apart(E, A), ties=None)
        self._apart = base.part(np.arange(E), apart)  # the elements without common nodes
        self._local = ELEMENTS[A].local_bulk_to_shear > 0
        if self._local:
            self._without_local = copy.copy(self._apart)
            self._without_local.local_bulk = np.zeros(E)
        rows = 3 * np.repeat(base.mesh.elements.ravel(), 3) + np.tile(np.arange(3), E * A)
        # Of a sparse (3 N, E): forces of every element
        self._rows, self._columns = rows, np.arange(E + 1) * 3 * A
        self._parts = {number: self._part_of(number, differing) for number, differing in self._others.items()}
        bodies = [self.bodies[number] for number in self._moduli]
        amounts = self.amounts[self._moduli]
        self._growth = {
            name: sp.csc_matrix(np.stack([_growth(base, body, name) for body in bodies], axis=1) / amounts)
            for name in ("stiffness", "element_bulk", *(["local_bulk"] if self._local else []))
            if bodies
        }

    def _part_of(self, number: int, differing: np.ndarray) -> tuple[Body, float]:
        """Return those elements (n,) of a body that differ, and the amount by which the returned ones do, a small one."""
        base, body = self.base, self.bodies[number]
        mesh = replace(
            base.mesh, elements=base.mesh.elements[differing], region=base.mesh.region[differing], ties=None
        )
        part = body.part(differing, mesh)
        if not (base.gradient[differing] != part.gradient).any() or (base.law != body.law).any():
            return part, self.amounts[number]
        part.constants = base.constants + LESS * (body.constants - base.constants)
        part.rest = base.rest + LESS * (body.rest - base.rest)
        for name in ("gradient", "weight"):
            here = getattr(base, name)[differing]
            setattr(part, name, here + LESS * (getattr(part, name) - here))
        for name in MODULI:
            setattr(part, name, (getattr(base, name) * (1 + LESS * _growth(base, body, name)))[differing])
        return part, LESS * self.amounts[number]

    def at(self, u: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Return d internal force / d amount (P, N, 3) [N/unit] at u (N, 3) [mm], hanging nodes' handed on.

        The element pressures are those of the volume change; pressure (E,) [MPa] those of the solved state.
        """
        P, N = len(self.bodies), len(self.base.mesh.X)
        differences = np.zeros((P, N, 3))
        if self._linear:
            before = self.base.response(u, pressure).f_condensed
            for number, body in enumerate(self.bodies):
                if body is not self.base:
                    there = body.response(u, pressure).f_condensed
                    differences[number] = (there - before) / self.amounts[number]
            return differences
        if not (self._moduli or self._others):
            return differences
        elements = self.base.mesh.elements
        moved, none = u[elements].reshape(-1, 3), np.zeros(len(elements))
        response = self._apart.response(moved, none)
        if self._moduli:
            differences[self._moduli] = self._by_moduli(response, moved).reshape(len(self._moduli), N, 3)
        of_elements = response.f_condensed.reshape(*elements.shape, 3)
        for number, (part, amount) in self._parts.items():
            there = part.response(u, np.zeros(len(part.mesh.elements))).f_condensed
            which = self._others[number]
            there -= _summed(of_elements[which], elements[which], N)
            differences[number] = there / amount
        return _gathered(self.base, differences)

    def _by_moduli(self, response, moved: np.ndarray) -> np.ndarray:
        """Return the changes (P, 3 N) by growing moduli: those of every element times its own forces."""
        law = response.f_mixed  # without pressure
        by = {"element_bulk": response.f_condensed - response.f_mixed}
        if self._local:
            law = self._without_local.response(moved, np.zeros(len(self.base.mesh.elements))).f_mixed
            by["local_bulk"] = response.f_mixed - law
        by["stiffness"] = law
        shape = (3 * len(self.base.mesh.X), len(self.base.mesh.elements))
        total = sum(
            sp.csc_matrix((force.ravel(), self._rows, self._columns), shape=shape) @ self._growth[name]
            for name, force in by.items()
        )
        return total.T.toarray()


def _apart(E: int, A: int) -> np.ndarray:
    return np.arange(E * A, dtype=np.int32).reshape(E, A)


def _other_shape(base: Body, body: Body) -> np.ndarray:
    """Return which elements (E,) have other gradients, laws or residual stretches."""
    regions = (base.law != body.law) | (base.rest != body.rest).any(axis=(1, 2))
    width = min(base.constants.shape[1], body.constants.shape[1])
    regions |= (base.constants[:, :width] != body.constants[:, :width]).any(axis=1)
    regions |= base.constants[:, width:].any(axis=1) | body.constants[:, width:].any(axis=1)
    other = regions[base.mesh.region]
    if body.gradient is not base.gradient:
        other |= (base.gradient != body.gradient).any(axis=(1, 2, 3))
    return other


def _other_moduli(base: Body, body: Body) -> np.ndarray:
    """Return which elements (E,) have other factors on their moduli."""
    return np.logical_or.reduce([getattr(base, name) != getattr(body, name) for name in MODULI])


def _growth(base: Body, body: Body, name: str) -> np.ndarray:
    """Return the relative growth (E,) of a modulus of the elements; of a bulk modulus that of its compliance, lost.

    Pressure is given and volume gives way, in proportion to the compliance: an amount of it that is a small one may be a
    large share of the bulk modulus.
    """
    here, there = getattr(base, name), getattr(body, name)
    if name == "stiffness":
        return there / here - 1
    return 1 - np.divide(here, there, out=np.ones_like(here), where=there > 0)


def _summed(force: np.ndarray, elements: np.ndarray, N: int) -> np.ndarray:
    """Return the sums (N, 3) at the nodes of forces (E, A, 3) of elements (E, A)."""
    nodes = elements.ravel()
    return np.stack([np.bincount(nodes, force[..., i].ravel(), N) for i in range(3)], axis=1)


def _gathered(body: Body, force: np.ndarray) -> np.ndarray:
    """Hand the forces (P, N, 3) of hanging nodes to the nodes they hang between, and return them."""
    if body.mesh.ties is None:
        return force
    hanging = np.flatnonzero(body.mesh.hanging)
    rows = body.mesh.ties[hanging]
    masters = np.unique(rows.indices)
    theirs = np.moveaxis(force[:, hanging], 0, 1).reshape(len(hanging), 3 * len(force))
    handed = (rows[:, masters].T @ theirs).reshape(len(masters), len(force), 3)
    force[:, masters] += np.moveaxis(handed, 1, 0)
    force[:, hanging] = 0.0
    return force
