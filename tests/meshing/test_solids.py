"""Closed surfaces of blocks and domes against closed forms."""

import numpy as np
import pytest

from gelforge.mechanics.indenters.closed_surface import SurfaceError
from gelforge.mechanics.meshes.mesh import Block
from gelforge.meshing.solids import area, block_solids, dome_solids, enclosed_volume


def test_domes_and_blocks_have_the_volumes_of_their_closed_forms():
    # A dome is the half ellipsoid by volume faces and area
    surface = dome_solids(24.0, 20.0, (("gel", 9.0),)).surfaces[0]
    # Faces between points 0.4 mm apart on radii of 9 to 12 mm cut off 1e-3 of the volume at most.
    assert enclosed_volume(surface) == pytest.approx(2 / 3 * np.pi * 12 * 10 * 9, rel=1e-3)
    curved = surface.vertices[surface.vertices[:, 2] > -8.99]
    scaled = (curved - [12.0, 10.0, -9.0]) / [12.0, 10.0, 9.0]
    assert np.linalg.norm(scaled, axis=1) == pytest.approx(1.0, abs=1e-12)

    # Middles of the faces of a hemisphere of 10 mm lie less than 0.005 mm inside it.
    surface = dome_solids(20.0, 20.0, (("gel", 10.0),)).surfaces[0]
    corner = surface.vertices[surface.triangles]
    curved = corner[(corner[..., 2].max(axis=1) > -9.99)].mean(axis=1)
    assert np.linalg.norm(curved - [10.0, 10.0, -10.0], axis=1).min() > 10.0 - 0.005

    # A hemispheres area
    assert area(surface) == pytest.approx(3 * np.pi * 100, rel=1e-3)

    # A block holds its layers inside the wall
    solids = block_solids(Block(10.0, 8.0, (("gel", 2.5), ("skin", 1.0)), wall=1.0))
    assert solids.names == ("gel", "skin")
    assert [enclosed_volume(surface) for surface in solids.surfaces] == pytest.approx(
        [8 * 6 * 2.5, 10 * 8 * 3.5]
    )
    assert solids.base == -3.5


def test_a_skin_has_the_same_thickness_everywhere_or_is_refused():
    gel, whole = dome_solids(24.0, 20.0, (("gel", 8.0), ("skin", 1.5))).surfaces
    on_dome = gel.vertices[
        gel.vertices[:, 2] > gel.vertices[:, 2].min() + 1.6
    ]  # the base is further than the skin
    # The outer faces lie up to 0.003 mm inside the ellipsoid.
    assert -whole.distance(on_dome)[0] == pytest.approx(1.5, abs=4e-3)

    # A skin thicker than the curvature is refused
    with pytest.raises(
        SurfaceError, match=r"9 mm thick, the dome's smallest radius of curvature is 8\.33 mm"
    ):
        dome_solids(24.0, 24.0, (("gel", 1.0), ("skin", 9.0)))
