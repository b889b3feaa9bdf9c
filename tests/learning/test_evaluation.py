"""Predictions and tables: every number against a naive loop, and only from the saved predictions."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
from artificial_shards import small_rows, study_of, write_shards

from gelforge.dataset.ranges import force_ranges_table, label_ranges
from gelforge.dataset.schema import DatasetError
from gelforge.dataset.shard import ShardDataset
from gelforge.indentation.sensor.symmetry import D4, transform_points
from gelforge.learning.basis.data import training_and_validation
from gelforge.learning.elasticity.inverse import Inverse
from gelforge.learning.judging.baselines import fit_inverse
from gelforge.learning.judging.evaluation import (
    baselines_table,
    errors_by_table,
    reliability_table,
    rmse_table,
)
from gelforge.learning.judging.predictions import LearningSets, Predictions, predict_test_rows
from gelforge.learning.models.model_file import load_model, save_model
from gelforge.learning.models.reliability import Intervals, centre_of_pressure
from gelforge.learning.training.train import Run, train

SMALL = {
    "network": "paper",
    "hidden": [24, 16, 12],
    "batch_size": 8,
    "steps": 120,
    "learning_rate": 1e-3,
    "validation_fraction": 0.2,
}


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory):
    """Return shards and predictions of a small model."""
    folder, study = tmp_path_factory.mktemp("evaluated"), study_of(regions=4, bins=5, **SMALL)
    shards = write_shards(folder / "dataset", small_rows(), study)
    train(study, shards, folder / "model.pt", folder / "loss.csv", Run(threads=1))
    predict_test_rows(
        folder / "model.pt", LearningSets.of(shards), study, folder / "predictions.h5", threads=1
    )
    return shards, folder / "predictions.h5"


def maps(path):
    with h5py.File(path) as file:
        return file["predicted_N"][()].astype(float), file["true_N"][()].astype(float)


def naive_rmse(predicted, true, axis, only_contact):
    total, count = 0.0, 0
    for row in range(len(true)):
        for bin_ in range(true.shape[1]):
            if only_contact and true[row, bin_, axis] == 0:
                continue
            total += (predicted[row, bin_, axis] - true[row, bin_, axis]) ** 2
            count += 1
    return (total / count) ** 0.5


@pytest.mark.parametrize(("error", "only_contact"), [("RMSE", False), ("RMSES", True)])
def test_rmse_and_rmses_equal_a_double_loop(evaluated, error, only_contact):
    predicted, true = maps(evaluated[1])
    row = rmse_table(Predictions(evaluated[1])).set_index("error").loc[error]
    for axis, name in enumerate(("x_N", "y_N", "z_N")):
        assert row[name] == pytest.approx(naive_rmse(predicted, true, axis, only_contact), rel=1e-12)
    assert 0 < (true != 0).mean() < 1  # so that the two errors differ


def test_the_error_on_training_rows_is_of_rows_that_trained_alone(evaluated):
    """Here each indentation has one image, so that all training rows are asked, and none of those that monitor or test."""
    shards, path = evaluated
    rows, model = ShardDataset(shards, "train"), load_model(path.with_name("model.pt"))
    training, _ = training_and_validation(rows, shards, study_of(regions=4, bins=5, **SMALL))
    block = rows.read(training, ["feature", "force_distribution_N"])
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["training/true_N"], block["force_distribution_N"])
    predicted, true = model.predict(block["feature"]), block["force_distribution_N"].astype(float)
    row = rmse_table(Predictions(path)).set_index("error").loc["RMSES_TRAINING"]
    for axis, name in enumerate(("x_N", "y_N", "z_N")):
        # predictions are kept in single precision, and made in other blocks
        assert row[name] == pytest.approx(naive_rmse(predicted, true, axis, True), rel=1e-5)


def test_errors_of_the_total_force_stand_next_to_baselines(evaluated):
    # Errors of the total force
    predicted, true = maps(evaluated[1])
    table = rmse_table(Predictions(evaluated[1])).set_index("error")
    with h5py.File(evaluated[1]) as file:
        measured = file["total_force_ft_N"][()]
    for axis, name in enumerate(("x_N", "y_N", "z_N")):
        fem = [sum(predicted[i, :, axis]) - sum(true[i, :, axis]) for i in range(len(true))]
        ft = [sum(predicted[i, :, axis]) - measured[i, axis] for i in range(len(true))]
        assert table.loc["RMSET_FEM", name] == pytest.approx(np.sqrt(np.mean(np.square(fem))), rel=1e-9)
        assert table.loc["RMSET_FT", name] == pytest.approx(np.sqrt(np.mean(np.square(ft))), rel=1e-9)

    # Baselines stand next to the network
    predictions = Predictions(evaluated[1])
    table = baselines_table(predictions).set_index("predictor")
    mean = np.broadcast_to(predictions.training_mean, true.shape)
    contact = true != 0
    for name, judged in (("network", predicted), ("training mean", mean), ("zero", np.zeros_like(true))):
        assert table.loc[name, "RMSES_N"] == pytest.approx(
            np.sqrt(np.mean((judged - true)[contact] ** 2)), rel=1e-9
        )
        assert table.loc[name, "RMSES_z_N"] == pytest.approx(naive_rmse(judged, true, 2, True), rel=1e-9)
        error = (judged - true)[..., 2].sum(axis=1)
        assert table.loc[name, "total_Fz_rms_N"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
    assert table.loc["zero", "centre_of_pressure_median_mm"] == np.inf

    # Scikit learns baselines stand next to
    predictions, true = Predictions(evaluated[1]), maps(evaluated[1])[1]
    assert predictions.baselines == ["kernel ridge", "nearest neighbours", "ridge"]
    for name in predictions.baselines:
        with h5py.File(evaluated[1]) as file:
            said = file[f"baselines/{name}"][()].astype(float)
        assert table.loc[name, "RMSES_z_N"] == pytest.approx(naive_rmse(said, true, 2, True), rel=1e-9)
        assert table.loc[name, "RMSES_z_N"] < table.loc["zero", "RMSES_z_N"]


def test_predictions_hold_all_test_rows_and_errors_by_class_share_them_out(evaluated):
    # Predictions hold all test rows and the mean of training
    shards, path = evaluated
    rows = ShardDataset(shards, "test")
    expected = rows.read(np.arange(len(rows)), ["cell", "press", "untouched", "force_distribution_N"])
    with h5py.File(path) as file:
        assert list(file["cell"].asstr()) == list(expected["cell"])
        assert list(file["press"].asstr()) == list(expected["press"])
        np.testing.assert_array_equal(file["untouched"], expected["untouched"])
        np.testing.assert_array_equal(file["true_N"], expected["force_distribution_N"])
        assert file.attrs["synthetic"]

    # Training mean is that of touched training rows
    rows = ShardDataset(evaluated[0], "train")
    block = rows.read(np.arange(len(rows)), ["force_distribution_N", "untouched"])
    mean = block["force_distribution_N"][~block["untouched"]].astype(float).mean(axis=0)
    np.testing.assert_allclose(Predictions(evaluated[1]).training_mean, mean, rtol=1e-12, atol=1e-15)

    # Errors by class share out the rows
    predictions, (predicted, true) = Predictions(evaluated[1]), maps(evaluated[1])
    table = errors_by_table(predictions)
    touched = int((~predictions.untouched).sum())
    for by in ("depth", "place", "nearest training site", "session"):
        assert table.loc[table["by"] == by, "rows"].sum() == touched
    assert table.loc[table["by"] == "contact", "rows"].sum() == len(true) - touched
    first = table[table["by"] == "depth"].iloc[0]
    chosen = ~predictions.untouched & np.isclose(
        predictions.depth_mm, float(first["class"].split()[0]), atol=1e-3
    )
    expected = naive_rmse(predicted[chosen], true[chosen], 0, True)
    assert first["RMSES_x_N"] == pytest.approx(expected, rel=1e-9)


def test_inverse_elasticity_stands_beside_with_its_gain():
    """Forces of an operator's own flow need the gain that its penalties take; no other number is fitted."""
    rng = np.random.default_rng(1)
    inverse = Inverse.of(rng.normal(size=(2, 64, 25, 3)), 0.45)
    force = np.zeros((40, 25, 3))
    force[np.arange(40), rng.integers(0, 25, 40)] = [0.0, 0.1, -0.5]
    force[::4] = 0
    flow = np.einsum("fk,k,bk,nb->nf", inverse.left, inverse.singular, inverse.right, force.reshape(40, -1))
    u, v = flow.reshape(40, 2, -1).transpose(1, 0, 2)
    feature = np.concatenate([np.hypot(u, v), np.arctan2(v, u)], axis=1).astype("f4")

    class Rows:
        def read(self, index, names):
            block = {
                "feature": feature,
                "force_distribution_N": 2 * force,
                "untouched": ~force.any(axis=(1, 2)),
            }
            return {name: block[name][index] for name in names}

    found = fit_inverse(Rows(), np.arange(40), inverse, (5, 5, np.array([5.0, 5.0])), 1)
    total = found.predict(feature)[..., 2].sum(axis=1)
    np.testing.assert_allclose(total, 2 * force[..., 2].sum(axis=1), atol=0.02)
    assert 2 < found.gain < 2.5
    assert not total[::4].any()
    assert fit_inverse(Rows(), np.empty(0, int), inverse, (5, 5, np.array([5.0, 5.0])), 1).gain == 1


