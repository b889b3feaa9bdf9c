"""The live path: the same features and forces as the dataset's, every step timed."""

from dataclasses import replace

import numpy as np
import pytest
from artificial_shards import small_rows, study_of, write_shards

from gelforge.config import Camera
from gelforge.learning.basis.scaling import ModelError
from gelforge.learning.deployment.predictor import STEPS, Predictor, Timing, predict_frames
from gelforge.learning.training.train import Run, train
from gelforge.recording.features import FlowFeatures
from gelforge.recording.imaging.flow import ImageError, reduced
from gelforge.recording.imaging.frames import Frame

SMALL = {"network": "paper", "hidden": [24, 16, 12], "batch_size": 8, "steps": 12, "validation_fraction": 0.2}


@pytest.fixture(scope="module")
def predictor(tmp_path_factory):
    folder, study = tmp_path_factory.mktemp("predictor"), study_of(regions=4, bins=5, **SMALL)
    shards = write_shards(folder / "dataset", small_rows(), study)
    train(study, shards, folder / "model.pt", folder / "loss.csv", Run(threads=1))
    return Predictor(folder / "model.pt", threads=1)


def pattern(shift, size=(120, 160)):
    """Return a smooth random image (H, W) uint8 shifted to the right [px]."""
    rng = np.random.default_rng(0)
    v, u = np.mgrid[: size[0], : size[1]]
    waves = rng.uniform(0.1, 0.5, (40, 2)) * rng.choice([-1, 1], (40, 2))
    phase = rng.uniform(0, 6, 40)
    grey = sum(np.sin(k[0] * (u - shift) + k[1] * v + p) for k, p in zip(waves, phase))
    return (128 + 12 * grey).clip(0, 255).astype(np.uint8)


def frames(*shifts):
    return [Frame(f"{i}.png", 0.1 * i, pattern(shift)) for i, shift in enumerate(shifts)]


def test_frames_give_what_the_stages_give_and_others_stop(predictor):
    # Frames give what the stages give one by one
    reference = pattern(0)
    found = list(predict_frames(predictor, frames(0, 1.5, 3), reference))
    for frame, prediction in zip(frames(0, 1.5, 3), found, strict=True):
        feature = FlowFeatures(reference, predictor.features)(frame.image)
        np.testing.assert_array_equal(prediction.force_N, predictor.model.predict(feature)[0])
        assert prediction.force_N.shape == (25, 3)
        assert prediction.name == frame.name

    # The first frame is the reference if none is given
    found = list(predict_frames(predictor, frames(0, 2)))
    expected = list(predict_frames(predictor, frames(0, 2), pattern(0)))
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.force_N, other.force_N)

    # Frames of another size and numbers not finite stop
    feature = np.zeros(32, np.float32)
    assert np.isfinite(predictor(feature)).all()
    feature[3] = np.nan
    with pytest.raises(ModelError, match="not finite, 1 features are not"):
        predictor(feature)

    # A frame of another size stops
    with pytest.raises(ImageError, match="160 x 120"):
        list(predict_frames(predictor, frames(0), pattern(0, (100, 100))))


def test_equal_frames_are_worked_out_again(predictor, monkeypatch):
    """Nothing is cached: four equal frames cost four calls of the flow."""
    calls = []
    monkeypatch.setattr(FlowFeatures, "__init__", counted(FlowFeatures.__init__, calls))
    list(predict_frames(predictor, frames(1, 1, 1, 1), pattern(0)))
    assert len(calls) == 4


def counted(init, calls):
    def counting(self, reference, settings):
        init(self, reference, settings)
        flow = self.flow
        self.flow = lambda image: calls.append(1) or flow(image)

    return counting


