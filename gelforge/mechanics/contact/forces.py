"""Contact of surface nodes with a rigid indenter: semi-smooth Newton for pressure and for Coulomb friction.

Normal: the contact pressure lam_n [MPa] of a node is an unknown of its own. One iteration linearises
lam_n = max(0, lam_n - eps_n (g + n . du)), the semi-smooth Newton form of the complementarity conditions (Alart & Curnier
1991, doi 10.1016/0045-7825(91)90022-X; Hueeber & Wohlmuth 2005, doi 10.1016/j.cma.2004.08.006), so the gap closes to zero
and eps_n decides only how fast.
Tangential: the friction force t [N] of a node is an unknown too, and solves t = Pi(t - w A s): s the slip [mm] in the
tangent plane, Pi the projection onto the disc of radius mu lam_n A. A node whose trial t - w A s lies in the disc sticks:
one iteration holds it with a stiff spring, which the new t carries on as a force, so that no slip is left. A node outside
slips: its force has the disc's radius along the trial's direction e, and the derivative of Pi holds it across e until its
slip points along e (Hueeber, Stadler & Wohlmuth 2008, doi 10.1137/060671061). Neither the weight w nor the spring
is in the solution. Two tangents exist: a symmetric positive one, in which the limit of friction is that of the iterate, and
near the solution the unsymmetric derivative, in which the limit follows the contact pressure.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numba.extending import register_jitable

OPEN, STICK, SLIP = range(3)


class ContactNodes(NamedTuple):
    """What the contact forces of S surface nodes follow from."""

    gap: np.ndarray  # (S,) [mm] that is to be closed
    normal: np.ndarray  # (S, 3) from the indenter into the body
    turn: np.ndarray  # (S, 3, 3) = dn/dx [1/mm]
    slip: np.ndarray  # (S, 3) motion relative to the indenter that is to be none or to be dragged on [mm]
    pressure: np.ndarray  # (S,) lam_n [MPa]
    active: np.ndarray  # (S,) bool
    area: np.ndarray  # (S,) [mm^2]
    given: np.ndarray  # (S, 3) friction forces of the iterate [N]
    eps_n: np.ndarray  # (S,), weight (S,) w and hold (S,) of the spring that holds [N/mm^3]
    weight: np.ndarray
    hold: np.ndarray
    mu: float
    exponents: np.ndarray  # (K,) [-] and references (K,) [MPa] of `friction_coefficient`
    references: np.ndarray


class ContactForces(NamedTuple):
    """Forces of the indenter on the nodes, their tangents, and what the next iterate needs."""

    f_mixed: np.ndarray  # (S, 3) [N] with pressure and friction as given
    f_condensed: np.ndarray  # (S, 3) [N] with lam_n - eps_n g and what the springs hold
    f_consistent: np.ndarray  # (S, 3) [N] the same, the limit of friction following lam_n - eps_n g
    friction: np.ndarray  # (S, 3) [N] the given forces in the tangent plane, a part of f_mixed
    wanted: np.ndarray  # (S, 3) [N] what they should be, equal to them at the solution
    held: np.ndarray  # (S, 3) [N] the part of f_condensed in the tangent plane
    direction: np.ndarray  # (S, 3) e of slipping nodes, 0 of others
    spring: np.ndarray  # (S,) [N/mm] stiffness in the tangent plane, across e where it slips
    stiffness: np.ndarray  # (S, 3, 3) [N/mm], about -d f_condensed/dx, symmetric positive
    stiffness_consistent: np.ndarray  # (S, 3, 3) = -d f_consistent/dx
    state: np.ndarray  # (S,) open, stick, slip
    touched: np.ndarray  # (S,) bool, nodes that are or have been in contact

    @classmethod
    def empty(cls, S: int) -> ContactForces:
        """Return room for the forces on S nodes."""
        vectors = [np.empty((S, 3)) for _ in range(7)]
        matrices = [np.empty((S, 3, 3)) for _ in range(2)]
        return cls._make([*vectors, np.empty(S), *matrices, np.empty(S, np.int8), np.empty(S, bool)])


@register_jitable
def friction_coefficient(pressure, mu, exponents, references):
    """Return mu times (1 + p / p_k)^-n_k for each exponent n_k.

    Parameters
    ----------
    pressure : float or numpy.ndarray
        Contact pressure p >= 0 [MPa].
    mu : float
        Coefficient at no pressure [-].
    exponents, references : sequence of float
        n_k [-] and p_k [MPa], as many of each.

    Returns
    -------
    float or numpy.ndarray
        [-], in the shape of the pressure.
    """
    for k in range(len(exponents)):
        mu = mu * (1.0 + pressure / references[k]) ** -exponents[k]
    return mu


@register_jitable
def friction_fall(pressure, exponents, references):
    """Return -d ln mu / d ln p [-] at pressures p >= 0 [MPa]: by which friction's limit grows less than the pressure."""
    fall = 0.0
    for k in range(len(exponents)):
        fall = fall + exponents[k] * pressure / (references[k] + pressure)
    return fall


