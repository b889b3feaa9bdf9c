"""What effects make of each element's shear and bulk modulus, against closed forms."""

import numpy as np
import pytest
import specimens
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from gelforge.config import ConfigError
from gelforge.indentation.effects.catalogue import CATALOGUE, with_keys
from gelforge.indentation.effects.fields import element_stiffness, eshelby_factor, mixed_factor
from gelforge.indentation.sensor.sensor_mesh import sensor_mesh
from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.mechanics.linear.sparsity import build_pattern


def factors(**families):
    """Return the mesh of the small sensor and the factors on its elements' shear and bulk moduli."""
    described = with_keys(specimens.study(), **families)
    mesh = sensor_mesh(described.sensor, described.mechanics.mesh, *specimens.CORNER)
    return mesh, *element_stiffness(mesh, described.sensor, described.mechanics)


def volumes(mesh):
    corner = mesh.X[mesh.elements]
    return (corner.max(axis=1) - corner.min(axis=1)).prod(axis=1)  # boxes along the axes


def test_particles_age_temperature_and_a_toe_change_the_moduli():
    # Particles stiffen by eshelby and settle downwards
    assert eshelby_factor(0.02) == pytest.approx(1 / 0.95)
    mesh, shear, bulk = factors(material={"particles": {"stiffening": 1.0}})
    gel = mesh.region == mesh.regions.index("gel")
    assert_allclose(shear[gel], 1 / (1 - 2.5 * 0.02), rtol=1e-14)
    assert (shear[~gel] == 1).all() and bulk is shear
    mesh, shear, _ = factors(material={"particles": {"settling": 0.5}})
    z = mesh.X[mesh.elements, 2].mean(axis=1)  # gel from -4 to -1
    assert_allclose(shear[gel], 1 / (1 - 2.5 * 0.02 * 0.5 * (-2.5 - z[gel]) / 1.5), rtol=1e-14)
    v = volumes(mesh)[gel]
    assert ((1 - 1 / shear[gel]) * v).sum() == pytest.approx(0, abs=1e-12)  # none are lost

    # Age and temperature multiply
    circumstances = {
        "ageing_per_day": {"gel": 0.01}, "age_days": 12.0, "reference_age_days": 2.0,
        "stiffening_per_K": {"gel": -0.002, "wall": 0.01}, "temperature_C": 28.0,
    }  # fmt: skip
    mesh, shear, _ = factors(material={"circumstances": circumstances})
    known = {"gel": 1.1 * 0.99, "skin": 1.0, "wall": 1.05}
    assert_allclose(shear, [known[mesh.regions[r]] for r in mesh.region], rtol=1e-14)
    with pytest.raises(ConfigError, match="stiffness factor of -1"):
        factors(material={"circumstances": {"ageing_per_day": {"gel": -0.2}, "age_days": 10.0}})

    # A toe is in series with the rest of its element
    mesh, shear, _ = factors(geometry={"toe": {"thickness_mm": 0.2, "factor": 0.1}})
    z = mesh.X[mesh.elements, 2]
    height = np.ptp(z, axis=1)
    top = np.isclose(z.max(axis=1), 0)
    assert_allclose(shear[top], 1 / (1 - 0.2 / height[top] + 0.2 / height[top] / 0.1), rtol=1e-12)
    assert (shear[~top] == 1).all()


def far_field(factor):
    """Return what a ball of a stiffness does to all around it, per volume (Eshelby 1957, an incompressible matrix)."""
    return (factor - 1) / (1 + 0.4 * (factor - 1))


def volume_field(factor):
    """Return how far a ball gives way to pressure, per volume, in a matrix of the default K / G (Eshelby 1957)."""
    return (1 - factor) / (factor + 4 / (3 * 1000))


@pytest.mark.parametrize("factor", [0.001, 0.25, 4.0, 100.0])
def test_elements_in_part_in_a_ball_act_as_the_ball_by_its_own_volume(factor):
    ball = {"centre_mm": [8.0, 8.0, -2.4], "radius_mm": 1.2, "factor": factor}
    mesh, shear, bulk = factors(geometry={"inclusions": [ball]})
    there = (far_field(shear) / far_field(factor) * volumes(mesh)).sum()
    assert there == pytest.approx(4 / 3 * np.pi * 1.2**3, rel=0.02)  # samples 0.17 mm apart
    gives = (volume_field(bulk) / volume_field(factor) * volumes(mesh)).sum()
    assert gives == pytest.approx(4 / 3 * np.pi * 1.2**3, rel=0.02)
    assert ((shear - 1) * (factor - 1) >= 0).all()
    assert (np.abs(np.log(shear)) <= np.abs(np.log(factor)) * (1 + 1e-12)).all()


@given(share=st.floats(0, 1), factor=st.floats(1e-3, 1e4))
def test_a_mixed_element_is_between_stiffnesses_in_a_row_and_side_by_side(share, factor):
    """Reuss and Voigt bound it, and a weak ball is the mean of both."""
    row, side_by_side = 1 / (1 + share * (1 / factor - 1)), 1 + share * (factor - 1)
    assert row * (1 - 1e-9) <= mixed_factor(factor, share) <= side_by_side * (1 + 1e-9)
    assert mixed_factor(1 + 1e-6, share) - 1 == pytest.approx(share * 1e-6, rel=1e-3, abs=1e-15)


