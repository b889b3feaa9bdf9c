"""A small study with its cells and features."""

from types import SimpleNamespace

import pytest
from small_dataset import small_study, write_all_features, write_cells

from gelforge.dataset.join import join_shard
from gelforge.indentation.planning.plan import plan_cells


@pytest.fixture
def made(tmp_path):
    """Return the study with the files that a join reads, and a function that joins some of its cells."""
    study = small_study(tmp_path)
    made = SimpleNamespace(
        study=study,
        folder=tmp_path,
        names=list(plan_cells(study)),
        cells=write_cells(study, tmp_path),
        features=write_all_features(study, tmp_path),
    )
    made.digests = {name: f"digest of {name}" for name in made.names}
    made.feature_digests = {name: f"digest of {name}" for name in study.sessions}

    def join(out="shard-00000.h5", names=None):
        path = tmp_path / "dataset" / out
        chunk = names or made.names
        join_shard(made.study, chunk, made.cells, made.features, path, made.digests, made.feature_digests)
        return path

    made.join = join
    return made
