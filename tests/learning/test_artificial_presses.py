"""A small network learns held-out positions of artificial presses: the whole of training and evaluation at once."""

import numpy as np
from artificial_presses import presses
from artificial_shards import study_of, write_shards

from gelforge.learning.evaluation import Predictions, baselines_table, predict_test_rows
from gelforge.learning.training import Run, train


def test_held_out_positions_are_predicted_better_than_by_the_mean(tmp_path):
    """The limits are loose: the network and the steps are small. Seen: Fz 0.12, RMSES 0.76 of the mean's, 3 mm."""
    study = study_of(hidden=[120, 100, 80], learning_rate=1e-3, epochs=50, batch_size=50)
    shards = write_shards(tmp_path, presses(13, 22 / 12, images=1, depths=np.array([1.0, 1.5, 2.0])), study)
    train(study, shards, tmp_path / "model.pt", tmp_path / "loss.csv", Run(threads=1, progress=False))
    predict_test_rows(tmp_path / "model.pt", shards, tmp_path / "predictions.h5", threads=1)
    table = baselines_table(Predictions(tmp_path / "predictions.h5")).set_index("predictor")
    network, mean = table.loc["network"], table.loc["training mean"]
    assert network["total_Fz_rms_over_range"] < 0.2 < mean["total_Fz_rms_over_range"]
    assert network["RMSES_N"] < 0.85 * mean["RMSES_N"]
    assert network["centre_of_pressure_median_mm"] < 4.5 < mean["centre_of_pressure_median_mm"]
