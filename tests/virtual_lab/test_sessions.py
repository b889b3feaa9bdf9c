"""A synthetic session is a laboratory's session: repeatable, readable, and true to the truth within its noise."""

import filecmp
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from artificial_truth import DEPTHS, UNLOAD, force_at, small_lab, small_study, truth_cell
from numpy.testing import assert_allclose

from gelforge.cli.products.virtual_lab import virtual_lab_of
from gelforge.config import ConfigError, load_session
from gelforge.indentation.cells.cell_file import write_cell
from gelforge.indentation.planning.plan import plan_cells
from gelforge.indentation.sensor.symmetry import transform_vectors
from gelforge.recording.imaging.flow import read_grey
from gelforge.recording.readings import at_commanded_depth, read_recording, stage_to_sensor
from gelforge.virtual_lab.particles import VirtualLabError
from gelforge.virtual_lab.session import (
    Bench,
    make_session,
    random_presses,
    sensor_to_stage,
    session_cells,
)

STUDY = small_study()
CELLS = plan_cells(STUDY)
LAB = small_lab()


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    folder = tmp_path_factory.mktemp("truth")
    for cell in CELLS.values():
        if cell.source is None:
            write_cell(folder / f"{cell.name}.h5", truth_cell(cell.name, cell.x_mm, cell.y_mm))
    return folder


