"""The real readings that the repository holds are read as what they are."""

from pathlib import Path

import numpy as np

from gelforge.config import load_study
from gelforge.indentation.planning.plan import plan_cells
from gelforge.mismatch.fem.nominal import observations_of


def test_the_four_readings_of_feats_are_forces_along_z_at_a_planned_place():
    study = load_study(Path("config/gelsight_mini.yaml"))
    (planned,) = plan_cells(study).values()
    found, _ = observations_of([Path("data/gelsight_mini/feats")], study)
    loaded = found.table[found.table["phase"] == "load"]
    assert tuple(loaded["depth_mm"]) == planned.depths_mm
    assert (loaded[["x_mm", "y_mm"]].to_numpy() == [planned.x_mm, planned.y_mm]).all()
    assert not found.read[:, :2].any()  # sideways forces are not known
    np.testing.assert_allclose(found.force[loaded.index, 2], [-1.6503, -5.9641, -13.5257, -23.2532])
