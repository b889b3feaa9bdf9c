"""Optical flow against known shifts, and against an independent code on real speckle images."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.config import Features
from gelforge.recording.imaging.flow import Flow, ImageError, crop, grey, read_grey

SHARED = Path(os.environ.get("GELFORGE_SHARED", Path(__file__).parents[3] / "shared"))
PRESET = Features().flow_preset


def shared(folder):
    path = SHARED / "data" / folder
    if not path.is_dir():
        pytest.skip(f"{path} is absent; set GELFORGE_SHARED to the folder that holds data/{folder}")
    return path


def texture(seed=0, size=(200, 240)):
    """Return a band-limited random image: its shift by the Fourier transform is exact."""
    noise = np.random.default_rng(seed).standard_normal(size)
    fy, fx = np.fft.fftfreq(size[0])[:, None], np.fft.fftfreq(size[1])[None, :]
    spectrum = np.fft.fft2(noise) * np.exp(-((np.hypot(fx, fy) / 0.08) ** 2))
    return spectrum, fy, fx


def shifted(texture, u, v):
    spectrum, fy, fx = texture
    image = np.fft.ifft2(spectrum * np.exp(-2j * np.pi * (fx * u + fy * v))).real
    return np.clip(128 + 40 * image / np.abs(np.fft.ifft2(spectrum)).std(), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("u", "v"), [(0, 0), (0.3, -0.2), (1.5, 0.5), (-3.25, 4.75)])
def test_a_shift_of_a_texture_is_found_with_its_sign(u, v):
    image = texture()
    flow = Flow(shifted(image, 0, 0), PRESET)(shifted(image, u, v))
    # away from the rim, where the texture leaves the image; the search is good to a few hundredths of a pixel
    assert_allclose(flow[20:-20, 20:-20].mean(axis=(0, 1)), [u, v], atol=0.03)


def test_no_motion_gives_no_flow():
    image = shifted(texture(), 0, 0)
    assert np.abs(Flow(image, PRESET)(image)).max() == 0


@pytest.mark.parametrize(("preset", "bias_px"), [("fast", 0.15), ("fine", 0.09), ("medium", 0.05)])
@pytest.mark.parametrize("number", [96, 100, 104, 108, 112, 116, 120, 124, 128])
def test_periodic_bias_on_particle_images(number, preset, bias_px):
    folder = shared("piv")
    first, second = (read_grey(folder / f"disp_{number:03d}{letter}.bmp") for letter in "ab")
    flow = Flow(first, preset)(second)[40:-40, 40:-40]
    # Particles of 2 px, smaller than a gel's, shifted by number / 32 px; measured at most 0.133, 0.074, 0.043 px
    assert_allclose(flow.mean(axis=(0, 1)), number / 32, atol=bias_px)


@pytest.mark.parametrize("frame", ["02", "04"])
def test_agreement_with_digital_image_correlation(frame):
    folder = shared("dic_speckle")
    reference, deformed = (read_grey(folder / f"oht_cfrp_{name}.tiff") for name in ("00", frame))
    lines = [
        line for line in (folder / f"DICe_solution_{frame}.txt").read_text().splitlines() if line[:1] != "*"
    ]
    names = lines[0].split(",")
    values = np.array([[float(number) for number in line.split(",")] for line in lines[1:] if line.strip()])
    column = {name: values[:, names.index(name)] for name in names}
    x, y = (np.rint(column[f"COORDINATE_{axis}"]).astype(int) for axis in "XY")
    flow = Flow(reference, PRESET)(deformed)
    smooth = cv2.blur(flow, (25, 25))  # the correlation's subsets average over such a window
    found = smooth[y, x]
    wanted = np.stack([column["DISPLACEMENT_X"], column["DISPLACEMENT_Y"]], axis=1)
    # DIS agrees to 0.007-0.010 px rms at full resolution; half resolution costs about as much again
    assert np.sqrt(((found - wanted) ** 2).mean()) < 0.03


def test_images_are_cropped_and_made_grey_and_unfit_ones_refused(tmp_path):
    # Crop and grey
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    assert_allclose(crop(image, [1, 0, 2, 3]), image[:3, 1:3])
    with pytest.raises(ImageError, match="reaches beyond"):
        crop(image, [1, 0, 4, 3])
    assert grey(np.dstack([image] * 3)).shape == (3, 4)
    assert grey(image) is image

    # Images that do not fit or cannot be read are refused
    flow = Flow(np.zeros((110, 120), np.uint8), PRESET)
    with pytest.raises(ImageError, match="110 x 120 px, but the reference frame has 120 x 110 px"):
        flow(np.zeros((120, 110), np.uint8))

    # Missing and undecodable files are named
    with pytest.raises(ImageError, match=r"a\.png: the image is missing"):
        read_grey(tmp_path / "a.png")
    (tmp_path / "b.png").write_bytes(b"not an image")
    with pytest.raises(ImageError, match=r"b\.png: cannot be decoded"):
        read_grey(tmp_path / "b.png")
