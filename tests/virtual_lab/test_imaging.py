"""The virtual camera draws balls where the pinhole sees them, and the flow finds how they moved."""

import cv2
import numpy as np
import pytest
from artificial_truth import small_study
from numpy.testing import assert_allclose, assert_array_equal
from pydantic import ValidationError

from gelforge.config import Camera, Features, VirtualImaging, VirtualParticles
from gelforge.recording.imaging.flow import Flow, grey, read_grey
from gelforge.recording.optics.camera import project
from gelforge.virtual_lab.imaging import as_read, draw, expose, picture
from gelforge.virtual_lab.particles import place_particles

CAMERA = Camera(
    width_px=400, height_px=400, focal_px=545.0, centre_px=[199.5, 199.5], position_mm=[16.0, 16.0, -46.0]
)
PLAIN = VirtualImaging(blur_px=0.0, noise_grey=0.0, background_grey=0.0, particle_grey=200.0)


def test_balls_are_cut_off_at_their_cover_and_noise_has_its_spread_and_seed():
    # Balls appear at their projection cover and are cut off
    centre = np.array([[12.34, 20.56, -2.0]])
    image = draw(CAMERA, PLAIN, centre, 0.6)
    (pixel,), (distance,) = project(CAMERA, centre)
    v, u = np.mgrid[:400, :400]
    # a disc of 7.4 px with a border of one pixel: its centroid is exact to a few hundredths
    assert_allclose([(image * u).sum() / image.sum(), (image * v).sum() / image.sum()], pixel, atol=0.03)
    radius = 545 * 0.3 / distance
    assert_allclose(
        (image > 0.45 * image.max() / 2).sum(), np.pi * radius**2, rtol=0.15
    )  # counted in whole pixels

    # Nearer balls cover farther ones
    near, far = [16.0, 16.0, -5.5], [16.0, 16.0, -2.0]
    alone = draw(CAMERA, PLAIN, np.array([near, [3.0, 3.0, -2.0]]), 0.6)
    for order in ([near, far], [far, near]):
        both = draw(CAMERA, PLAIN, np.array([*order, [3.0, 3.0, -2.0]]), 0.6)
        # the farther ball stands behind the middle of the nearer one: no trace of it but in the smoothed border
        assert_array_equal(both[197:203, 197:203], alone[197:203, 197:203])

    # Balls beyond the image are cut off
    image = draw(CAMERA, PLAIN, np.array([[-40.0, 16.0, -3.0], [1.4, 16.0, -6.0]]), 0.6)
    assert 0 < (image > 0).sum() < 80

    # Noise has its spread and seed and exposure scales the light alone
    imaging = VirtualImaging(noise_grey=2.0)
    flat = np.full((400, 400), 100, np.float32)
    first, again, other = (expose(flat, imaging, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    # 160,000 samples: 0.2 %; rounding to grey levels adds 1 / 12 to the variance
    assert_allclose(first.std(), np.sqrt(4 + 1 / 12), rtol=0.01)

    # Exposure scales the light and not the noise
    dim = expose(flat, VirtualImaging(), np.random.default_rng(0), 0.8)
    assert_allclose([dim.mean(), dim.std()], [80, np.sqrt(4 + 1 / 12)], rtol=0.01)


@pytest.mark.parametrize("shift_mm", [0.02, 0.1, 0.2])
def test_flow_finds_a_sub_pixel_shift_of_drawn_particles(shift_mm):
    # All particles lie in one thin sheet, so that all shift by the same number of pixels.
    sheet = small_study().sensor
    layers = [sheet.layers[0].model_copy(update={"thickness_mm": 1.0}), sheet.layers[1]]
    sheet = sheet.model_copy(update={"layers": layers})
    P = place_particles(VirtualParticles(diameter_mm=0.3, volume_fraction=0.08), sheet, "a")
    rng = np.random.default_rng(0)
    imaging = VirtualImaging()
    reference, image = (
        expose(draw(CAMERA, imaging, P + [shift, -shift, 0], 0.3), imaging, rng) for shift in (0, shift_mm)
    )
    flow = Flow(reference, Features().flow_preset)(image)[60:340, 60:340]
    exact = shift_mm * 545 / (46 - 2.35)  # the nearest centres cover the others
    regions = flow.reshape(28, 10, 28, 10, 2).mean(axis=(1, 3))
    # v grows downwards and y upwards; the search itself is off by up to 0.042 px, periodic in the shift (measured)
    assert_allclose(flow.mean(axis=(0, 1)), [exact, exact], atol=0.05)
    assert regions.std(axis=(0, 1)).max() < 0.04  # measured 0.03, with noise of 2 grey levels


def test_a_lens_moves_and_enlarges_a_ball_and_light_falls_to_the_corners():
    # A lens moves and enlarges a ball
    lens = {"coefficients": [-0.5, 0.0, 0.0, 0.0]}
    centre = np.array([[27.0, 16.0, -2.0]])
    camera = Camera(**(CAMERA.model_dump() | {"distortion": lens}))
    image = draw(camera, PLAIN, centre, 0.6)
    v, u = np.mgrid[:400, :400]
    pixel = project(camera, centre)[0][0]
    assert project(CAMERA, centre)[0][0, 0] - pixel[0] > 4
    assert_allclose([(image * u).sum() / image.sum(), (image * v).sum() / image.sum()], pixel, atol=0.05)
    # at r = 1 / 4: 1 - r^2 / 2 sideways, 1 - 3 r^2 / 2 along the radius
    plain = draw(CAMERA, PLAIN, centre, 0.6)
    shrunk = (1 - 0.25**2 / 2) * (1 - 3 * 0.25**2 / 2)
    assert_allclose(image.sum() / plain.sum(), shrunk, rtol=0.02)

    # Light falls to the corners and tilts
    imaging = PLAIN.model_copy(update={"background_grey": 100.0, "vignetting": 0.4, "uneven_light": 0.2})
    image = draw(CAMERA, imaging, np.array([[-40.0, 16.0, -3.0]]), 0.6)
    middle, left, right = image[199:201, 199:201].mean(), image[200, 0], image[200, 399]
    assert_allclose(middle, 100, rtol=1e-4)
    assert_allclose(
        (right - left) / middle, 0.2 * 0.8, rtol=1e-3
    )  # half the loss of the corners at the borders
    assert_allclose((image[0, 0] + image[0, 399]) / 2, 60, rtol=1e-3)


def test_defocus_loses_no_light_and_focus_and_colours_stay_as_written():
    # Defocus blurs what is off the plane in focus and loses no light
    near, far = np.array([[12.0, 16.0, -5.5]]), np.array([[20.0, 16.0, -0.5]])
    both = np.concatenate([near, far])
    sharp = draw(CAMERA, PLAIN, both, 0.6)
    imaging = PLAIN.model_copy(update={"defocus_px_per_mm": 0.6, "focus_z_mm": -5.5})
    image = draw(CAMERA, imaging, both, 0.6)
    halves = [(slice(None), slice(0, 200)), (slice(None), slice(200, 400))]  # the near ball, the far one
    assert_allclose(image[halves[0]], sharp[halves[0]], atol=1e-3)
    assert_allclose(image[halves[1]].sum(), sharp[halves[1]].sum(), rtol=1e-3)

    # before a bright ground the ball in focus hides what is behind it
    bright = {"background_grey": 150.0, "particle_grey": 40.0}
    covered, wanted = (
        draw(CAMERA, one.model_copy(update=bright), both, 0.6)[halves[0]] for one in (imaging, PLAIN)
    )
    assert_allclose(covered, wanted, atol=1e-3)

    def spread(picture):
        u = np.arange(200)
        weight = picture[halves[1]].sum(axis=0) / picture[halves[1]].sum()
        return (weight * u**2).sum() - (weight * u).sum() ** 2

    assert_allclose(spread(image) - spread(sharp), (0.6 * 5) ** 2, rtol=0.02)  # variances add

    # Focus and colours stay as written
    imaging = VirtualImaging(focus_z_mm=0.0, defocus_px_per_mm=0.3)
    assert VirtualImaging(**imaging.model_dump(mode="json")) == imaging
    assert "focus_z_mm" not in VirtualImaging().model_dump(mode="json")

    # Colours come together and grey cameras stay as written
    with pytest.raises(ValidationError, match="background_rgb is missing"):
        VirtualImaging(particle_rgb=[1.0, 2.0, 3.0])
    with pytest.raises(ValidationError, match="less than or equal to 255"):
        VirtualImaging(background_rgb=[1.0, 2.0, 300.0], particle_rgb=[1.0, 2.0, 3.0])
    assert not {"background_rgb", "particle_rgb"} & set(VirtualImaging().model_dump(mode="json"))
    assert as_read(PLAIN) is PLAIN
    assert (
        VirtualImaging(**VirtualImaging(**COLOURED).model_dump(mode="json")).particle_rgb
        == COLOURED["particle_rgb"]
    )


COLOURED = {"background_rgb": [60.0, 20.0, 10.0], "particle_rgb": [30.0, 220.0, 90.0]}
SEEN = np.random.default_rng(3).uniform([2, 2, -5.5], [30, 30, -2.0], (300, 3))


@pytest.mark.parametrize(
    "more", [{}, {"vignetting": 0.4, "uneven_light": 0.1, "blur_px": 0.8, "defocus_px_per_mm": 0.5}]
)
def test_the_grey_of_a_picture_in_colour_is_that_which_synthesis_draws(more, tmp_path):
    """A file, a frame of a video, and the settings of the grey image agree to rounding of channels and of grey."""
    imaging = PLAIN.model_copy(update=COLOURED | more)
    seen = picture(CAMERA, imaging, SEEN, 0.6)
    assert seen.shape == (400, 400, 3)
    recorded = expose(seen, imaging, np.random.default_rng(0))
    assert np.abs(np.ptp(recorded, axis=2).astype(int)).max() > 100  # it is not grey
    cv2.imwrite(str(tmp_path / "seen.png"), recorded)
    drawn = draw(CAMERA, as_read(imaging), SEEN, 0.6)
    assert_allclose(grey(recorded), drawn, atol=1.01)
    assert_allclose(read_grey(tmp_path / "seen.png") + 0.5, drawn, atol=1.01)  # libpng cuts decimals off
    if not more:  # red and blue exchanged would be seen: the ground is red
        assert_allclose(drawn[0, 0], 0.299 * 60 + 0.587 * 20 + 0.114 * 10, rtol=1e-5)


def test_noise_of_three_channels_averages_out_and_printed_dots_have_one_grey_level():
    # Noise of three channels averages out in grey
    imaging = VirtualImaging(**COLOURED, noise_grey=4.0)
    flat = np.full((400, 400, 3), 100, np.float32)
    read = grey(expose(flat, imaging, np.random.default_rng(0)))
    # 4 levels on three channels: 4 sqrt(.299^2 + .587^2 + .114^2); rounding to grey levels adds 1 / 12 to the variance
    assert_allclose(read.std(), np.sqrt(as_read(imaging).noise_grey ** 2 + 1 / 12), rtol=0.02)
    assert_allclose(as_read(imaging).noise_grey, 4 * 0.6685, rtol=1e-3)

    # Printed dots have one grey level however far they are
    centres = np.array([[8.0, 16.0, -5.0], [24.0, 16.0, -1.0]])
    shaded, flat = (draw(CAMERA, PLAIN, centres, 1.0, flat=flat) for flat in (False, True))
    (u, v), (far_u, far_v) = np.rint(project(CAMERA, centres)[0]).astype(int)
    assert flat[v, u] == flat[far_v, far_u] == 200
    assert shaded[far_v, far_u] < 140  # the farthest particle is 35 % less bright
    rim = np.rint(project(CAMERA, centres[:1] + [0.35, 0, 0])[0][0]).astype(int)
    assert flat[rim[1], rim[0]] == 200 and shaded[rim[1], rim[0]] < 180
    apart = draw(CAMERA, PLAIN.model_copy(update={"defocus_px_per_mm": 0.01}), centres, 1.0, flat=True)
    assert_allclose([apart[v, u], apart[far_v, far_u], apart[rim[1], rim[0]]], 200, atol=1)
