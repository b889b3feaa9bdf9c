"""Radius of curvature at a membrane's apex, against silhouettes whose radius is known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_pictures.membrane_views import MembraneFilm, silhouette
from synthetic_pictures.speckle import Camera

from gelforge.materials.imaging.apex_shape import SilhouetteError, apex_shape, flat_row_px

SHAPE = (360, 400)


CLEAR = Camera()


def view(a, b, height, camera=CLEAR, seed=3, clamp=120):
    return silhouette(SHAPE, a, b, height, clamp, camera, np.random.default_rng(seed))


@pytest.mark.parametrize("stretch", [1.03, 1.1, 1.3, 1.8, 2.2])
def test_radius_of_a_cap(stretch):
    film = MembraneFilm(np.array([1.0, stretch]))
    shape = apex_shape(film.side_view(1), film.mm_per_px)
    # 0.2 %: the outline is found to 0.02 px, the flattest arc here is 22 px high
    assert_allclose(shape.radius_mm, film.radius_mm[1], rtol=2e-3)
    assert shape.standard_error_mm < 2e-3 * shape.radius_mm
    assert shape.rms_px < 0.05
    height = (flat_row_px(film.side_view(0)) - shape.apex_px[1]) * film.mm_per_px
    assert_allclose(height, film.height_mm[1], atol=0.01)  # a tenth of a pixel


@pytest.mark.parametrize(("a", "b", "height"), [(120, 180, 200), (150, 100, 120)])
def test_apex_radius_of_an_ellipse_is_not_that_of_a_circle_through_it(a, b, height):
    shape = apex_shape(view(a, b, height), 0.05)
    assert_allclose(shape.radius_mm, 0.05 * a**2 / b, rtol=5e-3)  # four free parameters instead of three
    assert abs(shape.circle_radius_mm / (0.05 * a**2 / b) - 1) > 0.1
    assert_allclose(shape.conic_constant, (a / b) ** 2, rtol=0.03)


def test_a_circle_stays_a_circle_and_what_has_no_radius_is_refused():
    # A circle stays a circle with dust or blur
    picture = view(130, 130, 150).astype(float)
    picture[60:66, 300:304] = 40  # dust on the screen, above the flank
    picture[173:183, 196:206] = 40  # and on the apex itself, a bump of 7 px
    shape = apex_shape(picture, 1.0)
    assert_allclose(shape.radius_mm, 130, rtol=2e-3)

    # Bright membrane on dark screen and blur
    picture = 255 - view(130, 130, 150, Camera(blur_px=2.0, noise_grey=4.0)).astype(int)
    assert_allclose(apex_shape(picture, 1.0).radius_mm, 130, rtol=3e-3)

    # What has no radius is refused
    film = MembraneFilm(np.array([1.0, 1.002]))
    for number in (0, 1):
        with pytest.raises(SilhouetteError, match="too flat"):
            apex_shape(film.side_view(number), 0.1)
    with pytest.raises(SilhouetteError, match="differ by"):
        apex_shape(np.full(SHAPE, 128), 0.1)
    narrow = np.full(SHAPE, 200)
    narrow[:, 130:140] = 20  # a needle
    narrow[-20:, 130:270] = 20
    with pytest.raises(SilhouetteError, match="too flat|columns show an outline"):
        apex_shape(narrow, 0.1)
