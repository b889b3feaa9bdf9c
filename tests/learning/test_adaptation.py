"""A model on a sensor with another gain: a few presses with measured forces mend it, and no more than they can tell."""

from dataclasses import replace

import numpy as np
import pytest
from artificial_shards import small_rows, study_of, write_shards

from gelforge.dataset.shard import ShardDataset
from gelforge.learning.basis.scaling import ModelError
from gelforge.learning.models.model_file import load_model, save_model
from gelforge.learning.models.reliability import Intervals
from gelforge.learning.models.views import check_same_images, check_scale
from gelforge.learning.training.adaptation import (
    Presses,
    adapt,
    drawn_presses,
    errors_table,
    measured_presses,
    press_names,
)
from gelforge.learning.training.train import Run, train
from gelforge.progress import show

SMALL = {"network": "paper", "hidden": [24, 16, 12], "batch_size": 8, "steps": 120, "learning_rate": 1e-3}


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Return a model, and the presses that it was not tested on."""
    folder, study = (
        tmp_path_factory.mktemp("adapted"),
        study_of(regions=4, bins=5, validation_fraction=0.2, **SMALL),
    )
    shards = write_shards(folder / "dataset", small_rows(), study)
    train(study, shards, folder / "model.pt", folder / "loss.csv", Run(threads=1))
    rows = ShardDataset(shards, "train")
    return load_model(folder / "model.pt"), measured_presses(rows, press_names(rows))


def with_readings(model, presses, gain, noise=0.0):
    """Return presses whose readings are the model's own totals times a gain, with noise in shares of their spread."""
    total = model.predict(presses.feature).sum(axis=1) * gain
    noisy = total + noise * total.std() * np.random.default_rng(0).standard_normal(total.shape)
    return Presses(presses.feature, noisy, presses.press)


def some_of(presses, count):
    chosen = drawn_presses(presses.press, count, 0)
    return presses.of(np.isin(presses.press.astype(str), list(chosen)))


@pytest.mark.parametrize(
    ("gain", "form"),
    [
        ((1.12, 1.12, 1.12), "one gain"),
        ((1.0, 1.0, 1.0), "none"),
        ((0.8, 0.8, 1.2), "horizontal and vertical gain"),
    ],
)
def test_gains_are_found_and_the_simplest_form_taken(trained, gain, form):
    model, presses = trained
    read = with_readings(model, presses, np.array(gain), 0.01)
    changed, found = adapt(model, some_of(read, 15))
    assert found.form == form
    np.testing.assert_allclose(found.gain, gain, rtol=0.02)
    was, now = (one.predict(presses.feature).sum(axis=1)[:, 2] for one in (model, changed))
    np.testing.assert_allclose(now, gain[2] * was, rtol=0.02, atol=1e-6)
    table = errors_table({"before": model, "after": changed}, read).set_index("model")
    assert table.loc["after", "total_z_rms_N"] <= table.loc["before", "total_z_rms_N"] + 1e-9


def test_predictions_of_many_rows_say_how_far_they_are(trained, capsys, monkeypatch):
    monkeypatch.setattr("gelforge.progress.FIRST_S", -1.0)  # as if they took long
    monkeypatch.setattr("gelforge.learning.training.adaptation.BLOCK", 8)
    show()
    model, presses = trained
    adapt(model, some_of(presses, 5))
    monkeypatch.setattr("gelforge.progress._shown_by", 0)
    assert "blocks of 8 rows predicted: " in capsys.readouterr().err


def test_an_adapted_model_is_a_model_unless_readings_have_another_sign(trained, tmp_path):
    # An adapted model is a model
    model, presses = trained
    changed, _ = adapt(model, with_readings(model, presses, 1.3))
    save_model(tmp_path / "model.pt", changed)
    again = load_model(tmp_path / "model.pt")
    np.testing.assert_array_equal(again.predict(presses.feature), changed.predict(presses.feature))
    assert again.settings["adapted"]["gain"] == pytest.approx([1.3] * 3, rel=1e-4)

    # Readings of another sign or too few presses are refused
    with pytest.raises(ModelError, match="other axes or signs"):
        adapt(model, with_readings(model, presses, -1.0))

    # More presses than there are are refused
    with pytest.raises(ModelError, match="asked for"):
        drawn_presses(trained[1].press, 10_000, 0)


def test_intervals_of_each_axis_hold_nine_in_ten_of_its_errors(trained):
    """One factor for all axes would let small horizontal errors hide large vertical ones."""
    model, presses = trained
    one_class = np.empty(0), np.full((1, 3), 0.02), np.zeros((1, 3))
    model = replace(model, intervals=Intervals(*one_class, *one_class))
    size = np.array([[0.02, 0.02, 0.5]])
    noisy = model.predict(presses.feature).sum(axis=1)
    noisy = noisy + size * np.random.default_rng(1).standard_normal(noisy.shape)
    changed, _ = adapt(model, Presses(presses.feature, noisy, presses.press))
    force = changed.predict(presses.feature)
    held = (np.abs(force.sum(axis=1) - noisy) <= changed.intervals.of_totals(force)).mean(axis=0)
    assert held == pytest.approx([0.9] * 3, abs=0.05)


def test_images_of_another_kind_or_scale_are_refused(trained):
    model, _ = trained
    with pytest.raises(ModelError, match="features.regions: 4"):
        check_same_images(model, 6, {})
    view = {"image_px": [400, 400], "crop_px": None, "camera": None}
    model = replace(model, settings=model.settings | {"views": {"one": view}})
    check_same_images(model, 4, {"other": view})
    with pytest.raises(ModelError, match="640 x 480 px, but the model learnt from 400 x 400"):
        check_same_images(model, 4, {"other": view | {"image_px": [640, 480]}})
    with pytest.raises(
        ModelError, match="400 x 400 px, reduced by features.image_scale 0.8, but .* from 400 x 400 px;"
    ):
        check_same_images(model, 4, {"other": view | {"image_scale": 0.8}})

    # Features of images of another scale than the studys are not learnt from
    check_scale(1.0, {"one": {"image_px": [400, 400]}, "old": {}})
    check_scale(0.8, {"one": {"image_px": [400, 400], "image_scale": 0.8}})
    with pytest.raises(
        ModelError,
        match="one: .* reduced by 0.8, but features.image_scale is 1; .* features.image_scale: 0.8",
    ):
        check_scale(1.0, {"one": {"image_px": [400, 400], "image_scale": 0.8}})
