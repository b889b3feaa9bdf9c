"""How closed surfaces lie to one another: what a mesher of tetrahedra is given must be one body on the base.

Solids from a CAD program come nested (a skin's surface encloses the gel), or as slabs whose faces touch. Slabs that end a
little apart, or reach a little into one another, are drawn wrong: a mesher fills such gaps with tiny elements.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from gelforge.mechanics.indenters.closed_surface import SurfaceError
from gelforge.meshing.solids import Solids

# Chambers and gaps of small bodies are distinguished from touching ones (tests/meshing/test_layout.py):
SAME_PLACE = 5e-4  # of the body's largest extent: surfaces this near coincide, 0.01 mm of 20 mm
# Of it: a gap between facing surfaces that is narrower is no chamber, 0.4 mm of 20 mm. One of 0.1 mm is asked about
# (tests/meshing/test_layout.py).
THIN = 0.02
# Cosine between normals of faces that look at each other, within 45 deg (tests/meshing/test_layout.py).
FACING = -0.7
# Of a surface's points that must face another across a thin gap: fewer lie along an edge (tests/meshing/test_layout.py).
SHARE = 0.01


@dataclass(frozen=True)
class Pair:
    """How a surface lies to a later one; lengths in mm."""

    inside: bool  # the first lies in the second, or on it
    around: bool  # the second lies in the first
    overlap: float  # how deep they reach into one another, 0 if they do not
    gap: float  # their least distance, 0 where they touch
    thin_gap: float  # the widest thin gap across which faces of disjoint solids look at each other


def check_layout(solids: Solids, confirmed: bool) -> None:
    """Refuse solids that do not hang together, hide one another, overlap or leave thin gaps.

    Parameters
    ----------
    solids : Solids
        From the inside out [mm].
    confirmed : bool
        Overlaps and thin gaps are meant.

    Raises
    ------
    SurfaceError
        Names the layers, the distance [mm] and the remedy.
    """
    low, high = solids.bounds
    size = float(np.ptp([low, high], axis=0).max())
    near = SAME_PLACE * size
    if low[2] > solids.base + near:
        raise SurfaceError(
            f"the surfaces end at z = {low[2]:.4g} mm, {low[2] - solids.base:.3g} mm above the base at {solids.base:g} mm: "
            "correct the layers' thickness_mm or shape.base_mm"
        )
    pairs = {
        (i, j): _pair(solids, i, j, near, THIN * size) for i, j in combinations(range(len(solids.names)), 2)
    }
    _check_together(solids, pairs, near)
    for (i, j), pair in pairs.items():
        names = f"{solids.names[i]} and {solids.names[j]}"
        if pair.around:
            raise SurfaceError(
                f"the surface of {solids.names[j]} lies inside that of {solids.names[i]}, which is listed before it and "
                "takes all of it: list layers and shape.files from the inside out"
            )
        if pair.overlap and not confirmed:
            raise SurfaceError(
                f"the solids of {names} reach {pair.overlap:.3g} mm into one another: draw them so that they touch or that "
                "the outer one encloses the inner one, or set shape.layout_confirmed: true if the first listed is to keep "
                "what they share"
            )
        if pair.thin_gap and not confirmed:
            raise SurfaceError(
                f"the solids of {names} face each other across a gap of up to {pair.thin_gap:.3g} mm: draw them so that "
                "their faces touch, or set shape.layout_confirmed: true if the gap is meant"
            )


def _check_together(solids: Solids, pairs: dict[tuple[int, int], Pair], near: float) -> None:
    """Refuse a solid that neither stands on the base nor touches one that does."""
    held = {i for i, s in enumerate(solids.surfaces) if s.vertices[:, 2].min() <= solids.base + near}
    joined = [set(pair) for pair, lie in pairs.items() if lie.inside or lie.overlap or not lie.gap]
    while grown := [both for both in joined if len(both & held) == 1]:
        held = held.union(*grown)
    for k in (k for k in range(len(solids.names)) if k not in held):
        gaps = {other: pairs[min(k, other), max(k, other)].gap for other in held}
        nearest = min(gaps, key=gaps.__getitem__)
        raise SurfaceError(
            f"the solids of {solids.names[nearest]} and {solids.names[k]} do not touch, they are {gaps[nearest]:.3g} mm "
            "apart, and the latter floats: draw them so that their faces touch or that the outer one encloses the inner one"
        )


def _pair(solids: Solids, i: int, j: int, near: float, thin: float) -> Pair:
    """Return how surface i lies to surface j; near: what counts as touching, thin: the widest thin gap [mm]."""
    first, second = solids.surfaces[i], solids.surfaces[j]
    to_second, normal_of_second, _ = second.distance(first.outline)
    to_first, _, _ = first.distance(second.outline)
    inside, around = not (to_second > near).any(), not (to_first > near).any()
    gap = float(min(to_second.min(), to_first.min()))
    disjoint, thin_gap = gap >= -near, 0.0
    if disjoint:
        outward = first.distance(first.outline)[1]
        facing = (to_second > near) & (to_second < thin)
        facing &= np.einsum("ni,ni->n", outward, normal_of_second) < FACING
        between = (first.outline - to_second[:, None] / 2 * normal_of_second)[facing]
        others = [solids.surfaces[k] for k in range(len(solids.names)) if k not in (i, j)]
        clear = [other.distance(between)[0] > 0 for other in others]
        empty = np.all([*clear, np.ones(len(between), bool)], axis=0)
        thin_gap = float(to_second[facing][empty].max()) if empty.sum() > SHARE * len(facing) else 0.0
    overlap = 0.0 if inside or around or disjoint else -gap
    return Pair(inside, around, overlap, gap if gap > near else 0.0, thin_gap)