def test_the_distance_to_training_is_that_of_the_nearest_mirror_image(evaluated):
    rows = ShardDataset(evaluated[0], "train")
    trained = np.unique(rows.read(np.arange(len(rows)), ["position_mm"])["position_mm"], axis=0)
    images = np.concatenate([transform_points(name, trained, 32.0) for name in D4])
    predictions = Predictions(evaluated[1])
    for place, away in zip(predictions.position_mm, predictions.nearest_training_mm):
        assert away == pytest.approx(np.linalg.norm(images - place, axis=1).min())


def test_reliability_and_coverage_of_intervals(evaluated, tmp_path):
    predicted, true = maps(evaluated[1])
    predictions = Predictions(evaluated[1])
    table = reliability_table(predictions).set_index("quantity")["value"]
    untouched = predictions.untouched
    rms = np.sqrt(np.mean(predicted[untouched].sum(axis=1)[:, 2] ** 2))
    assert table["Fz of untouched images, rms"] == pytest.approx(rms, rel=1e-9)
    for name, row in table.items():
        if "share inside" in name:
            assert 0 < row <= 1
    if predictions.has_intervals:
        with h5py.File(evaluated[1]) as file:
            half, total_half = file["bin_half_N"][()].astype(float), file["total_half_N"][()]
        carries = (true != 0).any(axis=-1)
        inside = (np.abs(predicted - true) <= half)[carries][:, 2].mean()
        assert table["bins, z: share inside the 90 % interval"] == pytest.approx(inside, rel=1e-9)
        error = np.abs((predicted - true).sum(axis=1))[~untouched, 1]
        inside = (error <= total_half[~untouched, 1]).mean()
        assert table["totals, y: share inside the 90 % interval"] == pytest.approx(inside, rel=1e-9)
    else:
        assert not [name for name in table.index if "interval" in name]

    # The small model has too few validation rows for intervals of its own: it is given some.
    shards, _ = evaluated
    half = np.empty(0), np.full((1, 3), 0.05), np.full((1, 3), 0.2)
    model = replace(load_model(shards[0].parents[1] / "model.pt"), intervals=Intervals(*half, *half))
    save_model(tmp_path / "model.pt", model)
    out, study = tmp_path / "predictions.h5", study_of(regions=4, bins=5, **SMALL)
    predict_test_rows(tmp_path / "model.pt", LearningSets.of(shards), study, out, threads=1)
    predictions, (predicted, true) = Predictions(out), maps(out)
    table = reliability_table(predictions).set_index("quantity")["value"]
    touched, carries = ~predictions.untouched, (true != 0).any(axis=-1)
    inside = (np.abs(predicted - true)[carries][:, 2] <= 0.05).mean()
    assert table["bins, z: share inside the 90 % interval"] == pytest.approx(inside, abs=1e-9)
    off = np.abs(predicted.sum(axis=1) - true.sum(axis=1))[touched, 1]
    assert table["totals, y: share inside the 90 % interval"] == pytest.approx((off <= 0.05).mean(), abs=1e-9)
    off = np.abs(predicted.sum(axis=1) - predictions.ft)[touched, 0]
    wider = np.hypot(0.05, 1.645 * 0.2)
    assert table["measured totals, x: share inside the 90 % interval"] == pytest.approx(
        (off <= wider).mean(), abs=1e-9
    )
    assert 0 < inside < 1
    assert (off <= 0.05).sum() < (off <= wider).sum()  # else the two kinds of interval could be exchanged


