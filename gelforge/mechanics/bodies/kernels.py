"""Compiled element loops: internal forces, tangent and energy of mean-dilatation elements (Q1P0 hexahedra, P2P0 tetrahedra).

The energy per undeformed volume is the law's isochoric energy of F_bar = J^(-1/3) F at each quadrature point plus
K/2 (theta - 1)^2 with theta = v/V, the mean volume ratio of the element. The element pressure p is an unknown of its own,
condensed out: the tangent's geometric terms use the p that is given, not K (theta - 1), which is what lets Newton's
iteration converge at K/mu = 1000 (Nagtegaal, Parks & Rice 1974, doi 10.1016/0045-7825(74)90032-2; Simo, Taylor & Pister
1985, doi 10.1016/0045-7825(85)90033-7). Where an element asks for it, kappa/2 (J - theta)^2 is added, and the pressure of a
point is p + kappa (J - theta): nothing for the exact solution, whose J is smooth, but it holds what a mean cannot
(elements.LOCAL_BULK_TO_SHEAR).

A block is LANES elements of one region, computed side by side. Each result depends on the values of its own element alone;
the sums at nodes and in the tangent follow the order of the elements within their regions.
The NumPy twins are the laws (point level) and the tests' element loop.
"""

from __future__ import annotations

from math import exp, log, sqrt

import numba as nb
import numpy as np

from gelforge.mechanics.bodies import layout, node_sums, point_stress
from gelforge.mechanics.bodies.layout import (
    DEFORMATION,
    DIRECTIONS,
    GRADIENT,
    MODULUS,
    RATIO,
    SQUARE,
    STRESS,
    SUMS,
    TOTAL,
    VOLUME,
    load3,
    load6,
    load9,
    rooms,
    store3,
    store6,
    store9,
)
from gelforge.mechanics.bodies.node_sums import add_tangent, forces
from gelforge.mechanics.bodies.point_stress import (
    added,
    eigen,
    frozen_stress,
    kirchhoff_stress,
    scaled,
    soften,
    spatial_modulus,
    with_frozen_modulus,
    with_mean,
    with_pressure,
)
from gelforge.mechanics.laws import lanes
from gelforge.mechanics.laws.lanes import (
    FAST,
    IN_ORDER,
    LANES,
    ONCE,
    PART,
    PARTS,
    load,
    starts_at,
    store,
    take,
)
from gelforge.mechanics.laws.points import fingerprint, principal_stress

SMALLEST_J = 1e-3  # guards powers of J while an iterate is inverted; such an iterate is never accepted
CODE = fingerprint(*(str(module.__file__) for module in (lanes, layout, node_sums, point_stress)))


