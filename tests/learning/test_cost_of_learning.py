"""What `gelforge check` and the jobs of a cluster reckon for images and training: rows and bytes from one source."""

from pathlib import Path

import h5py
import pytest
from artificial_shards import small_rows, study_of, write_shards

from gelforge.cli.study.cost import Costs, row_bytes, time_line
from gelforge.config import load_study
from gelforge.indentation.planning.plan import plan_cells
from gelforge.progress import duration

ROOT = Path(__file__).parents[2]


def test_a_row_has_the_bytes_of_a_shard_and_jobs_of_a_cluster_ask_for_them(tmp_path):
    # A row has the bytes that a shard holds
    study = study_of(regions=4, bins=5)
    (path, *_) = write_shards(tmp_path, small_rows(), study)
    with h5py.File(path) as shard:
        numbers = [data for data in shard.values() if not h5py.check_string_dtype(data.dtype)]
        rows = len(numbers[0])
        assert sum(data.size * data.dtype.itemsize for data in numbers) == rows * row_bytes(study)

    # Jobs of a cluster ask by the same numbers
    rules = (ROOT / "workflow/rules/cluster.smk").read_text()
    for asked in ("features(", "drawing(", "training(", "evaluation(", "mismatch("):
        assert f"costs().{asked}" in rules


def test_the_estimate_of_a_study_has_images_and_training_in_it():
    study = load_study(ROOT / "config/test.yaml")
    cells = plan_cells(study)
    costs = Costs(study, cells)
    presses = sum(len(cell.depths_mm) for cell in cells.values())
    images = [costs.images(session) for session in study.sessions]
    assert sum(count for count, _ in images) == presses  # one image per press, each position in one session
    assert {size for _, size in images} == {0.0576}
    size_mb = costs.learning_mb()
    assert size_mb == pytest.approx(presses * row_bytes(study) / 1e6)
    line = time_line(costs, 240.0)
    assert line.startswith("time       about ")
    assert "finite elements 2 min, images " in line and "training and prediction " in line
    parts = 120 + sum(map(costs.features, study.sessions)) / 2 + sum(map(costs.drawing, study.sessions)) / 2
    parts += costs.training() + costs.evaluation(size_mb)
    assert f"about {duration(parts)} on two cores" in line

    # Labels alone cost finite elements alone
    study = load_study(ROOT / "config/test.yaml").model_copy(update={"sessions": [], "virtual_lab": None})
    assert time_line(Costs(study, plan_cells(study)), 60.0) == (
        "time       about 30 s on two cores (estimate): finite elements 30 s"
    )