def test_few_and_many_training_rows_can_be_evaluated(tmp_path, monkeypatch):
    # A training without validation rows can be evaluated. Two orbits: one tests, one trains, none is left to
    # monitor the loss or to choose a baseline by
    study = study_of(regions=4, bins=5, **SMALL | {"steps": 8})
    shards = write_shards(tmp_path / "dataset", small_rows(cells=2), study)
    train(study, shards, tmp_path / "model.pt", tmp_path / "loss.csv", Run(threads=1))
    out = tmp_path / "predictions.h5"
    predict_test_rows(tmp_path / "model.pt", LearningSets.of(shards), study, out, threads=1)
    assert np.isfinite(baselines_table(Predictions(out))["RMSES_N"]).all()

    # Of many training rows some are asked one image each
    many = tmp_path / "many"
    many.mkdir()
    monkeypatch.setattr("gelforge.learning.judging.predictions.TRAINING_ROWS", 20)
    study, rows = study_of(regions=4, bins=5, **SMALL | {"steps": 4}), small_rows()
    twice = {name: np.repeat(values, 2, axis=0) for name, values in rows.items()}
    shards = write_shards(many / "dataset", twice, study)
    train(study, shards, many / "model.pt", many / "loss.csv", Run(threads=1))
    sets = LearningSets.of(shards)
    predict_test_rows(many / "model.pt", sets, study, many / "predictions.h5", threads=1)
    with h5py.File(many / "predictions.h5") as file:
        true = file["training/true_N"][()]
    touched = true[true.any(axis=(1, 2))]
    assert len(true) == 20 and len(np.unique(touched, axis=0)) == len(touched) > 1