@nb.njit(cache=True)
def contact_forces(nodes, out):
    """Fill the forces of the indenter on the ContactNodes and their tangents, all ContactForces but held and touched."""
    gap, normal, turn, slip, pressure, active, area, given, eps_n, weight, hold, mu, exponents, references = (
        nodes
    )
    f_mixed, f_condensed, f_consistent, friction, wanted, _, direction, spring = out[:8]
    stiffness, stiffness_consistent, state, _ = out[8:]
    t = np.empty(3)
    along = np.empty(3)  # the slip in the tangent plane
    e = np.empty(3)
    T = np.empty(3)
    for s in range(gap.shape[0]):
        state[s] = OPEN
        f_mixed[s] = 0.0
        f_condensed[s] = 0.0
        f_consistent[s] = 0.0
        friction[s] = 0.0
        wanted[s] = 0.0
        direction[s] = 0.0
        spring[s] = 0.0
        stiffness[s] = 0.0
        stiffness_consistent[s] = 0.0
        if not active[s]:
            continue
        A = area[s]
        n = normal[s]
        H = turn[s]
        N = A * pressure[s]
        eps = eps_n[s]
        N_next = A * (pressure[s] - eps * gap[s])
        for i in range(3):
            f_mixed[s, i] = N * n[i]
            f_condensed[s, i] = N_next * n[i]
            f_consistent[s, i] = N_next * n[i]
            for j in range(3):
                stiffness[s, i, j] = eps * A * n[i] * n[j]
                # The turn of the normal softens: it is left out of the symmetric tangent, which must stay positive.
                stiffness_consistent[s, i, j] = eps * A * n[i] * n[j] - N_next * H[i, j]
        state[s] = SLIP
        if mu <= 0.0 or N <= 0.0:
            continue

        limit = friction_coefficient(pressure[s], mu, exponents, references) * N
        p = max(N_next, 0.0) / A
        mu_next = friction_coefficient(p, mu, exponents, references)
        t_n = given[s, 0] * n[0] + given[s, 1] * n[1] + given[s, 2] * n[2]
        s_n = slip[s, 0] * n[0] + slip[s, 1] * n[1] + slip[s, 2] * n[2]
        size = 0.0
        for i in range(3):
            t[i] = given[s, i] - t_n * n[i]
            along[i] = slip[s, i] - s_n * n[i]
            e[i] = t[i] - weight[s] * A * along[i]  # the trial force
            size += e[i] ** 2
        size = np.sqrt(size)
        slips = size > limit
        state[s] = SLIP if slips else STICK
        k = hold[s] * A
        for i in range(3):
            friction[s, i] = t[i]
            f_mixed[s, i] += t[i]
            wanted[s, i] = e[i]
        if slips:
            share = limit / size
            k = min(k, weight[s] * A * share / (1.0 - share))
            along_e = 0.0
            for i in range(3):
                e[i] /= size
                along_e += along[i] * e[i]
            for i in range(3):
                direction[s, i] = e[i]
                wanted[s, i] = limit * e[i]
                across = k * (along[i] - along_e * e[i])
                f_condensed[s, i] += limit * e[i] - across
                T[i] = mu_next * max(N_next, 0.0) * e[i] - across
        else:
            for i in range(3):
                T[i] = t[i] - k * along[i]
                f_condensed[s, i] += T[i]
        spring[s] = k
        # As the normal turns, the plane's part of forces and slips along it changes.
        left = -k * s_n if slips else t_n - k * s_n
        # With N_next below zero the limit of friction is held at zero.
        slope = mu_next * (1.0 - friction_fall(p, exponents, references)) if N_next > 0.0 else 0.0
        for i in range(3):
            f_consistent[s, i] += T[i]
            for j in range(3):
                plane = (1.0 if i == j else 0.0) - n[i] * n[j] - direction[s, i] * direction[s, j]
                stiffness[s, i, j] += k * plane
                turned = H[j, 0] * T[0] + H[j, 1] * T[1] + H[j, 2] * T[2]
                stiffness_consistent[s, i, j] += k * plane + n[i] * turned + left * H[i, j]
                if slips:
                    across = H[j, 0] * e[0] + H[j, 1] * e[1] + H[j, 2] * e[2]
                    stiffness_consistent[s, i, j] -= left * e[i] * across
                    stiffness_consistent[s, i, j] += slope * eps * A * e[i] * n[j]


