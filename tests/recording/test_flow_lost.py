"""The share of lost pixels tells flow that is wrong from flow that is right, dots that jump to a neighbour included."""

import json

import drawn
import h5py
import numpy as np
import pytest
from drawn import photograph
from image_session import PLACES, write_image_session

from gelforge.config import Features
from gelforge.recording.features import found_in, session_features
from gelforge.recording.imaging import image_measures
from gelforge.recording.imaging.flow import Flow
from gelforge.recording.imaging.image_measures import flow_lost
from gelforge.recording.plausibility.images import MOST_LOST
from gelforge.recording.readings import read_recording

SIZE, MIDDLE = (240, 320), (160, 120)
PATTERNS = {"dots": drawn.dots(size=SIZE), "speckle": drawn.speckle(size=SIZE)}
RIGHT = [drawn.still, drawn.outward(5, MIDDLE), drawn.outward(10, MIDDLE), drawn.along(10, MIDDLE)]
WRONG = [drawn.outward(25, MIDDLE), drawn.along(45, MIDDLE), drawn.outward(32, MIDDLE)]


def lost_and_wrong(pattern, field, gain=1.0):
    """Return the lost share of the textured pixels and the share whose flow is off by 3 px and a fifth of the truth."""
    search = Flow(photograph(pattern, seed=1), "fine")
    image = photograph(pattern, field, seed=2, gain=gain)
    flow, truth, mask = search(image), drawn.everywhere(field, SIZE), search.texture.mask
    error, length = np.linalg.norm(flow - truth, axis=-1), np.linalg.norm(truth, axis=-1)
    return flow_lost(search, image, flow), (error > np.maximum(3, 0.2 * length))[mask].mean()


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("gain", [1.0, 0.75])
@pytest.mark.parametrize("field", RIGHT)
def test_flow_that_is_right_is_trusted(pattern, field, gain):
    lost, wrong = lost_and_wrong(PATTERNS[pattern], field, gain)
    assert wrong < 0.005
    assert lost < MOST_LOST


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("field", WRONG)
def test_flow_that_is_wrong_is_told(pattern, field):
    lost, wrong = lost_and_wrong(PATTERNS[pattern], field)
    assert wrong > 0.02
    assert lost > MOST_LOST


def test_features_name_the_indentations_that_the_flow_cannot_follow(tmp_path):
    presses = [
        (PLACES[k % 3], 3.0 if k == 4 else 1.0) for k in range(8)
    ]  # 15 px over 30 px are lost, 5 px are not
    folder = write_image_session(tmp_path / "s", presses=presses, px_per_mm=5.0)
    out = tmp_path / "f.h5"
    assert session_features(read_recording(folder), Features(regions=8), out) == 16
    with h5py.File(out) as file:
        lost = {press.decode() for press in file["press"][file["flow_lost"][:] > MOST_LOST]}
        untouched = file["flow_px"][file["phase"].asstr()[:] == "zero"]
    assert lost == {"p04"}
    assert untouched.max() < 0.05
    assert any(
        line.startswith("indentation p04 at 41 s: flow of p04_1.png fits the image on all but")
        for line in found_in(out)
    )


def test_images_beyond_the_sample_are_judged_with_the_features(tmp_path, monkeypatch):
    monkeypatch.setattr(image_measures, "RUNS", 2)
    monkeypatch.setattr(image_measures, "RUN_LENGTH", 3)
    presses = [(PLACES[k % 3], 0.5 + 0.1 * (k % 5)) for k in range(8)]  # two more than the sample
    blank = np.full(drawn.SIZE, 3, np.uint8)
    folder = write_image_session(
        tmp_path / "s",
        presses=presses,
        change=lambda n, p: [blank if name == "p03_1.png" else q for name, q in zip(n, p)],
    )
    recording = read_recording(folder)
    assert not recording.findings.of("excluded")
    out = tmp_path / "f.h5"
    assert session_features(recording, Features(regions=8), out) == 15
    (line,) = found_in(out)
    assert "image p03_1.png is black" in line
    with h5py.File(out) as file:
        assert "p03_1.png" not in file["image"].asstr()[:]
        assert len(file["feature"]) == len(file["image"]) == 15
        assert json.loads(file.attrs["excluded_images"]) == {"p03": 1}
        assert np.isfinite(file["feature"][:]).all()