def test_force_ranges_and_centres_of_pressure_are_those_of_the_rows(evaluated):
    # Force ranges
    rows = ShardDataset(evaluated[0])
    label = rows.read(np.arange(len(rows)), ["force_distribution_N"])["force_distribution_N"].astype(float)
    for ranges in (label_ranges(evaluated[0]), Predictions(evaluated[1]).label_range):
        table = force_ranges_table(ranges).set_index("quantity")
        assert table.loc["force per bin", "x_max_N"] == label[..., 0].max()
        assert table.loc["force per bin", "z_min_N"] == label[..., 2].min()
        assert table.loc["total force", "z_min_N"] == pytest.approx(
            min(sum(row[:, 2]) for row in label), rel=1e-12
        )
        assert table.loc["total force", "z_max_N"] == 0.0

    # Centre of pressure of one bin and of two
    force = np.zeros((3, 6, 3))
    force[0, 4, 2] = -1.0  # ix 1, iy 1 of 3 x 2 bins
    force[1, [0, 2], 2] = -1.0, -3.0
    centres = centre_of_pressure(force, 3, 2, np.array([6.0, 6.0]))
    np.testing.assert_allclose(centres[:2], [[3.0, 4.5], [4.0, 1.5]], rtol=1e-12)
    assert np.isnan(centres[2]).all()


def test_damaged_predictions_are_named(evaluated, tmp_path):
    with pytest.raises(DatasetError, match=r"none\.h5: no such file"):
        Predictions(tmp_path / "none.h5")
    half = tmp_path / "half.h5"
    half.write_bytes(evaluated[1].read_bytes()[:2000])
    with pytest.raises(DatasetError, match=r"half\.h5: (holds no checksum|damaged or edited)"):
        Predictions(half)
