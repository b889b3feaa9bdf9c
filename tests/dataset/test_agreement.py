"""Simulated next to measured force: per press, with a naive twin."""

import numpy as np
import pandas as pd
import pytest
from small_dataset import label, sample_table, small_study, write_cells, write_readings

from gelforge.dataset.agreement import agreement_table, read_agreement, rmse_gt_table, write_agreement
from gelforge.dataset.schema import DatasetError
from gelforge.files import write_product_table
from gelforge.indentation.cells.cell_file import CellError
from gelforge.indentation.planning.plan import plan_cells


@pytest.fixture
def recorded(made):
    made.readings = {
        session: write_readings(
            made.folder / "recordings" / f"{session}.csv", made.study, session, noise_N=0.02
        )
        for session in made.study.sessions
    }
    return made


def test_one_row_per_press_with_means_of_its_readings_at_depth(recorded, tmp_path):
    table = agreement_table(recorded.readings, recorded.cells)
    assert len(table) == sum(
        sample_table(recorded.study, s)["press"].nunique() for s in recorded.study.sessions
    )
    planned = plan_cells(recorded.study)
    for row in table.itertuples():
        true = label(planned[row.cell], row.depth_mm).sum(axis=0)
        np.testing.assert_allclose([row.fem_x_N, row.fem_y_N, row.fem_z_N], true, rtol=1e-12, atol=1e-15)
    readings = pd.read_csv(recorded.readings["day2"])
    for row in table[table["session"] == "day2"].itertuples():
        held = readings[(readings["press"] == row.press) & (readings["phase"] == "dwell")]
        assert row.ft_z_N == pytest.approx(sum(held["fz_N"]) / len(held), rel=1e-12)

    # The file comes back
    write_agreement(tmp_path / "agreement.csv", table)
    # nine digits are written
    pd.testing.assert_frame_equal(
        read_agreement(tmp_path / "agreement.csv"), table, rtol=1e-8, check_dtype=False
    )


def test_rmse_gt_equals_a_naive_loop_and_needs_no_images_or_failed_cells(recorded):
    # Rmse gt equals a naive loop
    table = agreement_table(recorded.readings, recorded.cells)
    rmse = rmse_gt_table(table, {"day1": [0.03, 0.03, 0.06], "day2": [0.01, 0.01, 0.1]})
    for session in ("all", "day1", "day2"):
        for axis in "xyz":
            squares = [
                (getattr(row, f"ft_{axis}_N") - getattr(row, f"fem_{axis}_N")) ** 2
                for row in table.itertuples()
                if session in ("all", row.session)
            ]
            found = rmse[(rmse["session"] == session) & (rmse["axis"] == axis)].iloc[0]
            assert found["RMSE_GT_N"] == pytest.approx((sum(squares) / len(squares)) ** 0.5, rel=1e-12)
            assert found["presses"] == len(squares)
    assert list(rmse[rmse["session"] == "all"]["ft_resolution_N"]) == [0.03, 0.03, 0.1]  # the coarsest

    # Images are not needed and failed cells left out
    path = recorded.readings["day1"]
    write_product_table(path, pd.read_csv(path).assign(image=""))
    assert len(agreement_table({"day1": path}, recorded.cells)) > 0

    # Failed cells are left out
    write_cells(recorded.study, recorded.folder, failed=["x1_y1"])
    assert "x1_y1" not in set(agreement_table(recorded.readings, recorded.cells)["cell"])


def test_no_session_gives_an_empty_table(tmp_path):
    study = small_study(tmp_path, sessions=())
    table = agreement_table({}, write_cells(study, tmp_path))
    assert len(table) == 0
    assert list(table.columns[:3]) == ["session", "press", "cell"]


def test_a_press_without_its_cell_or_file_stops(recorded):
    cells = {name: path for name, path in recorded.cells.items() if name != "x1_y1"}
    with pytest.raises(DatasetError, match="'x1_y1', which is not in the plan"):
        agreement_table(recorded.readings, cells)
    recorded.cells["x1_y1"].unlink()
    with pytest.raises(CellError, match=r"x1_y1\.h5"):
        agreement_table(recorded.readings, recorded.cells)
    recorded.readings["day1"].unlink()
    with pytest.raises(DatasetError, match=r"day1\.csv: no such file"):
        agreement_table(recorded.readings, recorded.cells)


def test_a_press_at_a_depth_that_was_not_simulated_stops(recorded):
    path = recorded.readings["day1"]
    readings = pd.read_csv(path, dtype={"press": str})
    readings.loc[readings["press"] == "p001", "depth_mm"] += 0.05
    write_product_table(path, readings)
    with pytest.raises(DatasetError, match="indentation p001 of session day1 has depth 1.05 mm"):
        agreement_table(recorded.readings, recorded.cells)
