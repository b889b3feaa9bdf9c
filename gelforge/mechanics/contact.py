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
    gap, normal, slip, pressure, active, area, t_old, new_contact, eps_n, eps_t, mu,
    f_mixed, f_condensed, t_new, stiffness, f_consistent, stiffness_consistent, state,
):  # fmt: skip
    """Fill the forces of the ball on the nodes and their tangents; return nothing.

    In: gap (S,) [mm], normal (S, 3) from the ball into the body, slip (S, 3) motion relative to the ball since the last
    converged state [mm], pressure (S,) lam_n [MPa], active (S,) bool, area (S,) [mm^2], t_old (S, 3) friction forces of the
    last converged state [N], new_contact (S,) bool: open at the last converged state, eps_n, eps_t [N/mm^3], mu.
    Out: f_mixed (S, 3) force with the pressure given [N]; f_condensed (S, 3) with lam_n - eps_n g; t_new (S, 3) friction
    part; stiffness (S, 3, 3) = -d f_condensed/dx, symmetric [N/mm]; f_consistent, stiffness_consistent the same with the
    consistent tangent; state (S,).
    """
    trial = np.empty(3)
    for s in range(gap.shape[0]):
        state[s] = OPEN
        for i in range(3):
            f_mixed[s, i] = 0.0
            f_condensed[s, i] = 0.0
            f_consistent[s, i] = 0.0
            t_new[s, i] = 0.0
            for j in range(3):
                stiffness[s, i, j] = 0.0
                stiffness_consistent[s, i, j] = 0.0
        if not active[s]:
            continue
        A = area[s]
        n = normal[s]
        N = A * pressure[s]
        # The geometric term (g/r)(I - n n) is left out: it is negative at large overclosure and vanishes at convergence.
        for i in range(3):
            f_mixed[s, i] = N * n[i]
            f_condensed[s, i] = A * (pressure[s] - eps_n * gap[s]) * n[i]
            f_consistent[s, i] = f_condensed[s, i]
            for j in range(3):
                stiffness[s, i, j] = eps_n * A * n[i] * n[j]
                stiffness_consistent[s, i, j] = stiffness[s, i, j]
        state[s] = SLIP
        if mu <= 0.0 or N <= 0.0:
            continue
        share = 0.5 if new_contact[s] else 1.0
        slip_n = 0.0
        t_n = 0.0
        for i in range(3):
            slip_n += share * slip[s, i] * n[i]
            t_n += t_old[s, i] * n[i]
        size = 0.0
        for i in range(3):
            trial[i] = t_old[s, i] - t_n * n[i] - eps_t * A * (share * slip[s, i] - slip_n * n[i])
            size += trial[i] * trial[i]
        size = np.sqrt(size)
        slips = size > mu * N
        factor = mu * N / size if slips else 1.0
        state[s] = SLIP if slips else STICK
        for i in range(3):
            t_new[s, i] = factor * trial[i]
            f_mixed[s, i] += t_new[s, i]
            f_condensed[s, i] += t_new[s, i]
            f_consistent[s, i] += t_new[s, i]
            for j in range(3):
                plane = share * eps_t * A * factor * ((1.0 if i == j else 0.0) - n[i] * n[j])
                stiffness[s, i, j] += plane
                stiffness_consistent[s, i, j] += plane
        if slips:
            for i in range(3):
                direction = trial[i] / size
                f_consistent[s, i] -= mu * eps_n * A * gap[s] * direction
                for j in range(3):
                    turn = share * eps_t * A * factor * direction * trial[j] / size
                    stiffness[s, i, j] -= SLIP_TANGENT * turn
                    stiffness_consistent[s, i, j] += mu * eps_n * A * direction * n[j] - turn


@nb.njit(cache=True)
def add_node_blocks(slots, blocks, data):
    """Add symmetric node blocks (n, 3, 3) to the upper CSR values through slots (n, 3, 3), skipping fixed entries."""
    for s in range(slots.shape[0]):
        for i in range(3):
            for j in range(i, 3):
                if slots[s, i, j] >= 0:
                    data[slots[s, i, j]] += 0.5 * (blocks[s, i, j] + blocks[s, j, i])
