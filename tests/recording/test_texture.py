"""Flow where the reference shows texture, and between printed dots; nothing changes where texture is everywhere."""

import drawn
import numpy as np
import pytest
from drawn import photograph, still
from numpy.testing import assert_allclose, assert_array_equal

from gelforge.recording.imaging.flow import Flow, ImageError
from gelforge.recording.imaging.texture import Texture, noise_grey, textured

SIZE, MIDDLE = (240, 320), (160, 120)
DOTS, SPECKLE = drawn.dots(size=SIZE), drawn.speckle(size=SIZE)


def length(flow):
    return np.linalg.norm(flow, axis=-1)


@pytest.mark.parametrize("gain", [1.0, 0.7, 1.3, np.linspace(0.8, 1.2, SIZE[1])[None, :]])
def test_untouched_dots_do_not_move_whatever_the_light(gain):
    reference, image = photograph(DOTS, seed=1), photograph(DOTS, seed=2, gain=gain)
    search = Flow(reference, "fine")
    assert length(search.search.calc(reference, image, None)).mean() > 0.5  # what the search alone finds
    assert length(search(image)).mean() < 0.1


@pytest.mark.parametrize("field", [drawn.outward(5, MIDDLE), drawn.along(8, MIDDLE)])
def test_dots_carry_the_flow_between_them(field):
    flow = Flow(photograph(DOTS, seed=1), "fine")(photograph(DOTS, field, seed=2))
    error = length(flow - drawn.everywhere(field, SIZE))[30:-30, 30:-30]
    # dots 30 px apart sample a field of 45 px width: half a pixel is what they leave open
    assert error.mean() < 0.5
    assert length(flow)[:10, :10].max() < 0.5  # beyond the outermost dot, which moves by 0.25 px


def test_speckle_keeps_its_flow_and_untextured_parts_take_the_mean_around():
    # Speckle keeps its flow bit for bit
    field = drawn.outward(6, MIDDLE)
    reference, image = photograph(SPECKLE, seed=1), photograph(SPECKLE, field, seed=2)
    search = Flow(reference, "fine")
    mask = search.texture.mask
    assert mask.mean() > 0.95
    assert_array_equal(search(image)[mask], search.search.calc(reference, image, None)[mask])
    assert (
        length(search(image) - drawn.everywhere(field, SIZE)).mean() < 0.25
    )  # measured 0.21, as the search alone has

    # The flow that stands in is a mean of the flow around
    texture = Texture(photograph(DOTS), 16)
    uniform = np.broadcast_to(np.float32([3, -2]), (*SIZE, 2)).copy()
    filled = texture.fill(np.where(texture.mask[..., None], uniform, np.float32(50)))
    # within the dots' frame: between dots the share of texture is far above FAR_SHARE
    assert_allclose(filled[30:-30, 30:-30], uniform[30:-30, 30:-30], rtol=0.05)

    # Dim speckle is texture and stripes are none
    bright = photograph(SPECKLE, noise=0.4)
    dim = photograph(SPECKLE, noise=0.4, gain=0.15)
    assert textured(dim, 16).mean() > 0.9 * textured(bright, 16).mean()

    # Stripes are no texture as motion along them is not seen
    stripes = np.tile(128 + 60 * np.sin(np.arange(SIZE[1]) / 3), (SIZE[0], 1))
    noisy = stripes + np.random.default_rng(0).normal(0, 2, stripes.shape)
    assert textured(np.rint(noisy).astype(np.uint8), 16).mean() < 0.01


@pytest.mark.parametrize("sigma", [1.0, 2.0, 3.5])
def test_noise_is_estimated_from_the_smoothest_parts(sigma):
    # dots leave most of the image smooth; the lowest percentiles of 16 px squares lie up to a fifth below the mean
    assert_allclose(noise_grey(photograph(DOTS, noise=sigma)), sigma, rtol=0.25)


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_a_reference_without_texture_is_refused(grey):
    blank = photograph((np.empty((0, 2)), (), (), np.full(SIZE, float(grey))))
    with pytest.raises(ImageError, match="shows no texture that flow could follow"):
        Flow(blank, "fine")(photograph(SPECKLE, still))


V, U = np.mgrid[: SIZE[0], : SIZE[1]]
MASKS = {
    "border": (np.minimum(V, U) < 40) | (V >= SIZE[0] - 40) | (U >= SIZE[1] - 40),
    "round": np.hypot(U - MIDDLE[0], V - MIDDLE[1]) > 100,
}


@pytest.mark.parametrize("mask", MASKS)
@pytest.mark.parametrize("seed", range(20))
def test_a_constant_border_leaves_the_noise_finite(mask, seed):
    """A running sum that leaves bright pixels behind rounds to either side of zero, in about every third image."""
    image = np.random.default_rng(seed).integers(0, 255, SIZE).astype(np.uint8)
    assert 0.3 <= noise_grey(np.where(MASKS[mask], 0, image).astype(np.uint8)) <= 4.0


@pytest.mark.parametrize("mask", MASKS)
def test_a_mask_leaves_the_flow_far_from_it(mask):
    field, away = drawn.outward(6, MIDDLE), MASKS[mask]
    pair = photograph(SPECKLE, seed=1), photograph(SPECKLE, field, seed=2)
    masked = [np.where(away, 0, image).astype(np.uint8) for image in pair]
    search = Flow(masked[0], "fine")
    assert not search.texture.nowhere
    assert not search.texture.mask[away].all()
    middle = slice(80, 160), slice(120, 200)
    apart = length(search(masked[1]) - Flow(pair[0], "fine")(pair[1]))[middle]
    assert apart.mean() < 0.15  # px; against the true field either errs by 0.35
