"""The contact of a body's surface nodes with an indenter during one step: gaps, slips, forces, and the next iterate.

Every constant of the iteration is a pure number here, of a node's shear modulus over its element size, of that size or of a
force: forces then follow moduli and lengths in proportion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.forces import (
    OPEN,
    SLIP,
    ContactForces,
    ContactNodes,
    adhesive_traction,
    contact_forces,
    facet_gap,
    film_given,
    friction_coefficient,
)
from gelforge.mechanics.contact.state import Settings, State
from gelforge.mechanics.indenters.shapes import Indenter, rotation_of

# A contact force below this share of shear modulus times area of a node is measured by it: after release there is none,
# only rounding.
LEAST_FORCE = 1e-3
# A gap below this share of the body's extent closes an open node; what lies between is the rounding of a flat face that
# stands on the surface (tests/mechanics/test_last_steps.py).
TOUCHES = 3e-14
# The weight of slip against the friction force that decides between stick and slip, of shear modulus over element size.
# Above the stiffness of a node it takes nodes from one slip to the opposite one, past the stick between them. It is in no
# solution (docs/decisions/0010-exact-friction.md).
SLIP_WEIGHT = 1.0
# Cosine between two steps of the indenter along which the body's motion is extrapolated: 2.6 deg, by which sin(2.6 deg), 4
# %, of the motion goes elsewhere (what it is for: docs/decisions/0010-exact-friction.md).
SAME_WAY = 0.999


@dataclass(frozen=True)
class Iterate:
    """Unknowns of an iteration, and the gaps at them."""

    u: np.ndarray  # (N, 3) [mm]
    pressure: np.ndarray  # (E,) of the elements [MPa]
    contact_pressure: np.ndarray  # (S,) [MPa]
    friction: np.ndarray  # (S, 3) [N]
    active: np.ndarray  # (S,) bool, nodes in contact
    gap: np.ndarray  # (S,) [mm]
    normal: np.ndarray  # (S, 3)
    turn: np.ndarray  # (S, 3, 3) [1/mm]


@dataclass(frozen=True)
class Step:
    """A step of the indenter from a converged state."""

    old: State
    centre: np.ndarray  # (3,) or (6,) at its end
    touch_share: np.ndarray  # (S,) share of the step after which a node is in contact: 0 for those that are
    moved_free: np.ndarray  # (S, 3) [mm] motion of the node up to then


class SurfaceContact:
    """The surface of a body and an indenter with the constants of their contact."""

    def __init__(self, body: Body, indenter: Indenter, settings: Settings):
        self.indenter, self.settings = indenter, settings
        surface = body.mesh.surface
        self.nodes, self.area = surface.nodes, surface.area
        # The faces of quadratic tetrahedra are curved: they follow the indenter between their corners.
        self.facets = settings.facets if body.mesh.elements.shape[1] == 8 else 0.0
        self.X = body.mesh.X[self.nodes]
        self.size = np.sqrt(self.area)  # (S,) [mm] of the elements at a node
        # a tenth of the nodes have the smallest elements
        self.element_size = float(np.quantile(self.size, 0.1))  # [mm] where they are fine
        shear = _shear_modulus(body)
        self.eps_n = settings.normal_augmentation * shear / self.size  # (S,) [N/mm^3]
        self.hold = settings.tangential_augmentation * shear / self.size
        self.slip_weight = SLIP_WEIGHT * shear / self.size
        self.least_force = LEAST_FORCE * float(np.median(shear * self.area))  # N
        self.touches = -TOUCHES * float(np.abs(body.mesh.X).max())  # mm

    @cached_property
    def tree(self) -> cKDTree:
        """The undeformed surface nodes, to find the nearest ones."""
        return cKDTree(self.X)

    # -------------------------------------------------------------------------------------------------- kinematics
    def gap(self, u: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return gaps (S,) [mm], normals (S, 3) and their turn (S, 3, 3) [1/mm] at a displacement (N, 3) [mm]."""
        return self._gap_at(self.X + u[self.nodes], centre)

    def _gap_at(self, points: np.ndarray, centre: np.ndarray):
        if self.settings.initial_normals:
            return self.indenter.vertical_gap(np.concatenate([self.X[:, :2], points[:, 2:]], axis=1), centre)
        gap, normal, turn = self.indenter.gap(points, centre)
        if self.facets:
            gap = gap - self.facets * facet_gap(turn, self.area)
        return gap, normal, turn

    def step(self, old: State, centre: np.ndarray) -> Step:
        """Return the step to a centre, with the share of it after which open nodes touch.

        Up to then they move as in the step before, if that led the same way: a node that has touched counts its slip from
        where it has touched, not from where it was at the last converged state.
        """
        points = self.X + old.u[self.nodes]
        free = 0.0 * points
        if old.moved is not None and old.travel is not None:
            free = old.moved * steps_ratio(centre - old.centre, old.travel)
        before, after = old.gap, self._gap_at(points + free, centre)[0]
        closes = after < before
        share = np.where(closes, before / np.where(closes, before - after, 1.0), 1.0)
        share = np.where(old.contact_state == OPEN, np.clip(share, 0.0, 1.0), 0.0)
        return Step(old, centre, share, share[:, None] * free)

    def _slip(self, u: np.ndarray, step: Step) -> np.ndarray:
        """Return the motion (S, 3) [mm] of nodes relative to the indenter since they were in contact."""
        moved = (u - step.old.u)[self.nodes] - step.moved_free
        return moved - (1 - step.touch_share)[:, None] * self._carried(step)

    def _carried(self, step: Step) -> np.ndarray:
        """Return the motion (S, 3) or (3,) [mm] of the indenter's points at the surface nodes in a step."""
        old, centre = step.old, step.centre
        shift = (centre - old.centre)[:3]
        if len(centre) == 3 or np.array_equal(centre[3:], old.centre[3:]):
            return shift
        arm = self.X + old.u[self.nodes] - old.centre[:3]
        turned = rotation_of(centre[3:]) @ rotation_of(old.centre[3:]).T
        return shift + arm @ (turned - np.eye(3)).T

    # ------------------------------------------------------------------------------------------------------ forces
    def begin(self, u, pressure, contact_pressure, friction, centre: np.ndarray) -> Iterate:
        """Return the first iterate of a step from a prediction: in contact is what has pressure or lies inside."""
        gap, normal, turn = self.gap(u, centre)
        active = (contact_pressure > 0) | ((contact_pressure == 0) & (gap < self.touches))
        lam = np.where(active, contact_pressure, 0.0)
        return Iterate(u, pressure, lam, friction, active, gap, normal, turn)

    def forces(self, at: Iterate, step: Step, weight: float = 1.0) -> ContactForces:
        """Return the contact's forces and tangents at an iterate; weight multiplies the weight of slip."""
        s, out = self.settings, ContactForces.empty(len(self.nodes))
        closing, eps_n = self._closing(at)
        nodes = ContactNodes(
            closing, at.normal, at.turn, self._slip(at.u, step), at.contact_pressure, at.active, self.area, at.friction,
            eps_n, weight * self.slip_weight, self.hold, s.friction,
            np.array(s.friction_exponents, float), np.array(s.friction_pressures, float),
        )  # fmt: skip
        contact_forces(nodes, out)
        normal_part = np.where(at.active, self.area * (at.contact_pressure - eps_n * closing), 0.0)
        out.held[:] = out.f_condensed - normal_part[:, None] * at.normal
        out.touched[:] = (out.state != OPEN) | (False if step.old.touched is None else step.old.touched)
        if s.adheres:
            self._adhere(out, at, step.old)
        return out

    def _adhere(self, out: ContactForces, at: Iterate, old: State) -> None:
        """Add the cohesive pull to the contact's forces; its tangent is not positive and enters the consistent one only."""
        traction, slope = self.adhesion(at.gap, at.active, old)
        pull = -(self.area * traction)[:, None] * at.normal
        for force in (out.f_mixed, out.f_condensed, out.f_consistent):
            force += pull
        across = at.normal[:, :, None] * at.normal[:, None, :]
        turned = (self.area * traction)[:, None, None] * at.turn
        out.stiffness_consistent[:] += (self.area * slope)[:, None, None] * across + turned

    def adhesion(self, gap: np.ndarray, closed: np.ndarray, old: State) -> tuple[np.ndarray, np.ndarray]:
        """Return the traction (S,) [MPa] that draws nodes to the indenter after an old state, and its slope [MPa/mm]."""
        s, touched = self.settings, False if old.touched is None else old.touched
        work = np.where(touched, s.adhesion_work, s.adhesion_approach)
        return adhesive_traction(gap, closed, work, s.adhesion_range)

    def film(self, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return by how much a film gives way (S,) [mm] under contact pressures (S,) [MPa], and its slope (S,) [mm/MPa]."""
        return film_given(pressure, self.settings.film_thickness, self.settings.film_pressure)

    def _closing(self, at: Iterate) -> tuple[np.ndarray, np.ndarray]:
        """Return the gap that contact has to close (S,) [mm], less what a film gives, and the augmentation (S,) [N/mm^3]."""
        given, slope = self.film(at.contact_pressure)
        return at.gap + given, self.eps_n / (1 + self.eps_n * slope)

    # ------------------------------------------------------------------------------------------------ next iterate
    def corrected(
        self, at: Iterate, forces: ContactForces, du: np.ndarray, new_pressure: np.ndarray, centre, length=1.0
    ) -> Iterate:
        """Return the iterate after a share `length` of a correction du (N, 3) and its element pressures."""
        closing, eps_n = self._closing(at)
        moved = du[self.nodes]
        lam = at.contact_pressure - eps_n * (closing + np.einsum("si,si->s", at.normal, moved))
        lam = np.where(at.active, lam, 0.0)
        friction = self._next_friction(at, forces, lam, moved)
        u = at.u + length * du
        lam = at.contact_pressure + length * (lam - at.contact_pressure)
        gap, normal, turn = self.gap(u, centre)
        active = np.where(at.active, lam > 0, gap < self.touches)
        return Iterate(
            u=u,
            pressure=at.pressure + length * (new_pressure - at.pressure),
            contact_pressure=np.where(active, lam, 0.0),
            friction=at.friction + length * (friction - at.friction),
            active=active,
            gap=gap,
            normal=normal,
            turn=turn,
        )

    def _next_friction(
        self, at: Iterate, forces: ContactForces, lam: np.ndarray, moved: np.ndarray
    ) -> np.ndarray:
        """Return the friction forces (S, 3) [N] that the springs hold after the nodes have moved (S, 3) [mm]."""
        n, e = at.normal, forces.direction
        across = moved - n * (n * moved).sum(axis=1, keepdims=True)
        across -= e * (e * moved).sum(axis=1, keepdims=True)
        t = forces.held - forces.spring[:, None] * across
        size = np.linalg.norm(t, axis=1)
        slips = (forces.state == SLIP) & (size > 0)
        share = np.where(slips, self._limit(lam) / np.where(slips, size, 1.0), 1.0)
        return np.where(forces.state[:, None] == OPEN, 0.0, share[:, None] * t)

    def _limit(self, lam: np.ndarray) -> np.ndarray:
        """Return the limit of friction (S,) [N] at contact pressures (S,) [MPa]."""
        s, p = self.settings, np.maximum(lam, 0.0)
        return friction_coefficient(p, s.friction, s.friction_exponents, s.friction_pressures) * p * self.area

    # ------------------------------------------------------------------------------------------------------ errors
    def size_of(self, forces: ContactForces) -> float:
        """Return the norm of the contact forces [N], by which errors of forces are measured."""
        return max(float(np.linalg.norm(forces.f_mixed)), self.least_force)

    def friction_error(self, forces: ContactForces) -> float:
        """Return the norm of what the friction forces are off their law, over that of the contact forces."""
        return float(np.linalg.norm(forces.friction - forces.wanted)) / self.size_of(forces)

    def penetration(self, at: Iterate) -> float:
        """Return the largest gap that contact has not closed, over the element size of its node."""
        return float(np.abs(self._closing(at)[0] / self.size)[at.active].max(initial=0.0))


def steps_ratio(move: np.ndarray, last: np.ndarray) -> float:
    """Return how long a step of the indenter is over the last one, 0 where it leads another way or rests."""
    last = np.concatenate([last, np.zeros(len(move) - len(last))])
    size, before = np.linalg.norm(move), np.linalg.norm(last)
    return float(size / before) if move @ last > SAME_WAY * size * before else 0.0


def _shear_modulus(body: Body) -> np.ndarray:
    """Return the shear modulus (S,) [MPa] at the surface nodes, the mean of the elements there by volume."""
    elements, volume = body.mesh.elements, body.element_volume
    N = len(body.mesh.X)
    weight, modulus = np.zeros(N), np.zeros(N)
    for corner in elements.T:
        weight += np.bincount(corner, volume, N)
        modulus += np.bincount(corner, volume * body.element_shear, N)
    nodes = body.mesh.surface.nodes
    return modulus[nodes] / weight[nodes]
