"""The first iterate of a step, from the two states before it.

Along a straight path of the indenter, displacements and element pressures are extrapolated. Extrapolated contact pressures
would give none to nodes that are new in contact. While the contact area grows, contact pressures and friction forces are
therefore those of the last state on a contact of the extrapolated area, scaled to the extrapolated force.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gelforge.mechanics.contact.state import State
from gelforge.mechanics.contact.surface import Iterate, SurfaceContact, steps_ratio

# Constants of a prediction change the count of iterations, which benchmarks/cell_cost.py prints, and no converged state.
NEIGHBOURS = 4  # nodes whose contact pressures give that of a node (counts: benchmarks/cell_cost.py)
# A node further outside than this share of the element size is not predicted to touch (counts: benchmarks/cell_cost.py).
NEAR = 0.05
# Of the mean contact pressure, at least, of a node that is predicted to touch (counts: benchmarks/cell_cost.py).
LEAST = 0.02

# displacement (N, 3) [mm], element pressures (E,), contact pressures (S,) [MPa], friction forces (S, 3) [N]
Unknowns = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def unknowns(state: State) -> Unknowns:
    """Return displacement, element pressures, contact pressures and friction forces of a state."""
    return state.u, state.pressure, state.contact_pressure, state.friction_force


def slope_of(previous: State | None, state: State, centre: np.ndarray) -> float:
    """Return how long a step to a centre is over the one before; 0 without one, or where the path turns or rests."""
    if previous is None or previous.contact_pressure.max() == 0:
        return 0.0
    return steps_ratio(centre - state.centre, state.centre - previous.centre)


def extrapolated(
    contact: SurfaceContact, previous: State, state: State, ratio: float, centre: np.ndarray
) -> Iterate:
    """Return the iterate at a centre (3,) or (6,) [mm, rad] beyond two states, for a step `ratio` times the last one."""
    u, pressure, contact_pressure, friction = (
        now + ratio * (now - then) for now, then in zip(unknowns(state), unknowns(previous))
    )
    at = contact.begin(u, pressure, contact_pressure, friction, centre)
    return _similar(contact, previous, state, ratio, at)


def _similar(contact: SurfaceContact, previous: State, state: State, ratio: float, at: Iterate) -> Iterate:
    """Return the iterate with the last state's contact, grown by similarity; as it is where the area does not grow."""
    area, now, then = contact.area, state.contact_pressure > 0, previous.contact_pressure > 0
    area_now, area_then = area[now].sum(), area[then].sum()
    if not area_now > area_then > 0:
        return at
    area_next = area_now + ratio * (area_now - area_then)
    order = np.argsort(np.where(now, -np.inf, at.gap), kind="stable")  # nodes in contact, then the deepest
    many = max(int(np.searchsorted(np.cumsum(area[order]), area_next)), int(now.sum()))
    active = np.zeros(len(area), bool)
    active[order[:many]] = True
    active &= now | (at.gap < NEAR * contact.element_size)
    touching = np.flatnonzero(active)

    force_now, force_then = ((area * s.contact_pressure).sum() for s in (state, previous))
    force = force_now + ratio * (force_now - force_then)
    if force <= 0:  # it falls while the area grows, as where the gel relaxes
        return at
    middle = (area[now, None] * contact.X[now]).sum(axis=0) / area_now
    image = middle + (contact.X[touching] - middle) / np.sqrt(area_next / area_now)
    nearest, weight = _nearest(contact, image)
    traction = np.where(now[:, None], state.friction_force / np.where(now, area, 1.0)[:, None], 0.0)
    pressure, friction = np.zeros(len(area)), np.zeros((len(area), 3))
    pressure[touching] = (weight * state.contact_pressure[nearest]).sum(axis=1)
    friction[touching] = (weight[:, :, None] * traction[nearest]).sum(axis=1) * area[touching, None]
    scale = force / max(float((area * pressure).sum()), np.finfo(float).tiny)
    least = LEAST * force / area_next
    return replace(
        at,
        contact_pressure=np.where(active, np.maximum(scale * pressure, least), 0.0),
        friction=scale * friction,
        active=active,
    )


def _nearest(contact: SurfaceContact, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the surface nodes (n, k) nearest to places (n, 3), and weights (n, k) by inverse squared distance."""
    distance, nearest = contact.tree.query(places, k=NEIGHBOURS)
    # the weight of a node at the very place stays finite
    weight = 1 / np.maximum(distance, 1e-6 * contact.element_size) ** 2
    return nearest, weight / weight.sum(axis=1, keepdims=True)
