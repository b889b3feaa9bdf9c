"""Sessions whose indenter moves sideways: recorded by the virtual lab, joined to their paths, true to their labels."""

import shutil

import numpy as np
import pandas as pd
import pytest
from artificial_truth import small_study
from numpy.testing import assert_allclose

from gelforge.config import VirtualLab, study_from
from gelforge.dataset.agreement import agreement_table
from gelforge.dataset.join import join_shard
from gelforge.dataset.recorded_presses import recorded_presses
from gelforge.dataset.shard import ShardDataset, shard_attributes
from gelforge.indentation.cells.cell_file import write_cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import plan_cells
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.learning.basis.data import images_of_presses
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mismatch.readings.sessions import observe
from gelforge.recording.features import judge_all, session_features
from gelforge.recording.imaging.image_measures import Measures, add_measures
from gelforge.recording.readings import read_recording, sample_rows, write_readings
from gelforge.recording.tables.checks import RecordingError
from gelforge.recording.tables.join import steps_of_path
from gelforge.virtual_lab.particles import PathMotion, VirtualLabError
from gelforge.virtual_lab.session import make_session
from gelforge.virtual_lab.truth import check_recordable, simulate_truth_cell

LAWS = {"soft": Ogden((0.01,), (2.0,))}
MESH = {"near_mm": 1.2, "near_radius_mm": 3.0, "far_mm": 3.2}
# Two paths from one place, and a straight site.
PLAN = """cell,x_mm,y_mm,depth_mm,phase,shear_x_mm,shear_y_mm
right,16,16,0.6,load,0,0
right,16,16,1.2,load,0,0
right,16,16,1.2,shear,0.3,0
right,16,16,1.2,shear,0.6,0
right,16,16,0.6,unload,0.6,0
back,16,16,0.6,load,0,0
back,16,16,1.2,load,0,0
back,16,16,1.2,shear,-0.2,0.3
back,16,16,1.2,shear,-0.4,0.6
back,16,16,1.2,shear,-0.2,0.3
straight,11,19,0.6,,,
straight,11,19,1.2,,,
"""
LAB = {
    "serial": "virtual-x",
    "materials": {"soft": {"mu_kPa": [10.0], "alpha": [2.0]}},
    "mechanics": {"mesh": MESH},
    "unload_depths_mm": [0.6],
    "particles": {"diameter_mm": 0.6},
    "camera": {
        "width_px": 200,
        "height_px": 200,
        "focal_px": 272.0,
        "centre_px": [99.5, 99.5],
        "position_mm": [16.0, 16.0, -46.0],
    },
    "imaging": {"images_per_press": 2},
    "force": {"noise_N": [0.002] * 3, "resolution_N": [0.004] * 3, "contact_point_scatter_mm": 0.01},
    "sessions": [
        {
            "session": "one",
            "date": "2024-01-01",
            "share": 1.0,
            "seed": 1,
            "axes": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
            "stage_to_sensor": {"origin_mm": [16.0, 16.0], "rotation_deg": 90.0},
        }
    ],
}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return a study with paths, its cells' files and the folder of its synthetic session."""
    folder = tmp_path_factory.mktemp("sheared")
    (folder / "plan.csv").write_text(PLAN)
    described = small_study().model_dump(mode="json")
    described |= {
        "plan": {"file": str(folder / "plan.csv")},
        "mechanics": {"mesh": MESH, "error_bars": False},
    }
    study, lab = study_from(described), VirtualLab.model_validate(LAB)
    cells, files = plan_cells(study), {}
    for name, planned in cells.items():
        files[name] = folder / "cells" / f"{name}.h5"
        write_cell(files[name], simulate_cell(study, LAWS, planned))
        write_cell(folder / "truth" / f"{name}.h5", simulate_truth_cell(study, lab, planned))
    make_session(lab, lab.sessions[0], study, cells, folder / "truth", folder / "one")
    return study, files, folder / "one"


@pytest.fixture(scope="module")
def shard(recorded):
    """Return the shard of a study with paths, and its number of rows."""
    study, files, folder = recorded
    cells = plan_cells(study)
    recording = read_recording(folder, cells, study.sensor)
    assert not recording.findings.lines("excluded") and not (recording.readings["excluded"] != "").any()
    session_features(recording, study.features, folder.parent / "one.h5")
    out = folder.parent / "shard.h5"
    return out, join_shard(study, list(cells), files, {"one": folder.parent / "one.h5"}, out)


