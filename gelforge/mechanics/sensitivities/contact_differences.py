"""How the contact forces change close to a solved state: with indenter, path, settings, history and nodes.

Which nodes are in contact, and which of them stick, is that of the solved state: next to it, everything is smooth. There no
iteration follows that would close gaps and hold what sticks, so that stiff springs do it.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import numpy as np

from gelforge.mechanics.contact.forces import SLIP, STICK, friction_fall
from gelforge.mechanics.contact.state import Settings, State
from gelforge.mechanics.contact.surface import SurfaceContact
from gelforge.mechanics.indenters.shapes import Indenter
from gelforge.mechanics.meshes.mesh import Mesh

# Derivatives against differences of full solutions (tests/verification/test_direct_sensitivities.py):
# Of the springs that close gaps and hold what sticks, of shear modulus over element size: what is left of a gap or a slip
# is this part of the others. Rounding in float64 times it is as small.
STIFF = 1e6


@dataclass(frozen=True)
class FlowObservation:
    """What the contact forces of n nodes are made of, while pressures and friction forces are held."""

    gap: np.ndarray  # (n,) [mm], with what a film gives
    normal: np.ndarray  # (n, 3)
    slip: np.ndarray  # (n, 3) [mm]
    area: np.ndarray  # (n,) [mm^2]
    limit: np.ndarray  # (n,) [N] of friction
    pull: np.ndarray  # (n,) [N] of adhesion

    def change_to(self, other: FlowObservation, amount: float) -> FlowObservation:
        """Return the changes to another one per unit of an amount."""
        return FlowObservation(*((vars(other)[name] - value) / amount for name, value in vars(self).items()))


@dataclass(frozen=True)
class Held:
    """A solved state at n surface nodes, in contact or near it: what is held while other things change."""

    nodes: np.ndarray  # (n,) among the surface's
    u: np.ndarray  # (n, 3) [mm]
    centre: np.ndarray  # (3,) or (6,)
    old: State  # that before the step, of these nodes alone
    pressure: np.ndarray  # (n,) [MPa]
    friction: np.ndarray  # (n, 3) [N] in the tangent plane
    active: np.ndarray  # (n,) bool
    sticks: np.ndarray  # (n,) bool
    slips: np.ndarray  # (n,) bool
    direction: np.ndarray  # (n, 3) of the friction of what slips
    seen: FlowObservation
    pressure_spring: np.ndarray  # (n,) [N/mm^3] stiff; softer where a film gives way
    friction_spring: np.ndarray  # (n,) [N/mm] stiff for what sticks, of the friction's turn for what slips
    limit_slope: np.ndarray  # (n,) [mm^2] d limit of friction / d pressure


def touching(contact: SurfaceContact, after: State) -> np.ndarray:
    """Return which surface nodes (S,) have forces of contact in a state, or may have them close to it."""
    pulled = (after.gap < contact.settings.adhesion_range) & contact.settings.adheres
    return (after.contact_pressure > 0) | pulled


def held_at(contact: SurfaceContact, before: State, after: State) -> tuple[Held, SurfaceContact]:
    """Return what is held of the step from `before` to `after`, and the contact of these nodes alone."""
    s = contact.settings
    nodes = np.flatnonzero(touching(contact, after))
    old = replace(
        before,
        u=before.u[contact.nodes[nodes]],
        gap=before.gap[nodes],
        moved=None if before.moved is None else before.moved[nodes],
        contact_state=before.contact_state[nodes],
        touched=None if before.touched is None else before.touched[nodes],
    )
    at_nodes = copy.copy(contact)
    at_nodes.nodes, at_nodes.X, at_nodes.area = np.arange(len(nodes)), contact.X[nodes], contact.area[nodes]
    u, pressure = after.u[contact.nodes[nodes]], after.contact_pressure[nodes]
    active, rubs = pressure > 0, s.friction > 0
    seen = seen_at(at_nodes, old, after.centre, u, pressure, active)
    friction = _across(after.friction_force[nodes], seen.normal)
    sticks = active & rubs & (after.contact_state[nodes] == STICK)
    slips = active & (after.contact_state[nodes] == SLIP)
    slip = _across(seen.slip, seen.normal)
    length = np.linalg.norm(slip, axis=1)
    along = np.where(friction.any(axis=1, keepdims=True), friction, -slip)
    size = np.linalg.norm(along, axis=1)
    direction = along / np.where(size > 0, size, 1.0)[:, None]
    stiff = STIFF / s.normal_augmentation * contact.eps_n[nodes]
    # A node that has hardly slipped yet is held across its slip as stiffly as one that sticks.
    turning = np.divide(seen.limit, length, out=np.full_like(length, np.inf), where=length > 0)
    spring = np.where(slips, np.minimum(turning, stiff * at_nodes.area), stiff * at_nodes.area)
    falls = friction_fall(pressure, s.friction_exponents, s.friction_pressures)
    slope = np.where(active, (1 - falls) * seen.limit / np.where(active, pressure, 1.0), 0.0)
    held = Held(
        nodes, u, after.centre, old, pressure, friction, active, sticks, slips & (size > 0), direction, seen,
        stiff / (1 + stiff * contact.film(pressure)[1]), spring, slope,
    )  # fmt: skip
    return held, at_nodes


def beside(
    contact: SurfaceContact, held: Held, mesh: Mesh, indenter: Indenter, settings: Settings
) -> SurfaceContact:
    """Return the contact of the held nodes with another mesh, indenter and settings."""
    varied, surface = copy.copy(contact), mesh.surface
    varied.indenter, varied.settings = indenter, settings
    varied.X, varied.area = mesh.X[surface.nodes[held.nodes]], surface.area[held.nodes]
    return varied


def repeated(contact: SurfaceContact, held: Held, times: int) -> tuple[SurfaceContact, Held]:
    """Return a contact and what is held of it several times, one after another, as if they were other nodes."""

    def again(value):
        return np.tile(value, (times, *(1,) * (value.ndim - 1))) if isinstance(value, np.ndarray) else value

    several = copy.copy(contact)
    several.X, several.area = again(contact.X), again(contact.area)
    several.nodes = np.arange(times * len(contact.nodes))
    per_node = ("u", "gap", "moved", "contact_state", "touched")
    old = replace(held.old, **{name: again(getattr(held.old, name)) for name in per_node})
    seen = FlowObservation(*(again(value) for value in vars(held.seen).values()))
    names = vars(held).keys() - {"centre", "old", "seen"}
    values = {name: again(getattr(held, name)) for name in names}
    return several, replace(held, **values, old=old, seen=seen)


def moved_before(
    contact: SurfaceContact,
    held: Held,
    du: np.ndarray,
    dmoved: np.ndarray,
    centre: np.ndarray,
    travel: np.ndarray | None,
) -> State:
    """Return the state before the step with other displacements and last motions, by (n, 3) each, and another path."""
    old = held.old
    u = old.u + du
    gap = contact._gap_at(contact.X + u, centre)[0]
    moved = None if old.moved is None else old.moved + dmoved
    return replace(old, u=u, gap=gap, moved=moved, centre=centre, travel=travel)


def seen_at(
    contact: SurfaceContact,
    old: State,
    centre: np.ndarray,
    u: np.ndarray,
    pressure: np.ndarray,
    active: np.ndarray,
) -> FlowObservation:
    """Return what forces are made of at displacements (n, 3) [mm] after a step from an old state."""
    gap, normal, _ = contact._gap_at(contact.X + u, centre)
    slip = contact._slip(u, contact.step(old, centre))
    pull = contact.area * contact.adhesion(gap, active, old)[0]
    limit = contact._limit(pressure)
    return FlowObservation(gap + contact.film(pressure)[0], normal, slip, contact.area, limit, pull)


def force_change(held: Held, by: FlowObservation) -> np.ndarray:
    """Return the changes (n, 3) of the forces of contact by changes of what they are made of, to first order.

    Pressures follow so that gaps stay closed and friction so that what sticks does not slip; what slips keeps the limit of
    friction against its slip.
    """
    seen, n, dn = held.seen, held.seen.normal, by.normal
    dp = np.where(held.active, -held.pressure_spring * by.gap, 0.0)
    normal_force = seen.area * held.pressure - seen.pull
    force = (seen.area * dp + by.area * held.pressure - by.pull)[:, None] * n + normal_force[:, None] * dn
    # Slips and friction are counted in the tangent plane, which turns.
    slid = _across(by.slip, n) - _dot(seen.slip, dn) * n - _dot(seen.slip, n) * dn
    turned = -_dot(held.friction, dn) * n
    e = held.direction
    sticking = turned - held.friction_spring[:, None] * slid
    slipping = (held.limit_slope * dp + by.limit)[:, None] * e + turned
    slipping -= held.friction_spring[:, None] * _across(_across(slid, n), e)
    force += np.where(held.sticks[:, None], sticking, 0.0)
    return force + np.where(held.slips[:, None], slipping, 0.0)


def stiffness_at(contact: SurfaceContact, held: Held) -> np.ndarray:
    """Return -d force / d displacement (n, 3, 3) [N/mm] of every held node, not symmetric."""
    step = 1e-6 * contact.element_size  # by which nodes are moved to see how their forces change
    blocks = np.empty((len(held.nodes), 3, 3))
    for j, axis in enumerate(np.eye(3)):
        ends = [
            seen_at(contact, held.old, held.centre, held.u + sign * step * axis, held.pressure, held.active)
            for sign in (-1, 1)
        ]
        blocks[:, :, j] = -force_change(held, ends[0].change_to(ends[1], 2 * step))
    return blocks


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=1, keepdims=True)


def _across(v: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Return the part of vectors (n, 3) across unit vectors (n, 3)."""
    return v - _dot(v, n) * n