@nb.njit(**ONCE)
def _blocks(region, regions):
    """Return the elements (B LANES,) by blocks of one region each, and the number of elements (B,) of each block.

    Where the last block of a region has lanes to spare they repeat its last element.
    """
    count = np.zeros(regions, np.int64)
    for r in region:
        count[r] += 1
    blocks = (count + LANES - 1) // LANES
    end = np.cumsum(blocks) * LANES
    place = end - blocks * LANES
    order = np.empty(blocks.sum() * LANES, np.int64)
    filled = np.full(blocks.sum(), LANES)
    for e, r in enumerate(region):
        order[place[r]] = e
        place[r] += 1
    for r in range(regions):
        spare = end[r] - place[r]
        if spare > 0:
            filled[end[r] // LANES - 1] -= spare
            order[place[r] : end[r]] = order[place[r] - 1]
    return order, filled


@nb.njit(inline="always")
def _take3(numbers, starts, k):
    return take(numbers, starts, k), take(numbers, starts, k + 1), take(numbers, starts, k + 2)


@nb.njit(**ONCE)
def _deform(room, at, moved, slopes, gradients, k, rest, w, NODES):
    """Fill J, w, F, F F^T and the spatial gradients of a point at `at`; return det F.

    moved: the nodes' displacements in the room; gradients[slopes + k]: dN/dX; w: the point's volumes.
    """
    none = 0.0 * w
    f00, f01, f02 = rest[0, 0] + none, rest[0, 1] + none, rest[0, 2] + none
    f10, f11, f12 = rest[1, 0] + none, rest[1, 1] + none, rest[1, 2] + none
    f20, f21, f22 = rest[2, 0] + none, rest[2, 1] + none, rest[2, 2] + none
    for a in range(NODES):
        x, y, z = _take3(gradients, slopes, k + 3 * a)
        store3(room, at + GRADIENT + 3 * a, (x, y, z))
        ux, uy, uz = load3(room, moved + 3 * a)
        f00, f01, f02 = f00 + ux * x, f01 + ux * y, f02 + ux * z
        f10, f11, f12 = f10 + uy * x, f11 + uy * y, f12 + uy * z
        f20, f21, f22 = f20 + uz * x, f21 + uz * y, f22 + uz * z
    c00, c01, c02 = f11 * f22 - f12 * f21, f12 * f20 - f10 * f22, f10 * f21 - f11 * f20
    det = f00 * c00 + f01 * c01 + f02 * c02
    J = max(det, SMALLEST_J)
    i = 1.0 / J
    c00, c01, c02 = i * c00, i * c01, i * c02
    c10, c11, c12 = i * (f02 * f21 - f01 * f22), i * (f00 * f22 - f02 * f20), i * (f01 * f20 - f00 * f21)
    c20, c21, c22 = i * (f01 * f12 - f02 * f11), i * (f02 * f10 - f00 * f12), i * (f00 * f11 - f01 * f10)
    for a in range(NODES):  # F^-T dN/dX
        x, y, z = load3(room, at + GRADIENT + 3 * a)
        g = c00 * x + c01 * y + c02 * z, c10 * x + c11 * y + c12 * z, c20 * x + c21 * y + c22 * z
        store3(room, at + GRADIENT + 3 * a, g)
    store(room, at + RATIO, J)
    store(room, at + VOLUME, w)
    store9(room, at + DEFORMATION, (f00, f01, f02, f10, f11, f12, f20, f21, f22))
    normal = (
        f00 * f00 + f01 * f01 + f02 * f02,
        f10 * f10 + f11 * f11 + f12 * f12,
        f20 * f20 + f21 * f21 + f22 * f22,
    )
    shear = (
        f00 * f10 + f01 * f11 + f02 * f12,
        f10 * f20 + f11 * f21 + f12 * f22,
        f00 * f20 + f01 * f21 + f02 * f22,
    )
    store6(room, at + SQUARE, (*normal, *shear))
    return det


@nb.njit(**ONCE)
def _points(room, moved, order, first, gradients, weights, rest, NODES, POINTS):
    """Fill J, w, F, principal axes and spatial gradients of a block's points; return its V, v [mm^3] and smallest det F.

    moved: the nodes' displacements in the room; order[first:]: the block's elements; rest (3, 3): F at u = 0.
    """
    stride = GRADIENT + 3 * NODES
    points = starts_at(order, IN_ORDER, first, POINTS)
    slopes = starts_at(order, IN_ORDER, first, POINTS * NODES * 3)
    V0 = 0.0 * load(room, moved)
    v, least = V0, V0 + 1e300
    for q in range(POINTS):
        w = take(weights, points, q)
        J = _deform(room, q * stride, moved, slopes, gradients, q * NODES * 3, rest, w, NODES)
        V0, v, least = V0 + w, v + J * w, min(least, J)
    for q in range(POINTS):
        square, n0, n1, n2 = eigen(*load6(room, q * stride + SQUARE))
        store3(room, q * stride + SQUARE, square)
        store9(room, q * stride + DIRECTIONS, (*n0, *n1, *n2))
    return V0, v, least


def _assembler(NODES: int, POINTS: int, LOCAL: bool, MEMORY: bool, CODE: int = CODE):
    """Return `assemble` compiled for elements of this many nodes and quadrature points.

    LOCAL: part of the bulk modulus resists the volume change of every point rather than that of the element.
    MEMORY: the points soften and carry frozen stresses; without, gain, frozen, peak and softening are not read.
    CODE: closed over, so that a kernel on disk is not taken for that of other laws or of another part of this one.
    """
    STRIDE = GRADIENT + 3 * NODES
    MOVED = POINTS * STRIDE  # u of the nodes
    GROWTH, FORCE, REST = MOVED + 3 * NODES, MOVED + 6 * NODES, MOVED + 9 * NODES

    @nb.njit(cache=True, fastmath=FAST, error_model="numpy")
    def assemble(
        gradient, weight, elements, region, u, pressure, law, constants, stiffness, bulk, local_bulk, rest, slots,
        gain, frozen, peak, softening, data, f_mixed, f_condensed, p_volume, coupling,
    ):  # fmt: skip
        """Assemble a mean-dilatation body; return energy [mJ], smallest J, largest extension over its limit.

        In, with A nodes and Q points: gradient (E, Q, A, 3) [1/mm], weight (E, Q) [mm^3], elements (E, A), region (E,),
        u (N, 3) [mm], pressure (E,) [MPa] in force, law (R,) and constants (R, C) of the point routines, stiffness (E,)
        factor on the law, bulk (E,) [MPa], local_bulk (E,) the part of it at the points, rest (R, 3, 3) F at u = 0, slots
        (E, pairs, 3) as Pattern.element_slots; with memory: gain (R,) on the law's stress in this step, frozen (E, Q, 6)
        [MPa] material stresses beside it, peak (E, Q) [MPa] the largest energy density so far,
        softening (R, 3) = amount, m [MPa], beta. The energy is without gain and frozen stress.
        Out: data (nnz,) upper CSR values of the condensed tangent, left alone if
        of length 0; f_mixed (N, 3) [N] internal force with the given pressure; f_condensed (N, 3) the same with p_volume;
        p_volume (E,) = K (theta - 1); coupling (E, A, 3) = dv/du [mm^2].
        """
        _ = CODE
        tangent = data.shape[0] > 0
        room, bent = rooms(REST + 5, SUMS * POINTS + 9 * NODES)
        gradients, weights, nodes, places = gradient.ravel(), weight.ravel(), elements.ravel(), u.ravel()
        peaks, stresses = peak.ravel(), frozen.ravel()
        order, filled = _blocks(region, law.shape[0])
        energy, smallest, largest = 0.0, 1e300, 0.0
        data[:] = 0.0
        f_mixed[:] = 0.0
        f_condensed[:] = 0.0
        for block in range(filled.shape[0]):
            first = block * LANES
            r = region[order[first]]
            before, own_constants = rest[r], constants[r]
            corners = starts_at(order, IN_ORDER, first, NODES)
            for a in range(NODES):
                store3(room, MOVED + 3 * a, _take3(places, starts_at(nodes, corners, a, 3), 0))
            own, points = starts_at(order, IN_ORDER, first, 1), starts_at(order, IN_ORDER, first, POINTS)
            p, bulks, factor = take(pressure, own, 0), take(bulk, own, 0), take(stiffness, own, 0)
            V0, v, least = _points(room, MOVED, order, first, gradients, weights, before, NODES, POINTS)
            most = 0.0 * V0
            swelling = v / V0 - 1.0
            own_pressure = bulks * swelling
            spent = 0.5 * own_pressure * swelling * V0
            kappa = take(local_bulk, own, 0) if LOCAL else 0.0 * p
            for q in range(POINTS):
                at = q * STRIDE
                J, w = load(room, at + RATIO), load(room, at + VOLUME)
                square = load3(room, at + SQUARE)
                axes = load9(room, at + DIRECTIONS)
                n0, n1, n2 = axes[:3], axes[3:6], axes[6:]
                scale = exp(log(J) / -3.0)
                lam = (sqrt(square[0]) * scale, sqrt(square[1]) * scale, sqrt(square[2]) * scale)
                density, beta, gamma, extension = principal_stress(law[r], own_constants, lam)
                size = factor
                if MEMORY:
                    amount, m, share = softening[r, 0], softening[r, 1], softening[r, 2]
                    if amount != 0.0:
                        density, beta, gamma = soften(
                            density, beta, gamma, take(peaks, points, q), amount, m, share
                        )
                    size = factor * gain[r]
                spent += w * factor * density
                most = max(most, extension)
                beta = (size * beta[0], size * beta[1], size * beta[2])
                tau = kirchhoff_stress(n0, n1, n2, beta)
                if MEMORY:
                    material = starts_at(order, IN_ORDER, first, 6 * POINTS)
                    H = (*_take3(stresses, material, 6 * q), *_take3(stresses, material, 6 * q + 3))
                    T, mean = frozen_stress(load9(room, at + DEFORMATION), J, factor, H)
                    tau = added(tau, T)
                away = J - v / V0
                departure = kappa * away  # of the point's pressure from the element's
                if LOCAL:
                    spent += 0.5 * w * departure * away
                    tau = with_mean(tau, departure * J)
                tau = scaled(w, tau)
                store6(room, at + STRESS, tau)
                store(room, at + VOLUME, w * J)
                if not tangent:
                    continue
                D = spatial_modulus(square, n0, n1, n2, beta, scaled(size, gamma))
                D = with_pressure(D, (p + departure) * J, kappa * J * J)
                if MEMORY:
                    D = with_frozen_modulus(D, T, mean)
                store9(room, at + MODULUS, (*scaled(w, D[:6]), w * D[6], w * D[7], w * D[8]))
                store6(room, at + MODULUS + 9, scaled(w, D[9:15]))
                store6(room, at + MODULUS + 15, scaled(w, D[15:]))
                store6(room, at + TOTAL, with_mean(tau, w * J * p))
            forces(room, FORCE, GROWTH, NODES, POINTS)
            store3(room, REST, (own_pressure, spent, least))
            store(room, REST + 3, most)
            store(room, REST + 4, (bulks - kappa) / V0)
            for lane in range(filled[block]):
                e, each, k = order[first + lane], lane // PART, lane % PART
                given, p_volume[e] = pressure[e], room[each, REST * PART + k]
                energy += room[each, (REST + 1) * PART + k]
                smallest = min(smallest, room[each, (REST + 2) * PART + k])
                largest = max(largest, room[each, (REST + 3) * PART + k])
                for a in range(NODES):
                    n = elements[e, a]
                    for i in range(3):
                        growth = room[each, (GROWTH + 3 * a + i) * PART + k]
                        force = room[each, (FORCE + 3 * a + i) * PART + k]
                        coupling[e, a, i] = growth
                        f_mixed[n, i] += force + given * growth
                        f_condensed[n, i] += force + p_volume[e] * growth
            if tangent:
                for each in range(PARTS):
                    owners = order[first + each * PART : first + min((each + 1) * PART, filled[block])]
                    part = room[each]
                    add_tangent(
                        part, bent, GROWTH, load(part, REST + 4), owners, elements, slots, data, NODES, POINTS
                    )
        return energy, smallest, largest

    return assemble


# By the number of nodes; compiled when first called.
ASSEMBLE = {8: _assembler(8, 8, False, False), 10: _assembler(10, 4, True, False)}
ASSEMBLE_WITH_MEMORY = {8: _assembler(8, 8, False, True), 10: _assembler(10, 4, True, True)}
