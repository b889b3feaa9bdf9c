"""Sums over the points of a block of elements: forces of its nodes and the blocks of its tangent.

Compiled into the element loops. The tangent takes the elements of one PART at a time, whose sums fill the registers.
"""

from __future__ import annotations

import numba as nb

from gelforge.mechanics.bodies.layout import (
    GRADIENT,
    MODULUS,
    STIFF,
    STRESS,
    SUMS,
    TOTAL,
    VOLUME,
    load3,
    load6,
    moved_at,
    store3,
    store6,
    store9,
)
from gelforge.mechanics.laws.lanes import ONCE, PART, load


@nb.njit(inline="always")
def _stress_times(t, x, y, z):
    return t[0] * x + t[3] * y + t[5] * z, t[3] * x + t[1] * y + t[4] * z, t[5] * x + t[4] * y + t[2] * z


@nb.njit(**ONCE)
def forces(room, force, growth, NODES, POINTS):
    """Fill the forces (A, 3) [N] of the stresses and the derivatives dv/du (A, 3) [mm^2] of the elements' volumes."""
    stride = GRADIENT + 3 * NODES
    for a in range(NODES):
        f0 = 0.0 * load(room, VOLUME)
        f1, f2, v0, v1, v2 = f0, f0, f0, f0, f0
        for q in range(POINTS):
            x, y, z = load3(room, q * stride + GRADIENT + 3 * a)
            t0, t1, t2, t3, t4, t5 = load6(room, q * stride + STRESS)
            f0 = f0 + t0 * x + t3 * y + t5 * z
            f1 = f1 + t3 * x + t1 * y + t4 * z
            f2 = f2 + t5 * x + t4 * y + t2 * z
            volume = load(room, q * stride + VOLUME)
            v0, v1, v2 = v0 + volume * x, v1 + volume * y, v2 + volume * z
        store3(room, force + 3 * a, (f0, f1, f2))
        store3(room, growth + 3 * a, (v0, v1, v2))


@nb.njit(**ONCE)
def _bend(room, at, node, bent, k):
    """Fill the SUMS of a point at k of `bent`: its modulus and stress times the gradient of a node.

    The nine of each direction i of a force on another node, three for each direction m of this one's displacement, are
    coefficients of the other's gradient; the modulus being symmetric, three of them are found in two places.
    """
    x, y, z = load3(room, at + GRADIENT + 3 * node)
    s0, s1, s2 = _stress_times(load6(room, at + TOTAL), x, y, z)
    d00, d01, d02, d03, d04, d05 = load6(room, at + MODULUS)
    d11, d12, d13, d14, d15, d22 = load6(room, at + MODULUS + 6)
    d23, d24, d25, d33, d34, d35 = load6(room, at + MODULUS + 12)
    d44, d45, d55 = load3(room, at + MODULUS + 18)
    # Row of the modulus and displacement: columns x (x, 0, 0, y, 0, z), y (0, y, 0, x, z, 0) and z (0, 0, z, 0, y, x).
    xx_x, xy_x, xz_x = d00 * x + d03 * y + d05 * z, d03 * x + d33 * y + d35 * z, d05 * x + d35 * y + d55 * z
    yy_x, yz_x, zz_x = d01 * x + d13 * y + d15 * z, d04 * x + d34 * y + d45 * z, d02 * x + d23 * y + d25 * z
    xx_y, xy_y, xz_y = d03 * x + d01 * y + d04 * z, d33 * x + d13 * y + d34 * z, d35 * x + d15 * y + d45 * z
    yy_y, yz_y, zz_y = d13 * x + d11 * y + d14 * z, d34 * x + d14 * y + d44 * z, d23 * x + d12 * y + d24 * z
    xx_z, xy_z, xz_z = d05 * x + d04 * y + d02 * z, d35 * x + d34 * y + d23 * z, d55 * x + d45 * y + d25 * z
    yy_z, yz_z, zz_z = d15 * x + d14 * y + d12 * z, d45 * x + d44 * y + d24 * z, d25 * x + d24 * y + d22 * z
    store9(bent, k, (xx_x + s0, xy_x + s1, xz_x + s2, xx_y, xy_y, xz_y, xx_z, xy_z, xz_z))
    store9(bent, k + 9, (xy_x, yy_x, yz_x, xy_y + s0, yy_y + s1, yz_y + s2, yy_z, yz_z, zz_x))
    store6(bent, k + 18, (zz_y, xz_z + s0, yz_z + s1, zz_z + s2, xz_x, yz_y))


