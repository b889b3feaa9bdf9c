"""A model on a sensor with another gain: a few presses with measured forces mend it, and no more than they can tell."""

import numpy as np
import pytest
from artificial_shards import small_rows, study_of, write_shards

from gelforge.dataset.shard import ShardDataset
from gelforge.learning.adaptation import adapt, drawn_presses, errors_table, measured_presses
from gelforge.learning.model_file import load_model, save_model
from gelforge.learning.scaling import ModelError
from gelforge.learning.training import Run, train

SMALL = {"network": "paper", "hidden": [24, 16, 12], "batch_size": 8, "epochs": 30, "learning_rate": 1e-3}


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Return a model, and the presses that it was not tested on."""
    folder, study = (
        tmp_path_factory.mktemp("adapted"),
        study_of(regions=4, bins=5, validation_fraction=0.2, **SMALL),
    )
    shards = write_shards(folder / "dataset", small_rows(), study)
    train(study, shards, folder / "model.pt", folder / "loss.csv", Run(threads=1, progress=False))
    return load_model(folder / "model.pt"), measured_presses(ShardDataset(shards, "train"))


def with_readings(model, presses, gain, noise=0.0):
    """Return presses whose readings are the model's own totals times a gain, with noise in shares of their spread."""
    total = model.predict(presses.feature).sum(axis=1) * gain
    noisy = total + noise * total.std() * np.random.default_rng(0).standard_normal(total.shape)
    return type(presses)(presses.feature, noisy, presses.press)


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
    changed, found = adapt(model, drawn_presses(read, 15, 0))
    assert found.form == form
    np.testing.assert_allclose(found.gain, gain, rtol=0.02)
    was, now = (one.predict(presses.feature).sum(axis=1)[:, 2] for one in (model, changed))
    np.testing.assert_allclose(now, gain[2] * was, rtol=0.02, atol=1e-6)
    table = errors_table({"before": model, "after": changed}, read).set_index("model")
    assert table.loc["after", "total_z_rms_N"] <= table.loc["before", "total_z_rms_N"] + 1e-9


def test_an_adapted_model_is_a_model(trained, tmp_path):
    model, presses = trained
    changed, _ = adapt(model, with_readings(model, presses, 1.3))
    save_model(tmp_path / "model.pt", changed)
    again = load_model(tmp_path / "model.pt")
    np.testing.assert_array_equal(again.predict(presses.feature), changed.predict(presses.feature))
    assert again.settings["adapted"]["gain"] == pytest.approx([1.3] * 3, rel=1e-4)


def test_readings_of_another_sign_are_refused(trained):
    model, presses = trained
    with pytest.raises(ModelError, match="other axes or signs"):
        adapt(model, with_readings(model, presses, -1.0))


def test_more_presses_than_there_are_are_refused(trained):
    with pytest.raises(ModelError, match="asked for"):
        drawn_presses(trained[1], 10_000, 0)
