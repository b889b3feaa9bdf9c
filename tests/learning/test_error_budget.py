"""The parts of the network's error: closed forms of each, and what cancels is not counted twice."""

import numpy as np
import pytest
from artificial_shards import small_rows, study_of, write_shards
from numpy.testing import assert_allclose
from test_evaluation import SMALL

from gelforge.dataset.shard import ShardDataset
from gelforge.learning.judging.error_budget import budget_of, error_budget_table, shared_out
from gelforge.learning.judging.evaluation import rmse_table
from gelforge.learning.judging.predictions import LearningSets, Predictions, predict_test_rows
from gelforge.learning.judging.true_motion import FlowMap, Truth, components, features
from gelforge.learning.training.train import Run, train
from gelforge.virtual_lab.true_presses import TruePress

# three patterns over four rows, orthogonal to each other
ONE, TWO, THREE = np.array([[1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1.0]])
SIZES = {"optics": 0.003, "learning": 0.004, "mechanics": 0.012}  # N


def errors(optics, learning, mechanics):
    """Return errors (4, 2, 3) of both bins alike, z three times x and y; a third bin is not pressed."""
    axes, pressed = np.array([1, 1, 3.0]), np.array([1, 1, 0.0])
    o, m = (
        size * a[:, None, None] * pressed[:, None] * axes for size, a in ((optics, ONE), (mechanics, THREE))
    )
    label = o + learning * TWO[:, None, None] * pressed[:, None] * axes
    return {
        "optics": o,
        "mechanics": m,
        "against the label": label,
        "against the truth": label + m,
        "contact point": 0.5 * m,
        "pressed": np.broadcast_to(pressed[:, None] > 0, o.shape),
        "flow": np.array([[1.0, 0.2]] * 4),
    }


def test_each_part_of_a_known_error_is_found_and_what_is_undone_is_nobodys():
    # Each part of a known error is found
    table = budget_of(errors(**SIZES), mm_per_px=0.08).set_index("part")
    for name, size in SIZES.items():
        assert_allclose(table.loc[name, ["bins_x_N", "bins_z_N"]].astype(float), [size, 3 * size], rtol=1e-12)
        assert_allclose(table.loc[name, "total_z_N"], 2 * 3 * size, rtol=1e-12)  # two bins
    assert_allclose(table.loc["against the label", "bins_y_N"], 0.005, rtol=1e-12)
    assert_allclose(table.loc["against the truth", "bins_y_N"], 0.013, rtol=1e-12)
    assert_allclose(table.loc["contact point", "bins_y_N"], 0.006, rtol=1e-12)
    assert_allclose(
        table.loc["optics", ["flow_px", "flow_off_px", "flow_off_mm"]].astype(float), [1, 0.2, 0.016]
    )
    assert table.loc["learning":, "flow_px"].isna().all()

    # What the network has learnt to undo is nobodys error. Flow off by the noise and by what is the same in
    # training: from true motion the network errs the other way
    noise, known = 0.003 * ONE, 0.02 * TWO
    optics, learning = shared_out(noise, noise + known)  # error = (noise + known) - known
    assert optics == pytest.approx(0.003, rel=1e-12)
    assert learning == pytest.approx(0.0, abs=1e-9)  # the root of a rounding

    # Without rows nothing is known
    assert np.isnan(shared_out(np.empty(0), np.empty(0))).all()


@pytest.mark.parametrize("name", SIZES)
def test_a_part_that_is_absent_is_none(name):
    table = budget_of(errors(**(SIZES | {name: 0.0})), mm_per_px=0.08).set_index("part")
    assert table.loc[name, "total_z_N"] == pytest.approx(0.0, abs=1e-9)  # the root of a rounding


@pytest.mark.parametrize(
    ("error", "optics", "expected"),
    [(ONE, -ONE, (0, 1)), (ONE, 2 * ONE, (1, 0)), (0 * ONE, ONE, (0, 0)), (5 * ONE, TWO, (0, 5))],
)
def test_the_parts_are_never_more_than_the_whole(error, optics, expected):
    assert shared_out(error, optics) == pytest.approx(expected)