def facet_gap(turn: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return the mean distance (S,) [mm] by which element faces between nodes on a convex indenter lie inside of it.

    h^2 (k_1 + k_2) / 12 for faces of size h on principal curvatures k: between its ends a chord sags by h^2 k / 12 in the
    mean. A bend sharper than the faces counts less, as no face spans it. turn (S, 3, 3) [1/mm] is the slope of the normal,
    area (S,) [mm^2] that of the nodes.
    """
    curvature = np.maximum(np.trace(turn, axis1=1, axis2=2), 0.0)
    return area / 12 * curvature / (1 + 4 * area * curvature**2)


def film_given(pressure: np.ndarray, thickness: float, half_pressure: float) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much a film has given way (S,) [mm] under pressures (S,) [MPa], and its slope (S,) [mm/MPa].

    h p / (p + p_0): a film of thickness h is half used up at p_0, and no more than all of it gives way (Bandis, Lumsden &
    Barton 1983, doi:10.1016/0148-9062(83)90595-8, for rough joints that close).
    """
    used = half_pressure + np.maximum(pressure, 0.0)
    return thickness * (1 - half_pressure / used), thickness * half_pressure / used**2


def adhesive_traction(
    gap: np.ndarray, closed: np.ndarray, work: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the traction (S,) [MPa] that draws nodes to the indenter, and its slope (S,) [MPa/mm] with the gap.

    It is 2 w / reach in contact and falls linearly to nothing at the gap `reach` [mm]; work (S,) [N/mm] is the area under
    it (a cohesive law as in Dugdale 1960, Xu & Needleman 1993, with the simplest shape).
    """
    largest = 2 * work / reach
    open_gap = np.where(closed, 0.0, np.maximum(gap, 0.0))
    traction = largest * np.maximum(1 - open_gap / reach, 0.0)
    falls = ~closed & (gap > 0) & (gap < reach)
    return traction, np.where(falls, -largest / reach, 0.0)


@nb.njit(cache=True)
def add_node_blocks(slots, blocks, data):
    """Add symmetric node blocks (n, 3, 3) to the upper CSR values through slots (n, 3, 3), skipping fixed entries."""
    for s in range(slots.shape[0]):
        for i in range(3):
            for j in range(i, 3):
                if slots[s, i, j] >= 0:
                    data[slots[s, i, j]] += 0.5 * (blocks[s, i, j] + blocks[s, j, i])
