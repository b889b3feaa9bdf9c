"""Contact of surface nodes with a rigid indenter: active set with augmented Lagrangian, Coulomb friction by return map.

Normal: the contact pressure lam_n [MPa] of a node is an unknown of its own. One iteration linearises
lam_n = max(0, lam_n - eps_n (g + n . du)), the semi-smooth Newton form of the complementarity conditions (Alart & Curnier
1991, doi 10.1016/0045-7825(91)90022-X; Hueeber & Wohlmuth 2005, doi 10.1016/j.cma.2004.08.006), so the gap closes to zero
and eps_n decides only how fast.
Tangential: trial t = t_old - eps_t A slip, returned to mu lam_n A (Simo & Laursen 1992, doi 10.1016/0045-7949(92)90540-G).
A node that has just touched has slipped over half of the step. Two tangents exist: far from the solution, where the
consistent one cycles between stick and slip, a symmetric one half-way between secant and consistent with the limit of
the last iterate; near it the consistent, unsymmetric one, in which the limit follows the contact pressure.
"""

from __future__ import annotations

import numba as nb
import numpy as np

OPEN, STICK, SLIP = 0, 1, 2
SLIP_TANGENT = 0.5  # 0: secant, 1: consistent


@nb.njit(cache=True)
def contact_forces(
    gap, normal, turn, slip, pressure, active, area, t_old, new_contact, eps_n, eps_t, mu,
    f_mixed, f_condensed, f_consistent, friction, stiffness, stiffness_consistent, state,
    exponent=0.0, reference=1.0,
):  # fmt: skip
    """Fill the forces of the indenter on the nodes and their tangents; return nothing.

    In: gap (S,) [mm] that is to be closed, normal (S, 3) from the indenter into the body, turn (S, 3, 3) = dn/dx [1/mm],
    slip (S, 3) motion relative to the indenter since the last converged state [mm], pressure (S,) lam_n [MPa], active (S,)
    bool, area (S,) [mm^2], t_old (S, 3) friction forces of the last converged state [N], new_contact (S,) bool: open at the
    last converged state, eps_n (S,), eps_t [N/mm^3], mu [-], exponent n [-] and reference p_0 [MPa] of mu (1 + p/p_0)^-n.
    Out: f_mixed (S, 3) [N] with the pressure given; f_condensed (S, 3) with lam_n - eps_n g; friction (S, 3) the tangential
    part of both; stiffness (S, 3, 3) [N/mm], about -d f_condensed/dx, symmetric positive; f_consistent (S, 3) and
    stiffness_consistent (S, 3, 3) = -d f_consistent/dx exactly, the limit of friction following lam_n - eps_n g; state (S,).
    """
    T = np.empty(3)
    turned = np.empty(3)
    trial = np.empty(3)
    M = np.empty((3, 3))  # d trial / dx
    for s in range(gap.shape[0]):
        state[s] = OPEN
        f_mixed[s] = 0.0
        f_condensed[s] = 0.0
        f_consistent[s] = 0.0
        friction[s] = 0.0
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

        share = 0.5 if new_contact[s] else 1.0
        along = 0.0
        for i in range(3):
            T[i] = t_old[s, i] - eps_t * A * share * slip[s, i]
            along += T[i] * n[i]
        size = 0.0
        for i in range(3):
            trial[i] = T[i] - along * n[i]
            turned[i] = H[i, 0] * T[0] + H[i, 1] * T[1] + H[i, 2] * T[2]
            size += trial[i] * trial[i]
        size = np.sqrt(size)
        for i in range(3):
            for j in range(3):
                plane = (1.0 if i == j else 0.0) - n[i] * n[j]
                M[i, j] = -eps_t * A * share * plane - n[i] * turned[j] - along * H[i, j]
        mu_now = mu
        mu_next = mu
        slope = mu  # of the limit of friction with N_next
        if exponent > 0.0:
            p = max(N_next, 0.0) / A
            mu_now = mu * (1.0 + pressure[s] / reference) ** -exponent
            mu_next = mu * (1.0 + p / reference) ** -exponent
            slope = mu_next * (1.0 - exponent * p / (reference + p))
        slips = size > mu_now * N
        state[s] = SLIP if slips else STICK
        factor = mu_now * N / size if slips else 1.0
        factor_next = mu_next * max(N_next, 0.0) / size if slips else 1.0
        for i in range(3):
            friction[s, i] = factor * trial[i]
            f_mixed[s, i] += friction[s, i]
            f_condensed[s, i] += friction[s, i]
            f_consistent[s, i] += factor_next * trial[i]
            for j in range(3):
                plane = (1.0 if i == j else 0.0) - n[i] * n[j]
                if slips:
                    plane -= SLIP_TANGENT * trial[i] * trial[j] / size**2
                stiffness[s, i, j] += share * factor * eps_t * A * plane
                change = factor_next * M[i, j]
                if slips:
                    pull = (trial[0] * M[0, j] + trial[1] * M[1, j] + trial[2] * M[2, j]) / size**2
                    change -= factor_next * trial[i] * pull
                    if N_next > 0.0:  # else the limit of friction is held at zero
                        change -= slope * eps * A * trial[i] / size * n[j]
                stiffness_consistent[s, i, j] -= change


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
