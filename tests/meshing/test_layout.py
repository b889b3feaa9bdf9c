"""How solids may lie to one another: nested, as slabs that touch, or side by side on the base."""

import numpy as np
import pytest
from small_shapes import SHAPES

from gelforge.mechanics.indenters.closed_surface import SurfaceError, closed_surface
from gelforge.meshing.layout import check_layout
from gelforge.meshing.solids import _box, given_solids

WIDE = 20.0


def box(low, high, x=(0.0, WIDE), tilt=0.0):
    """Return a closed box between two heights [mm]; tilt: its lower face rises by this much along x."""
    vertices, triangles = _box([x[0], 0.0, low], [x[1], WIDE, high])
    lower = np.isclose(vertices[:, 2], low)
    return closed_surface(vertices + np.outer(lower * vertices[:, 0] / WIDE, [0.0, 0.0, tilt]), triangles)


def solids(base=-6.0, **surfaces):
    return given_solids(surfaces, base)


HONEST = {
    "one solid": solids(gel=box(-6.0, 0.0)),
    "slabs that touch": solids(gel=box(-6.0, -1.0), skin=box(-1.0, 0.0)),
    "three slabs": solids(gel=box(-6.0, -1.0), bond=box(-1.0, -0.9), skin=box(-0.9, 0.0)),
    "a skin around the gel": solids(gel=box(-6.0, -1.0, x=(1.0, 19.0)), skin=box(-6.0, 0.0)),
    "a skin over the gel, drawn through": solids(gel=box(-6.0, -1.0), skin=box(-6.0, 0.0)),
    "pillars side by side": solids(left=box(-6.0, 0.0, x=(0.0, 8.0)), right=box(-6.0, 0.0, x=(12.0, 20.0))),
    "a narrow plate over a gel": solids(gel=box(-6.0, -1.0), skin=box(-1.0, 0.0, x=(5.0, 15.0))),
    "faces 2 micrometres apart": solids(gel=box(-6.0, -1.002), skin=box(-1.0, 0.0)),
    "a small sensor": solids(-0.15, gel=box(-0.15, -0.05, x=(0, 0.5)), skin=box(-0.05, 0.0, x=(0, 0.5))),
}


@pytest.mark.parametrize(
    "honest", [*HONEST.values(), *(s for s, _ in SHAPES.values())], ids=[*HONEST, *SHAPES]
)
def test_one_body_on_its_base_is_accepted(honest):
    check_layout(honest, confirmed=False)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (
            solids(gel=box(-6.0, -1.05), skin=box(-1.0, 0.0)),
            "gel and skin do not touch, they are 0.05 mm apart",
        ),
        (solids(gel=box(-6.0, -1.0), bond=box(-0.9, -0.8), skin=box(-0.8, 0.0)), "gel and bond do not touch"),
        (solids(skin=box(-6.0, 0.0), gel=box(-6.0, -1.0)), "gel lies inside that of skin, .* inside out"),
        (solids(-7.0, gel=box(-6.0, 0.0)), r"end at z = -6 mm, 1 mm above the base at -7 mm"),
    ],
)
def test_solids_that_are_no_body_are_refused_also_if_confirmed(wrong, words):
    for confirmed in (False, True):
        with pytest.raises(SurfaceError, match=words) as refused:
            check_layout(wrong, confirmed)
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("odd", "words"),
    [
        (solids(gel=box(-6.0, -1.0), skin=box(-1.2, 0.0)), "gel and skin reach 0.2 mm into one another"),
        (solids(gel=box(-6.0, -1.0), skin=box(-1.0, 0.0, tilt=0.2)), "across a gap of up to 0.2 mm"),
        (
            solids(a=box(-6.0, 0.0, x=(0.0, 10.0)), b=box(-6.0, 0.0, x=(10.1, 20.0))),
            "across a gap of up to 0.1 mm",
        ),
    ],
)
def test_overlaps_and_thin_gaps_are_asked_about(odd, words):
    with pytest.raises(SurfaceError, match=f"{words}.*layout_confirmed: true"):
        check_layout(odd, confirmed=False)
    check_layout(odd, confirmed=True)