def test_frames_are_reduced_and_remapped_to_those_learnt_from(predictor):
    # Frames are reduced as the images that the model learnt from
    settings = predictor.model.settings
    reducing = Predictor.__new__(Predictor)
    reducing.model = replace(
        predictor.model, settings=settings | {"features": settings["features"] | {"image_scale": 0.8}}
    )
    small = reduced(pattern(0), 0.8)
    for frame, prediction in zip(
        frames(0, 2), predict_frames(reducing, frames(0, 2), pattern(0)), strict=True
    ):
        feature = FlowFeatures(small, reducing.features)(reduced(frame.image, 0.8))
        np.testing.assert_array_equal(prediction.force_N, predictor.model.predict(feature)[0])
    assert feature[:16].mean() == pytest.approx(2, rel=0.05)  # px of the frame

    # Frames of another camera are remapped to the models view
    keys = {"width_px": 160, "height_px": 120, "focal_px": 200.0, "position_mm": [16, 16, -46]}
    view, other = (
        Camera(**keys, centre_px=[u, 59.5]) for u in (79.5, 81.5)
    )  # 2 px to the right: whole pixels
    known = {
        "image_px": [160, 120],
        "crop_px": None,
        "camera": view.model_dump(mode="json"),
        "plane_z_mm": -3.0,
    }
    seen = Predictor.__new__(Predictor)
    seen.model = replace(predictor.model, settings=predictor.model.settings | {"views": {"day1": known}})
    found = list(predict_frames(seen, frames(2, 3.5), camera=other))
    as_seen = [
        Frame(f.name, f.time_s, np.pad(f.image[:, 2:], ((0, 0), (0, 2)), "edge")) for f in frames(2, 3.5)
    ]
    for one, wanted in zip(found, predict_frames(predictor, as_seen), strict=True):
        np.testing.assert_array_equal(one.force_N, wanted.force_N)
    with pytest.raises(ImageError, match="give --camera"):
        list(predict_frames(seen, frames(2)))


def test_every_step_is_timed_after_the_warm_up(predictor):
    timing = Timing()
    for prediction in predict_frames(predictor, frames(0, 1, 2, 3), pattern(0)):
        assert set(prediction.seconds) == set(STEPS)
        timing.add(prediction)
    table = timing.table().set_index("step")
    assert list(table.index) == [*STEPS, "whole"]
    assert (table["frames"] == 4).all()
    assert (table["p99_ms"] >= table["p95_ms"]).all()
    assert (table["p95_ms"] >= table["p50_ms"]).all()
    assert table.loc["whole", "p50_ms"] >= table.loc["flow", "p50_ms"]
    assert table.loc["whole", "fps_at_p50"] == pytest.approx(1000 / table.loc["whole", "p50_ms"])

    # Frames of the warm up are not counted
    timing = Timing(warm_up=3)
    for prediction in predict_frames(predictor, frames(0, 1, 2), pattern(0)):
        timing.add(prediction)
    assert timing.table().empty
    for prediction in predict_frames(predictor, frames(0, 1), pattern(0)):
        timing.add(prediction)
    assert (timing.table()["frames"] == 2).all()


@pytest.fixture
def seen(predictor):
    """The predictor of a model that learnt from the middle of images of 200 x 160 px."""
    view = {"image_px": [200, 160], "crop_px": [20, 20, 160, 120], "camera": None}
    model = replace(predictor.model, settings=predictor.model.settings | {"views": {"day1": view}})
    other = Predictor.__new__(Predictor)
    other.model = model
    return other


@pytest.mark.parametrize(
    ("size", "asked"),
    [((160, 200), None), ((120, 160), None), ((400, 400), [7, 7, 160, 120])],
    ids=["as taken", "cropped before", "a crop of that size"],
)
def test_frames_like_those_learnt_from_pass(seen, size, asked):
    found = [Frame("a.png", 0.0, pattern(shift, size)) for shift in (0, 1)]
    assert len(list(predict_frames(seen, found, crop_px=asked))) == 2


@pytest.mark.parametrize(
    ("size", "asked", "words"),
    [
        (
            (240, 320),
            None,
            "image of 320 x 240 px, but the model learnt from images of 200 x 160 px of which",
        ),
        ((160, 200), [0, 0, 100, 100], r"of which \[0, 0, 100, 100\] is used"),
    ],
)
def test_frames_of_another_size_than_those_learnt_from_are_refused(seen, size, asked, words):
    with pytest.raises(ImageError, match=words):
        list(predict_frames(seen, [Frame("a.png", 0.0, pattern(0, size))], crop_px=asked))