@nb.njit(**ONCE)
def _node_block(room, bent, growth, stiff, a, c, NODES, POINTS):
    """Fill the block dF_ai / du_cm (3, 3) of two nodes in `bent`, which holds the sums of node c before the blocks."""
    cx, cy, cz = load3(room, growth + 3 * c)
    ax, ay, az = load3(room, growth + 3 * a)
    ax, ay, az = stiff * ax, stiff * ay, stiff * az
    k00, k01, k02, k10, k11, k12 = ax * cx, ax * cy, ax * cz, ay * cx, ay * cy, ay * cz
    k20, k21, k22 = az * cx, az * cy, az * cz
    for q in range(POINTS):
        x, y, z = load3(room, q * (GRADIENT + 3 * NODES) + GRADIENT + 3 * a)
        k = SUMS * q
        k00 = k00 + x * load(bent, k) + y * load(bent, k + 1) + z * load(bent, k + 2)
        k01 = k01 + x * load(bent, k + 3) + y * load(bent, k + 4) + z * load(bent, k + 5)
        k02 = k02 + x * load(bent, k + 6) + y * load(bent, k + 7) + z * load(bent, k + 8)
        k10 = k10 + x * load(bent, k + 9) + y * load(bent, k + 10) + z * load(bent, k + 11)
        k11 = k11 + x * load(bent, k + 12) + y * load(bent, k + 13) + z * load(bent, k + 14)
        k12 = k12 + x * load(bent, k + 7) + y * load(bent, k + 15) + z * load(bent, k + 16)
        k20 = k20 + x * load(bent, k + 22) + y * load(bent, k + 11) + z * load(bent, k + 17)
        k21 = k21 + x * load(bent, k + 5) + y * load(bent, k + 23) + z * load(bent, k + 18)
        k22 = k22 + x * load(bent, k + 19) + y * load(bent, k + 20) + z * load(bent, k + 21)
    store9(bent, SUMS * POINTS + 9 * a, (k00, k01, k02, k10, k11, k12, k20, k21, k22))


@nb.njit(**ONCE)
def _add_blocks(bent, first, lane, c, e, elements, slots, data):
    """Add element e's blocks of node c with itself and those before it to the tangent; they begin at `first` of `bent`."""
    for a in range(c + 1):
        pair = (a * (2 * elements.shape[1] - 1 - a)) // 2 + c
        s0, s1, s2 = slots[e, pair, 0], slots[e, pair, 1], slots[e, pair, 2]
        if s0 < 0:
            continue
        k = (first + 9 * a) * PART + lane
        if a == c:
            data[s0] += bent[k]
            data[s0 + 1] += bent[k + PART]
            data[s0 + 2] += bent[k + 2 * PART]
            data[s1] += bent[k + 4 * PART]
            data[s1 + 1] += bent[k + 5 * PART]
            data[s2] += bent[k + 8 * PART]
            continue
        down, on = (3 * PART, PART) if elements[e, a] <= elements[e, c] else (PART, 3 * PART)
        for m in range(3):
            data[s0 + m] += bent[k + m * on]
            data[s1 + m] += bent[k + down + m * on]
            data[s2 + m] += bent[k + 2 * down + m * on]


@nb.njit(**ONCE)
def add_tangent(room, bent, owners, elements, slots, data, NODES, POINTS):
    """Add the tangents of the elements `owners` (n,), those of one part of the room, to data (nnz,)."""
    growth = moved_at(NODES, POINTS) + 3 * NODES
    stiff = load(room, growth + 6 * NODES + STIFF)
    for c in range(NODES):
        for q in range(POINTS):
            _bend(room, q * (GRADIENT + 3 * NODES), c, bent, SUMS * q)
        for a in range(c + 1):
            _node_block(room, bent, growth, stiff, a, c, NODES, POINTS)
        for lane in range(owners.shape[0]):
            _add_blocks(bent, SUMS * POINTS, lane, c, owners[lane], elements, slots, data)