def test_a_path_is_one_press_of_loading_whose_images_need_not_be_alike(recorded):
    # A path is one press of which the verdict sees the loading
    study, _, folder = recorded
    readings = read_recording(folder, plan_cells(study), study.sensor).readings
    right = readings[readings["cell"] == "right"]
    assert right["press"].nunique() == 1
    at = right[right["phase"] != "zero"]
    assert list(at["phase"]) == ["load", "load", "shear", "shear", "unload"]
    assert_allclose(
        at["x_mm"], [16, 16, 16.3, 16.6, 16.6], atol=1e-3
    )  # the stage is turned against the sensor
    assert_allclose(at["y_mm"], 16, atol=1e-3)
    assert (at["image"] != "").all()
    assert (np.diff(readings["time_s"]) > 0).all()
    assert readings["press"].nunique() == 4

    # The verdict sees the loading of a sheared press alone
    table = observe([folder], study.sensor).table
    assert (np.abs(table.loc[table["x_mm"] > 14, ["x_mm", "y_mm"]] - 16) < 1e-3).all(axis=None)
    assert set(table.loc[table["x_mm"] > 14, "phase"]) == {"load"}
    assert "unload" in set(table["phase"])  # of the straight press

    # Presses on a sensor that softens are straight
    with pytest.raises(RecordingError, match="moves sideways; on a sensor that softens"):
        recorded_presses(readings, plan_cells(study), study)

    # Images of a sideways motion are not asked to be alike. At one depth they show motions of very different sizes;
    # one that is black is found all the same
    recording = read_recording(folder, plan_cells(study), study.sensor)
    rows = sample_rows(recording)
    rows = rows[rows["image"] != ""]
    moved = {"zero": 0.01, "load": 0.5, "dwell": 0.5, "shear": 2.0, "unload": 2.0}
    light = np.where(rows.index == rows.index[rows["phase"] == "shear"][0], 0.0, 1.0)
    measures = [
        Measures(100.0, gain, gain, moved[phase], 0.0, image)
        for phase, image, gain in zip(rows["phase"], rows["image"], light)
    ]
    found = judge_all(recording, add_measures(rows.assign(run=0), measures), 1.0)
    assert [finding.test for finding in found.of("excluded")] == ["image_content"]


def test_labels_of_a_sheared_session_agree_step_by_step(shard):
    out, count = shard
    rows = ShardDataset([out])
    block = rows.read(
        np.arange(len(rows)),
        ["total_force_ft_N", "total_force_fem_N", "force_distribution_N", "phase", "cell"],
    )
    # two straight presses of two images, paths of five steps, and an untouched image of each of the four presses
    assert count == len(rows) == 2 * 2 + 2 * 5 + 4
    assert shard_attributes(out)["synthetic"]
    measured, label = block["total_force_ft_N"], block["total_force_fem_N"]
    sheared = np.isin(block["phase"], ["shear", "unload"])
    across = np.linalg.norm(label[sheared, :2], axis=1)
    assert across.max() > 0.09
    # four deviations of noise with those of half a step; a contact point off by 0.03 mm at 1.2 mm is 4 % of the force
    noise = 4 * np.hypot(0.002, 0.004 / np.sqrt(12))
    tolerance = noise + 0.04 * across.max()
    assert_allclose(measured[:, :2], label[:, :2], atol=tolerance)
    assert_allclose(measured[:, 2], label[:, 2], atol=noise + 0.05 * np.abs(label[:, 2]).max())
    # the label of a neighbouring step would be seen
    assert np.linalg.norm(np.diff(label[sheared, :2], axis=0), axis=1).min() > 2 * tolerance
    assert_allclose(block["force_distribution_N"].sum(axis=1, dtype=float), label, atol=1e-6)
    assert set(block["phase"][block["cell"] == "back"]) == {"zero", "load", "shear"}

    # Every step of a path is a group of images of its own
    rows = ShardDataset([shard[0]])
    index = np.arange(len(rows))
    groups = images_of_presses(rows, index)
    cell = rows.read(index, ["cell"])["cell"]
    assert len(set(groups[cell == "right"])) == 5 + 1
    assert len(set(groups[cell == "straight"])) == 2 + 2  # two images at each of two depths, two untouched