def test_a_bubble_and_a_ball_give_way_to_pressure_by_factors_of_their_own():
    """Eshelby: its strain per far shear grows as far_field, its change of volume per far pressure as 1 / (K + 4/3 G)."""
    ratio = specimens.study().mechanics.bulk_to_shear

    def answers(amount):
        (ball,) = CATALOGUE["void"](specimens.study(), amount).mechanics.effects.geometry.inclusions
        volume = 1 / (ratio * ball.bulk_factor + 4 / 3) - 1 / (ratio + 4 / 3)
        return far_field(ball.factor), volume

    whole = answers(1.0)
    assert (
        whole[0] == pytest.approx(-1 / 0.6, rel=2e-3) and whole[1] > 0.4
    )  # 3/4 were its own resistance none
    for amount in (1e-3, 0.3, 0.8):
        assert answers(amount) == pytest.approx([amount * a for a in whole], rel=3e-3)

    # A ball may give way to pressure by a factor of its own
    ball = {"centre_mm": [8.0, 8.0, -2.4], "radius_mm": 1.2, "factor": 0.5}
    _, shear, bulk = factors(geometry={"inclusions": [ball | {"bulk_factor": 0.01}]})
    _, same, other = factors(geometry={"inclusions": [ball]})
    assert np.array_equal(shear, same)
    assert_allclose(
        volume_field(bulk) / volume_field(0.01), volume_field(other) / volume_field(0.5), rtol=1e-6, atol=1e-9
    )


def test_a_wall_gap_weakens_a_strip_as_four_sides_do():
    # A wall gap weakens a strip of the gel along the wall
    mesh, shear, bulk = factors(geometry={"wall_gap": {"width_mm": 0.5, "loss": 0.4}})
    gel = mesh.region == mesh.regions.index("gel")
    lost = ((1 - shear) / (0.4 * 0.999) * volumes(mesh)).sum()
    assert lost == pytest.approx((14**2 - 13**2) * 3, rel=1e-9)
    assert (shear[~gel] == 1).all()
    assert_allclose(bulk, shear, rtol=1e-3)

    # K over G is 1000: what is left of each is a thousandth of G.
    _, shear, bulk = factors(geometry={"wall_gap": {"width_mm": 1.0, "loss": 1.0}})
    assert (shear < 0.9).any()
    assert_allclose((1 - bulk) / (1 - 1e-6), (1 - shear) / (1 - 1e-3), rtol=1e-12)

    # All four sides of a bond are the gap along the wall. But for the strips' corners, where two sides lose a share
    # each
    sides = [{"side": side, "bond_loss": 0.4} for side in ("x_low", "x_high", "y_low", "y_high")]
    mesh, around, _ = factors(geometry={"wall_gap": {"width_mm": 0.5, "loss": 0.4}})
    _, four, _ = factors(geometry={"wall_sides": sides})
    away = np.abs(mesh.X[mesh.elements][..., :2] - 8).max(axis=1)
    corner = (away > 6.5).all(axis=1)
    assert_allclose(four[~corner], around[~corner], rtol=1e-12)


@pytest.mark.parametrize("side", ["x_low", "x_high", "y_low", "y_high"])
def test_a_side_weakens_the_wall_or_the_gel_along_it(side):
    """By volume: 1 mm of wall over the sensor's width, half a millimetre of gel within the wall, as high as the gel."""
    for lost, region, volume in (("wall_loss", "wall", 16 * 3), ("bond_loss", "gel", 0.5 * 14 * 3)):
        mesh, shear, bulk = factors(geometry={"wall_sides": [{"side": side, lost: 0.4}]})
        assert ((1 - shear) / (0.4 * 0.999) * volumes(mesh)).sum() == pytest.approx(volume, rel=1e-9)
        assert set(mesh.region[shear < 1]) == {mesh.regions.index(region)}
        assert_allclose(bulk, shear, rtol=1e-3)
        middle = mesh.X[mesh.elements[shear < 1]].mean(axis=(0, 1))["xy".index(side[0])]
        assert (middle > 8) == side.endswith("high")


def test_shear_and_bulk_change_apart():
    # A loose film keeps its bulk and loses its shear
    patch = {"centre_mm": [8.0, 8.0], "radius_mm": 2.0, "layer": "gel", "film_mm": 0.5, "loss": 1.0}
    mesh, shear, bulk = factors(geometry={"delaminations": [patch]})
    assert (bulk == 1).all()
    lost = ((1 - shear) / 0.999 * volumes(mesh)).sum()
    assert lost == pytest.approx(np.pi * 2**2 * 0.5, rel=0.03)
    touched = mesh.X[mesh.elements[shear < 1]][..., 2]
    assert touched.max() == pytest.approx(-1.0)  # under the gel's top face

    # Shear and bulk of an element scale apart. One element of 1 mm3: simple shear meets 0.1 mu, a change of volume
    # the whole K
    mu, ratio, small = 0.02, 50.0, 1e-5
    cube = specimens.box(1)
    free = build_pattern(cube.elements, np.zeros(8, bool))
    body = Body(cube, {"gel": NeoHooke(mu)}, ratio, free, np.array([0.1]), np.array([1.0]))
    shear = small * np.outer(cube.X[:, 2], [1.0, 0.0, 0.0])
    top = np.isclose(cube.X[:, 2], cube.X[:, 2].max())
    force = body.response(shear, np.zeros(1)).f_condensed[top, 0].sum()
    assert force == pytest.approx(0.1 * mu * small, rel=1e-6)
    assert body.response(small * cube.X, np.zeros(1)).p_volume == pytest.approx(
        3 * small * ratio * mu, rel=1e-4
    )
