"""A small dataset with images, and what every format must give back of it."""

from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from small_dataset import sample_table, small_study, write_all_features, write_cells

from gelforge.dataset.exports import format_of
from gelforge.dataset.exports.export import Options, export_dataset
from gelforge.dataset.exports.source import SPLITS, open_source
from gelforge.dataset.join import join_shard
from gelforge.dataset.manifest import describe_dataset
from gelforge.indentation.planning.plan import plan_cells


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    """Return the study, its dataset's folder and a source with images: 72 rows in two shards."""
    root = tmp_path_factory.mktemp("exports")
    study = small_study(root)
    cells, features = write_cells(study, root), write_all_features(study, root)
    rng = np.random.default_rng(0)
    for session in study.sessions:
        folder = study.session_folder(session) / "images"
        folder.mkdir(parents=True)
        for name in sample_table(study, session)["image"]:
            Image.fromarray(rng.integers(0, 255, (12, 16), dtype=np.uint8)).save(folder / name)
    names, out = list(plan_cells(study)), root / "dataset"
    shards = [out / "shard-00000.h5", out / "shard-00001.h5"]
    join_shard(study, names[:5], cells, features, shards[0])
    join_shard(study, names[5:], cells, features, shards[1])
    describe_dataset(study, shards, features, out)
    return SimpleNamespace(
        study=study, folder=out, shards=shards, source=open_source(out, images=True), root=root
    )


@pytest.fixture(scope="session")
def exported(made_once, tmp_path_factory):
    """Return a function that exports the dataset once in a format and returns its folder."""
    folders = {}

    def export(name):
        if name not in folders:
            folders[name] = tmp_path_factory.mktemp("out") / name
            export_dataset(format_of(name), made_once.source, folders[name], Options())
        return folders[name]

    return export


@pytest.fixture(scope="session")
def expected(made_once):
    """Return the columns of each split, in the order in which formats write them."""
    source = made_once.source
    return {split: source.read(source.of_split(split)) for split in SPLITS}