def test_a_session_of_sheared_presses_is_read_with_its_depth_before_the_motion(recorded, tmp_path):
    # A session of sheared presses alone is read
    alone = tmp_path / "alone"
    alone.mkdir()
    study, _, folder = recorded
    other = alone / "one"
    shutil.copytree(folder, other)
    table = pd.read_csv(other / "indentations.csv", keep_default_na=False)
    table[table["cell"] != "straight"].to_csv(other / "indentations.csv", index=False)
    recording = read_recording(other, plan_cells(study), study.sensor)
    assert recording.findings.lines("excluded") == recording.findings.lines("note") == []
    session_features(recording, study.features, alone / "one.h5")

    # The agreement has the depth before the sideways motion
    agreed = tmp_path / "agreed"
    agreed.mkdir()
    study, files, folder = recorded
    write_readings(agreed / "one.csv", read_recording(folder, plan_cells(study), study.sensor))
    table = agreement_table({"one": agreed / "one.csv"}, files).set_index("cell")
    assert_allclose(table.loc["right", ["x_mm", "depth_mm"]].astype(float), [16, 1.2], atol=1e-3)
    assert abs(table.loc["right", "fem_x_N"]) < 1e-3  # sheared it is 0.09 N
    assert_allclose(table.loc["right", "ft_z_N"], table.loc["right", "fem_z_N"], rtol=0.05)

    # A deeper touch scales forces as the loading does
    motion = PathMotion(
        np.ones((2, 1, 3)), np.array([[0.1, 0, -1.0], [0.0, 0, 0]]), np.array([2.0, 0.0]), lambda d: d**1.5
    )
    moved, force = motion.deeper(0, 0.02)
    assert_allclose(moved, 1.01)
    assert_allclose(force, np.array([0.1, 0, -1.0]) * 1.01**1.5)
    assert_allclose(motion.deeper(1, 0.02)[1], 0)  # back at the surface


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cell": ""}, None),
        ({"cell": "straight"}, "names site 'straight' but lies at site"),
        (
            {"cell": "back"},
            r"moves sideways to \(0\.6, \S+\) mm at depth 1\.2 mm, which is no step of site back",
        ),
        ({"phase": "dwell"}, "moves 0.6 mm sideways; .* `shear`"),
    ],
)
def test_a_sheared_press_joins_the_path_that_it_follows_or_is_refused(recorded, tmp_path, change, message):
    study, _, folder = recorded
    other = tmp_path / "one"
    shutil.copytree(folder, other)
    table = pd.read_csv(other / "indentations.csv", keep_default_na=False)
    right = table["cell"] == "right"
    for name, value in change.items():
        table.loc[right & ((name == "cell") | (table["phase"] == "shear")), name] = value
    table.to_csv(other / "indentations.csv", index=False)
    if message is None:
        readings = read_recording(other, plan_cells(study), study.sensor).readings
        assert set(readings.loc[right.to_numpy(), "cell"]) == {"right"}
    else:
        with pytest.raises(RecordingError, match=message):
            read_recording(other, plan_cells(study), study.sensor)


def test_a_path_that_turns_back_is_followed_in_order():
    """A shear to and fro, then up: one pose is passed twice, and tilted steps are no reading's."""
    phases = ("load", "shear", "shear", "shear", "unload", "tilt")
    shears = ((0.0, 0.0), (0.2, 0.0), (0.4, 0.0), (0.2, 0.0), (0.2, 0.0), (0.2, 0.0))
    tilts = ((0.0, 0.0),) * 5 + ((1.0, 0.0),)
    cell = PlannedCell(
        "c", 10.0, 10.0, (1.0, 1.0, 1.0, 1.0, 0.5, 0.5), phases=phases, shears_mm=shears, tilts_deg=tilts
    )
    read = [
        ("zero", 10.0, -1.0),
        ("load", 10.0, 1.0),
        ("dwell", 10.0, 1.0),
        ("shear", 10.2, 1.0),
        ("shear", 10.3, 1.0),
        ("shear", 10.4, 1.0),
        ("shear", 10.2, 1.0),
        ("unload", 10.2, 0.5),
        ("unload", 10.0, 0.2),
    ]
    rows = pd.DataFrame(read, columns=["phase", "x_mm", "depth_mm"]).assign(y_mm=10.0)
    assert list(steps_of_path(cell, rows)) == [-1, 0, 0, 1, -1, 2, 3, 4, -1]
    # without the reading at the turning point the way back cannot be distinguished from the way there
    assert list(steps_of_path(cell, rows.drop(index=5)))[-3:] == [1, 4, -1]


@pytest.mark.parametrize(
    ("phases", "more", "message"),
    [
        (("load", "tilt"), {"tilts_deg": ((0.0, 0.0), (1.0, 0.0))}, "depth and position only"),
        (("load", "unload", "shear"), {}, "in the order load, unload, shear"),
        (("load", "load"), {}, "these must increase"),
        (("load", "dwell", "shear", "unload"), {}, None),
    ],
)
def test_a_path_that_no_recording_tells_is_refused(phases, more, message):
    planned = PlannedCell("c", 10.0, 10.0, (1.0,) * len(phases), phases=phases, **more)
    if message is None:
        check_recordable(planned)
    else:
        with pytest.raises(VirtualLabError, match=message):
            check_recordable(planned)