# ------------------------------------------------------------------------------------- the flow of true motion
def smoothed(flow):
    """Return flow (N, 64, 2) as a tracker might show it: 0.6 of a region's and 0.1 of the four next to it."""
    grid = np.pad(flow.reshape(-1, 8, 8, 2), ((0, 0), (1, 1), (1, 1), (0, 0)), mode="edge")
    beside = grid[:, :-2, 1:-1] + grid[:, 2:, 1:-1] + grid[:, 1:-1, :-2] + grid[:, 1:-1, 2:]
    return (0.6 * grid[:, 1:-1, 1:-1] + 0.1 * beside).reshape(flow.shape)


def test_the_flow_map_finds_what_a_tracker_does_and_foretells_it():
    rng = np.random.default_rng(1)
    learnt, other = rng.normal(size=(300, 64, 2)), rng.normal(size=(20, 64, 2))
    found = FlowMap.fit(features(learnt), features(smoothed(learnt)))
    assert_allclose(
        components(found(features(other))), smoothed(other), atol=0.02
    )  # ridge: 0.1 % of unit variance
    off = np.abs(components(found(features(other))) - other).max()
    assert off > 0.5  # so that the identity would not pass

    # Regions that never move are left as they are
    still = np.zeros((30, 64, 2))
    found = FlowMap.fit(features(still), features(still))
    flow = np.random.default_rng(2).normal(size=(3, 64, 2))
    assert_allclose(components(found(features(flow))), flow, atol=1e-5)


# ------------------------------------------------------------------------------------- from shards to table
@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder, study = tmp_path_factory.mktemp("budget"), study_of(regions=4, bins=5, **SMALL)
    shards = write_shards(folder / "dataset", small_rows(), study)
    train(study, shards, folder / "model.pt", folder / "loss.csv", Run(threads=1))
    return folder, study, shards


def evaluated(model, truth):
    folder, study, shards = model
    predict_test_rows(folder / "model.pt", LearningSets.of(shards), study, folder / "p.h5", 1, truth)
    return Predictions(folder / "p.h5")


def truth_of(shards, force_factor=1.0):
    """Return a truth whose motion is the images', its forces a factor of the labels."""
    rows = ShardDataset(shards)
    block = rows.read(np.arange(len(rows)), ["session", "press", "feature", "force_distribution_N"])
    known = {
        (s, p): TruePress(f, force_factor * label, 0.01 * label) for s, p, f, label in zip(*block.values())
    }
    return Truth(lambda wanted: ((press[:2], known[press[:2]]) for press in wanted), mm_per_px=0.1)


def test_parts_of_a_model_s_error_follow_the_truth(model):
    predictions = evaluated(model, truth_of(model[2]))
    table, rmse = (
        error_budget_table(predictions).set_index("part"),
        rmse_table(predictions).set_index("error"),
    )
    assert table.loc["against the label", "bins_z_N"] == pytest.approx(rmse.loc["RMSES", "z_N"], rel=1e-6)
    # ridge about the identity: nothing is left but the rounding of float32
    assert table.loc["optics", "total_z_N"] < 1e-3 * table.loc["learning", "total_z_N"]
    assert table.loc["mechanics", "total_z_N"] == pytest.approx(0.0, abs=1e-9)
    assert table.loc["optics", "flow_off_px"] == pytest.approx(0.0, abs=1e-6)
    assert table.loc["learning", "bins_x_N"] == pytest.approx(
        table.loc["against the truth", "bins_x_N"], rel=1e-3
    )

    # Mechanics is the labels distance from the true force
    predictions = evaluated(model, truth_of(model[2], force_factor=1.12))
    table = error_budget_table(predictions).set_index("part")
    rows = ShardDataset(model[2], "test")
    block = rows.read(np.arange(len(rows)), ["force_distribution_N", "untouched"])
    label = block["force_distribution_N"][~block["untouched"]].astype(float)
    for axis, name in enumerate("xyz"):
        total = np.sqrt(np.mean((0.12 * label[..., axis].sum(axis=1)) ** 2))
        assert table.loc["mechanics", f"total_{name}_N"] == pytest.approx(total, rel=1e-5)
        assert table.loc["contact point", f"total_{name}_N"] == pytest.approx(total / 12, rel=1e-5)

    # Without a truth there is no table
    predictions = evaluated(model, None)
    assert not predictions.has_truth
    assert error_budget_table(predictions) is None
