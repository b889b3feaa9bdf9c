"""A small network learns held-out positions of artificial presses: the whole of training and evaluation at once."""

import numpy as np
import pytest
from artificial_presses import presses
from artificial_shards import study_of, write_shards

from gelforge.learning.judging.evaluation import baselines_table
from gelforge.learning.judging.predictions import LearningSets, Predictions, predict_test_rows
from gelforge.learning.training.train import Run, train

PAPER = {"network": "paper", "hidden": [120, 100, 80], "learning_rate": 1e-3, "steps": 400, "batch_size": 50}
UNET = {"network": "unet", "channels": 8, "steps": 300}


@pytest.mark.thorough
@pytest.mark.parametrize(("settings", "limits"), [(PAPER, (0.2, 0.85, 4.5)), (UNET, (0.1, 0.4, 1.0))])
def test_held_out_positions_are_predicted_better_than_by_the_mean(tmp_path, settings, limits):
    """The limits are loose: networks and steps are few. Seen: Fz 0.12, RMSES 0.76 of the mean's, 3 mm; unet: Fz 0.07."""
    study = study_of(**settings)
    shards = write_shards(tmp_path, presses(13, 22 / 12, images=1, depths=np.array([1.0, 1.5, 2.0])), study)
    train(study, shards, tmp_path / "model.pt", tmp_path / "loss.csv", Run(threads=1))
    predict_test_rows(
        tmp_path / "model.pt", LearningSets.of(shards), study, tmp_path / "predictions.h5", threads=1
    )
    predictions = Predictions(tmp_path / "predictions.h5")
    table = baselines_table(predictions).set_index("predictor")
    network, mean = table.loc["network"], table.loc["training mean"]
    limit_N = limits[0] * np.ptp(predictions.label_range[1, :, 2])
    assert network["total_Fz_rms_N"] < limit_N < mean["total_Fz_rms_N"]
    assert network["RMSES_N"] < limits[1] * mean["RMSES_N"]
    assert network["centre_of_pressure_median_mm"] < limits[2] < mean["centre_of_pressure_median_mm"]
