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
from typing import NamedTuple

import numba as nb
import numpy as np

from gelforge.mechanics.bodies import layout, node_sums, point_stress
from gelforge.mechanics.bodies.layout import (
    DEFORMATION,
    DIRECTIONS,
    ENERGY,
    GRADIENT,
    LARGEST,
    MODULUS,
    PRESSURE,
    RATIO,
    SMALLEST,
    SQUARE,
    STIFF,
    STRESS,
    SUMS,
    TOTAL,
    VOLUME,
    load3,
    load6,
    load9,
    moved_at,
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

# Guards powers of J while an iterate is inverted; below LEAST_J of body.py none is accepted
# (tests/mechanics/test_kernels.py).
SMALLEST_J = 1e-3
CODE = fingerprint(*(str(module.__file__) for module in (lanes, layout, node_sums, point_stress)))


class Elements(NamedTuple):
    """The elements of a body, A nodes and Q points each, and what they are made of."""

    gradient: np.ndarray  # (E, Q, A, 3) [1/mm]
    weight: np.ndarray  # (E, Q) [mm^3]
    nodes: np.ndarray  # (E, A)
    region: np.ndarray  # (E,)
    law: np.ndarray  # (R,) and constants (R, C) of the point routines
    constants: np.ndarray
    stiffness: np.ndarray  # (E,) factor on the law
    bulk: np.ndarray  # (E,) [MPa]
    local_bulk: np.ndarray  # (E,) [MPa] the part of it at the points
    rest: np.ndarray  # (R, 3, 3) F at u = 0
    slots: np.ndarray  # (E, pairs, 3) as Pattern.element_slots


class StepMemory(NamedTuple):
    """What the points remember in a step; not read by a kernel without memory."""

    gain: np.ndarray = np.empty(0)  # (R,) on the law's stress
    frozen: np.ndarray = np.empty((0, 0, 6))  # (E, Q, 6) [MPa] material stresses in addition to it
    peak: np.ndarray = np.empty((0, 0))  # (E, Q) [MPa] the largest energy density so far
    softening: np.ndarray = np.empty((0, 3))  # (R, 3) = amount, m [MPa], beta


class Assembled(NamedTuple):
    """What `assemble` fills."""

    tangent: np.ndarray  # (nnz,) upper CSR values of the condensed tangent; left alone if of length 0
    f_mixed: np.ndarray  # (N, 3) [N] internal force with the given pressure
    f_condensed: np.ndarray  # (N, 3) [N] the same with p_volume
    p_volume: np.ndarray  # (E,) [MPa] = K (theta - 1)
    coupling: np.ndarray  # (E, A, 3) = dv/du [mm^2]


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
def _deform(room, at, moved, slopes, gradients, k, rest, NODES):
    """Fill J, F, F F^T and the spatial gradients of a point at `at`, whose volume is known; return det F.

    moved: the nodes' displacements in the room; gradients[slopes + k]: dN/dX.
    """
    none = 0.0 * load(room, at + VOLUME)
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
def _points(room, order, first, gradients, weights, rest, NODES, POINTS):
    """Fill J, w, F, principal axes and spatial gradients of a block's points; return its V, v [mm^3] and smallest det F.

    order[first:]: the block's elements, whose displacements are in the room; rest (3, 3): F at u = 0.
    """
    stride, moved = GRADIENT + 3 * NODES, moved_at(NODES, POINTS)
    points = starts_at(order, IN_ORDER, first, POINTS)
    slopes = starts_at(order, IN_ORDER, first, POINTS * NODES * 3)
    V0 = 0.0 * load(room, moved)
    v, least = V0, V0 + 1e300
    for q in range(POINTS):
        w = take(weights, points, q)
        store(room, q * stride + VOLUME, w)
        J = _deform(room, q * stride, moved, slopes, gradients, q * NODES * 3, rest, NODES)
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
    def assemble(body, u, pressure, memory, out):
        """Assemble a mean-dilatation body; return energy [mJ], smallest J, largest extension over its limit.

        body: Elements; u (N, 3) [mm]; pressure (E,) [MPa] in force; memory: StepMemory, whose gain and frozen stress are not
        in the energy; out: Assembled, which is filled.
        """
        _ = CODE
        gradient, weight, elements, region, law, constants, stiffness, bulk, local_bulk, rest, slots = body
        gain, frozen, peak, softening = memory
        data, f_mixed, f_condensed, p_volume, coupling = out
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
            element, points = starts_at(order, IN_ORDER, first, 1), starts_at(order, IN_ORDER, first, POINTS)
            p, bulks, factor = take(pressure, element, 0), take(bulk, element, 0), take(stiffness, element, 0)
            V0, v, least = _points(room, order, first, gradients, weights, before, NODES, POINTS)
            most = 0.0 * V0
            swelling = v / V0 - 1.0
            own_pressure = bulks * swelling
            spent = 0.5 * own_pressure * swelling * V0
            kappa = take(local_bulk, element, 0) if LOCAL else 0.0 * p
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
                        largest_yet = take(peaks, points, q)
                        density, beta, gamma = soften(density, beta, gamma, largest_yet, amount, m, share)
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
            store3(room, REST + PRESSURE, (own_pressure, spent, least))
            store(room, REST + LARGEST, most)
            store(room, REST + STIFF, (bulks - kappa) / V0)
            for lane in range(filled[block]):
                e, half, k = order[first + lane], lane // PART, lane % PART
                given, p_volume[e] = pressure[e], room[half, (REST + PRESSURE) * PART + k]
                energy += room[half, (REST + ENERGY) * PART + k]
                smallest = min(smallest, room[half, (REST + SMALLEST) * PART + k])
                largest = max(largest, room[half, (REST + LARGEST) * PART + k])
                for a in range(NODES):
                    n = elements[e, a]
                    for i in range(3):
                        growth = room[half, (GROWTH + 3 * a + i) * PART + k]
                        force = room[half, (FORCE + 3 * a + i) * PART + k]
                        coupling[e, a, i] = growth
                        f_mixed[n, i] += force + given * growth
                        f_condensed[n, i] += force + p_volume[e] * growth
            if tangent:
                for half in range(PARTS):
                    owners = order[first + half * PART : first + min((half + 1) * PART, filled[block])]
                    add_tangent(room[half], bent, owners, elements, slots, data, NODES, POINTS)
        return energy, smallest, largest

    return assemble


# By the number of nodes; compiled when first called.
ASSEMBLE = {8: _assembler(8, 8, False, False), 10: _assembler(10, 4, True, False)}
ASSEMBLE_WITH_MEMORY = {8: _assembler(8, 8, False, True), 10: _assembler(10, 4, True, True)}
