"""Training rows: the same again, balanced, with labels that agree with totals and images that show the press."""

import numpy as np
import pytest
from small_synthesis import LAWS, study_of

from gelforge.dataset.shard import ShardDataset, shard_attributes
from gelforge.indentation.cells.cell_file import Cell, write_cell
from gelforge.indentation.sensor.unrolled import bin_points
from gelforge.synthesis.draws import solution, solution_count
from gelforge.synthesis.rows import solve, write_rows, write_solved
from gelforge.virtual_lab.particles import VirtualLabError

STUDY = study_of(
    sites=3,
    paths=2,
    rows=80,
    rows_per_shard=60,
    sheared=1.0,
    unloaded=0.0,
    depth_mm=[1.0, 1.4],
    shear_mm=[0.5, 0.8],
    shapes={"edge": 0, "pair": 0},
)


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """Return the files of the solved presses, and their cells."""
    folder = tmp_path_factory.mktemp("solved")
    paths, cells = [], []
    for k in range(solution_count(STUDY)):
        cells.append(solve(solution(STUDY, k), LAWS))
        paths.append(folder / f"{k:05d}.h5")
        write_cell(paths[-1], cells[-1])
    return paths, cells


@pytest.fixture(scope="module")
def shard(solved, tmp_path_factory):
    out = tmp_path_factory.mktemp("rows") / "0.h5"
    write_rows(STUDY, 0, solved[0], out)
    return out


def test_a_shard_holds_its_rows_of_every_class_and_repeats_its_bytes(shard, solved, tmp_path):
    # A shard holds its rows and repeats its bytes
    write_rows(STUDY, 1, solved[0], tmp_path / "1.h5")
    assert [len(ShardDataset([path])) for path in (shard, tmp_path / "1.h5")] == [60, 20]
    assert shard_attributes(shard)["synthetic"]

    # The same number gives the same bytes
    write_rows(STUDY, 0, solved[0], tmp_path / "0.h5")
    assert (tmp_path / "0.h5").read_bytes() == shard.read_bytes()

    # Rows are of every class
    rows = ShardDataset([shard])
    block = rows.read(
        np.arange(len(rows)), ["phase", "untouched", "depth_mm", "force_distribution_N", "feature"]
    )
    assert block["untouched"].sum() == 4  # one of each image series
    assert {"zero", "load", "shear"} == set(block["phase"])
    deep = block["depth_mm"][block["phase"] == "load"]
    assert deep.min() < 0.28 < deep.max()
    total = block["force_distribution_N"].sum(axis=1, dtype=float)
    assert (total[block["untouched"]] == 0).all()
    flow = block["feature"][:, :400].mean(axis=1)
    light = block["depth_mm"] < 0.3
    assert flow[block["untouched"]].max() < flow[~light & ~block["untouched"]].min()
    deeper = np.corrcoef(flow[~block["untouched"]], -total[~block["untouched"], 2])[0, 1]
    assert deeper > 0.7


def test_a_site_that_ended_early_is_named_and_rows_of_one_press_are_its_steps(solved, tmp_path):
    # A site that ended early is named
    early = tmp_path / "early"
    early.mkdir()
    paths, cells = list(solved[0]), solved[1]
    failed = Cell(cells[2].arrays, cells[2].attributes | {"status": "failed", "reason": "no equilibrium"})
    paths[2] = early / "failed.h5"
    write_cell(paths[2], failed)
    with pytest.raises(
        VirtualLabError, match=r"site00002 at .* no equilibrium; make synthesis.depth_mm smaller"
    ):
        write_rows(STUDY, 0, paths, early / "0.h5")

    # Rows of one solved press are its steps
    of_one_press = tmp_path / "of_one_press"
    of_one_press.mkdir()
    one, cell = solution(STUDY, solution_count(STUDY) - 1), solved[1][-1]
    write_solved(STUDY, one, cell, of_one_press / "0.h5", seed=3, series=2)
    rows = ShardDataset([of_one_press / "0.h5"])
    block = rows.read(np.arange(len(rows)), ["feature", "force_distribution_N", "phase", "total_force_fem_N"])
    steps = len(one.planned.depths_mm)
    assert list(block["phase"]) == 2 * ["zero", *one.planned.phases]
    np.testing.assert_allclose(
        block["total_force_fem_N"][1 : steps + 1], cell.arrays["total_force_N"], atol=1e-6
    )
    last, direction = block["total_force_fem_N"][steps], np.array(one.planned.shears_mm[-1])
    assert last[:2] @ direction / np.linalg.norm(direction) > 0.02  # the gel is dragged along
    half = steps + 1
    np.testing.assert_array_equal(block["force_distribution_N"][:half], block["force_distribution_N"][half:])
    assert not np.allclose(block["feature"][1:half], block["feature"][half + 1 :])  # other particles
    assert np.corrcoef(block["feature"][half - 1, :400], block["feature"][-1, :400])[0, 1] > 0.8


def test_a_twisted_path_has_labels_with_a_torque():
    study = study_of(
        paths=1,
        twisted=1.0,
        sheared=0.0,
        tilted=0.0,
        unloaded=0.0,
        twist_deg=[3.0, 4.0],
        classes={"straight": 0, "light": 0},
    )
    one = solution(study, 0)
    cell = solve(one, LAWS)
    r = bin_points(study.sensor)[:, :2] - [one.planned.x_mm, one.planned.y_mm]
    f = cell.arrays["bin_force_N"]
    torque = (r[:, 0] * f[..., 1] - r[:, 1] * f[..., 0]).sum(axis=1)
    assert torque[-1] * np.sign(one.planned.twists_deg[-1]) > 3 * np.abs(torque[:2]).max()


def test_images_are_reduced_as_asked_and_colours_give_the_features_of_their_grey(shard, solved, tmp_path):
    # Images are reduced as the features ask
    reduced = tmp_path / "reduced"
    reduced.mkdir()
    features = STUDY.features.model_copy(update={"image_scale": 0.7})
    small = STUDY.model_copy(update={"features": features})
    write_rows(small, 0, solved[0], reduced / "0.h5")
    assert shard_attributes(reduced / "0.h5")["sessions"]["simulated"]["view"]["image_scale"] == 0.7
    flow = [
        ShardDataset([path]).read(np.arange(60), ["feature"])["feature"][:, :400].mean(axis=1)
        for path in (reduced / "0.h5", shard)
    ]
    deep = flow[1] > 0.5 * flow[1].max()
    np.testing.assert_allclose(flow[0][deep], flow[1][deep], rtol=0.15)  # 0.7 would be 30 % off

    # A camera in colour gives the features of its grey
    coloured = tmp_path / "coloured"
    coloured.mkdir()
    colours = {"background_rgb": [60.0, 20.0, 10.0], "particle_rgb": [30.0, 220.0, 90.0], "noise_grey": 2.0}
    weights = np.array([0.299, 0.587, 0.114])
    same = {
        "background_grey": weights @ colours["background_rgb"],
        "particle_grey": weights @ colours["particle_rgb"],
        "noise_grey": 2.0 * np.linalg.norm(weights),
    }
    found, one = [], solution(STUDY, 0)
    for number, imaging in enumerate((colours, same, {})):
        write_solved(study_of(imaging=imaging), one, solved[1][0], coloured / f"{number}.h5", seed=1)
        rows = ShardDataset([coloured / f"{number}.h5"])
        found.append(rows.read(np.arange(len(rows)), ["feature"])["feature"])
    np.testing.assert_array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])