@pytest.fixture(scope="module")
def made(truth, tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    for session in LAB.sessions:
        make_session(LAB, session, STUDY, CELLS, truth, folder / session.session)
    return folder


@pytest.mark.parametrize(("symmetry", "refused"), [("auto", True), ("d4", True), ("none", False)])
def test_a_lab_whose_sensor_is_not_symmetric_is_not_mirrored(symmetry, refused, tmp_path):
    lab = yaml.safe_load(Path("config/virtual_lab/test.yaml").read_text())
    lab["mechanics"]["effects"] = {"kinematics": {"tilt_deg": [2.0, 0.0]}}
    (tmp_path / "lab.yaml").write_text(yaml.safe_dump(lab))
    plan = STUDY.plan.model_copy(update={"symmetry": symmetry})
    study = STUDY.model_copy(update={"virtual_lab": tmp_path / "lab.yaml", "plan": plan})
    if refused:
        with pytest.raises(ConfigError, match=r"lab\.yaml: its mechanics\.effects .* use symmetry: none"):
            virtual_lab_of(study, Path("study.yaml"))
    else:
        assert virtual_lab_of(study, Path("study.yaml")).mechanics.effects.kinematics.tilt_deg == [2.0, 0.0]


def test_sessions_share_the_cells_out_and_exposure_drifts_but_in_an_old_lab():
    # Sessions share the cells out and turn back to the sensor
    parts = session_cells(LAB, CELLS)
    assert sorted(parts["one"] + parts["two"]) == sorted(CELLS)
    assert [len(parts["one"]), len(parts["two"])] == [5, 4]

    # Stage positions turn back to the sensor
    xy = np.array([[5.0, 27.0], [16.0, 11.0]])
    for session in LAB.sessions:
        back = stage_to_sensor(sensor_to_stage(xy, session.stage_to_sensor), session.stage_to_sensor)
        assert_allclose(back, xy, atol=1e-12)

    # Exposure drifts and an old lab is written as it was
    imaging = LAB.imaging.model_copy(update={"exposure_drift": -0.1})
    presses = random_presses(LAB.sessions[0], list(CELLS.values()))
    lab = LAB.model_copy(update={"imaging": imaging})
    bench = Bench(lab, LAB.sessions[0], None, None, None, last=len(presses) - 1)
    assert [bench.exposure(presses[k]) for k in (0, -1)] == [1.0, 0.9]
    assert Bench(LAB, LAB.sessions[0], None, None, None, last=3).exposure(presses[2]) == 1.0

    # The digest of a truth cell is of what is written.
    later = {"vignetting", "uneven_light", "defocus_px_per_mm", "focus_z_mm", "exposure_drift"}
    assert not later & set(LAB.model_dump()["imaging"])
    changed = LAB.imaging.model_copy(update={"vignetting": 0.1})
    assert changed.model_dump()["vignetting"] == 0.1


@pytest.mark.parametrize("session", LAB.sessions, ids=lambda s: s.session)
def test_readings_agree_with_the_truth_through_axes_offset_and_stage(made, session):
    recording = read_recording(made / session.session, CELLS, STUDY.sensor)
    readings = recording.readings
    assert sorted(readings["cell"].unique()) == sorted(session_cells(LAB, CELLS)[session.session])
    held = readings[at_commanded_depth(readings)]
    # mirrored cells included: each position has the force of the source carried by the symmetry
    exact = []
    for cell, depth in zip(held["cell"], held["depth_mm"]):
        planned = CELLS[cell]
        source = CELLS[planned.source] if planned.source else planned
        force = force_at(np.array([depth]), source.x_mm, source.y_mm)
        exact.append(transform_vectors(planned.symmetry, force)[0] if planned.symmetry else force[0])
    # half a step of the reading and of the zero, noise, and 0.03 mm of the contact point times 0.4 N/mm
    assert_allclose(held[["fx_N", "fy_N", "fz_N"]], exact, atol=0.09)
    # steps average out over many readings: no offset is left
    error = held[["fx_N", "fy_N", "fz_N"]].to_numpy() - exact
    assert np.abs(error.mean(axis=0)).max() < 0.02
    raw_zero = readings.loc[readings["phase"] == "zero", ["fx_raw_N", "fy_raw_N", "fz_raw_N"]].to_numpy()
    steps = raw_zero / LAB.force.resolution_N
    assert_allclose(steps, np.rint(steps), atol=1e-6)  # CSV holds nine decimals


def test_a_lab_repeats_its_bytes_and_replaces_no_measured_data(made, truth, tmp_path):
    # The same lab makes the same bytes with any number of threads
    again = tmp_path / "again"
    again.mkdir()
    make_session(LAB, LAB.sessions[0], STUDY, CELLS, truth, again / "one", workers=2)
    files = sorted(path.relative_to(again) for path in again.rglob("*") if path.is_file())
    presses = 5 * len(DEPTHS)
    assert len(files) == presses * 3 + 4
    assert filecmp.cmpfiles(again, made, files, shallow=False)[1:] == ([], [])

    # Measured data is never replaced
    measured = tmp_path / "measured"
    measured.mkdir()
    folder = measured / "one"
    folder.mkdir()
    (folder / "indentations.csv").write_text("measured")
    with pytest.raises(VirtualLabError, match="not a synthetic session"):
        make_session(LAB, LAB.sessions[0], STUDY, CELLS, truth, folder)
    (folder / "session.yaml").write_text("session: one\nsynthetic: false\n")
    with pytest.raises(VirtualLabError, match="not a synthetic session"):
        make_session(LAB, LAB.sessions[0], STUDY, CELLS, truth, folder)
    assert (folder / "indentations.csv").read_text() == "measured"


def test_images_order_and_names_are_those_of_a_synthetic_session(made):
    folder = made / "one"
    first, second = (read_grey(folder / "images" / f"p00000_{i}.png").astype(float) for i in (0, 1))
    zero, reference = read_grey(folder / "images" / "p00000_zero.png"), read_grey(folder / "reference.png")
    # two images' noise of 2 grey levels and rounding: sqrt(2 (4 + 1 / 12)) = 2.86, clipped nowhere
    for a, b in ((first, second), (zero.astype(float), reference.astype(float))):
        assert_allclose((a - b).std(), 2.86, rtol=0.02)
    assert (first - reference).std() > 4  # particles moved

    # Order is random and only the deepest press is followed up
    readings = read_recording(made / "one", CELLS, STUDY.sensor).readings
    presses = readings[readings["phase"] == "load"]
    assert list(presses["depth_mm"]) != sorted(presses["depth_mm"])
    assert presses["cell"].ne(presses["cell"].shift()).sum() > len(presses["cell"].unique())
    up = readings[readings["phase"] == "unload"]
    deep = presses.loc[presses["depth_mm"] == DEPTHS[-1], "press"]
    assert sorted(up["press"]) == sorted(deep)
    assert set(up["depth_mm"]) == set(UNLOAD)

    # Everything says synthetic and nothing tells the truth
    for name in ("one", "two"):
        assert load_session(made / name / "session.yaml").synthetic
        assert (made / name / "README.txt").read_text().startswith("SYNTHETIC")
        for path in (made / name).glob("*.*"):
            assert b"1.123" not in path.read_bytes()
            assert b"stiffness" not in path.read_bytes()


def test_an_interrupted_session_is_made_again_and_one_in_colour_is_read_as_grey(made, truth, tmp_path):
    # An interrupted synthetic session is made again
    interrupted = tmp_path / "interrupted"
    interrupted.mkdir()
    folder = interrupted / "one"
    make_session(LAB, LAB.sessions[0], STUDY, CELLS, truth, folder)
    (folder / "session.yaml").unlink()
    make_session(LAB, LAB.sessions[0], STUDY, CELLS, truth, folder)
    assert filecmp.cmp(folder / "indentations.csv", made / "one" / "indentations.csv", shallow=False)

    # A session in colour is read as a grey one
    coloured = tmp_path / "coloured"
    coloured.mkdir()
    colours = {"background_rgb": [40.0, 20.0, 10.0], "particle_rgb": [90.0, 220.0, 60.0]}
    lab = LAB.model_copy(update={"imaging": LAB.imaging.model_copy(update=colours)})
    make_session(lab, LAB.sessions[1], STUDY, CELLS, truth, coloured / "two")
    image = cv2.imread(str(coloured / "two" / "reference.png"), cv2.IMREAD_UNCHANGED)
    assert image.shape == (160, 200, 3)
    readings = read_recording(coloured / "two", CELLS, STUDY.sensor).readings
    other = read_recording(made / "two", CELLS, STUDY.sensor).readings
    assert list(readings["image"]) == list(other["image"])
    first, second = (read_grey(coloured / "two" / "images" / f"p00000_{i}.png").astype(float) for i in (0, 1))
    # the noise of two images in three channels of 2 levels: 2 x 0.6685, with the rounding of grey levels
    assert_allclose((first - second).std(), np.sqrt(2 * ((2 * 0.6685) ** 2 + 1 / 12)), rtol=0.03)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"status": "failed", "reason": "no equilibrium at 0.7 mm"}, "no equilibrium at 0.7 mm"),
        ({"phases": ["load", "unload", "unload"]}, "ends at 0.5 mm"),
    ],
)
def test_a_truth_cell_that_failed_or_ends_early_is_named(tmp_path, change, message):
    for cell in CELLS.values():
        if cell.source is None:
            truth = truth_cell(cell.name, cell.x_mm, cell.y_mm, **change)
            if "phases" in change:
                truth.arrays["depth_mm"] = np.array([0.5, 0.4, 0.3])
            write_cell(tmp_path / "truth" / f"{cell.name}.h5", truth)
    with pytest.raises(VirtualLabError, match=message):
        make_session(LAB, LAB.sessions[0], STUDY, CELLS, tmp_path / "truth", tmp_path / "one")
    assert not (tmp_path / "one").exists()
    assert not list(tmp_path.glob(".one*"))
