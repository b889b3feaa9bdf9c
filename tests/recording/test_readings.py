"""Readings become force on the sensor in the sensor's frame, join their cells, and bad input is named."""

import cv2
import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from session_folder import HEADER, OFFSET, press_lines, write_session

from gelforge.config import ConfigError, ForceSensor, Sensor, StageToSensor
from gelforge.csv_table import TableError
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.recorded_plan import cells_from_presses, places_of
from gelforge.indentation.sensor.stage_frame import stage_to_sensor
from gelforge.recording.readings import (
    COLUMNS,
    FORCE,
    RAW,
    at_commanded_depth,
    force_on_sensor,
    read_readings,
    read_recording,
    sample_rows,
    write_readings,
)
from gelforge.recording.tables.checks import RecordingError
from gelforge.recording.tables.join import press_table

SENSOR = Sensor.model_validate({"layers": [{"name": "gel", "thickness_mm": 6.0, "material": "m"}]})
CELLS = {
    "left": PlannedCell("left", 10.0, 12.0, (0.5,)),
    "right": PlannedCell("right", 11.004, 12.0, (0.5, 1.0)),
}
number = st.floats(-50, 50)


# ---------------------------------------------------------------------------------------------- corrections
@given(
    force=st.tuples(number, number, number),
    turn=st.tuples(*[st.floats(-180, 180)] * 3),
    on_indenter=st.booleans(),
)
def test_what_a_turned_sensor_records_comes_back(force, turn, on_indenter):
    A = Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    body = "indenter" if on_indenter else "sensor"
    recorded = A.T @ force * (-1 if on_indenter else 1)  # the same force in the recorded axes, on that body
    described = ForceSensor(acts_on=body, axes=A.tolist())
    assert_allclose(force_on_sensor(recorded[None], described)[0], force, atol=1e-10)


def test_axes_map_recorded_to_sensor_and_each_press_has_its_own_zero(tmp_path):
    # Axes map recorded to sensor and not back
    described = ForceSensor(axes=[[0, -1, 0], [1, 0, 0], [0, 0, 1]])  # recorded x is the sensor's y
    assert_allclose(force_on_sensor(np.array([[1.0, 0, 0]]), described), [[0, 1, 0]])

    # Each press has its own zero
    first, second = press_lines("a", 0, 10, 12, 0.5, False), press_lines("b", 1, 11, 12, 1.0, False)
    drifted = [line.replace(",0.5,-0.25,1.0,", ",0.7,-0.25,1.0,") for line in second]
    folder = write_session(tmp_path / "day", lines=[HEADER, *first, *drifted])
    held = read_recording(folder).readings.query("phase == 'dwell'")
    assert_allclose(held["fx_N"], [0.1, 0.1, -0.1, -0.1], atol=1e-12)


@given(
    xy=st.tuples(number, number),
    origin=st.tuples(number, number),
    degrees=st.floats(-360, 360),
    left=st.booleans(),
)
def test_stage_moves_keep_lengths_and_handedness(xy, origin, degrees, left):
    stage = StageToSensor(
        origin_mm=list(origin), rotation_deg=degrees, handedness="left" if left else "right"
    )
    zero, x, y, point = stage_to_sensor(np.array([[0, 0], [1, 0], [0, 1], xy]), stage)
    assert_allclose(zero, origin)
    ex, ey = x - zero, y - zero
    assert_allclose(ex, [np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))], atol=1e-12)
    assert_allclose(ex[0] * ey[1] - ex[1] * ey[0], -1 if left else 1, atol=1e-12)
    assert_allclose(point, zero + xy[0] * ex + xy[1] * ey, atol=1e-9)


@pytest.mark.parametrize("tared", [False, True])
def test_zero_is_subtracted_unless_tared(tmp_path, tared):
    folder = write_session(tmp_path / "day")
    (folder / "session.yaml").write_text(f"session: day\nforce: {{tared: {str(tared).lower()}}}\n")
    if tared:
        table = pd.read_csv(folder / "indentations.csv")
        table[FORCE] -= np.array(OFFSET) - 0.01  # what is left is not subtracted
        table.to_csv(folder / "indentations.csv", index=False)
    readings = read_recording(folder).readings
    held = readings[readings["phase"] == "dwell"]
    exact = np.array([[0.1, -0.2, -0.5]] * 2 + [[0.1, -0.2, -1.0]] * 2)
    assert_allclose(held[FORCE], exact + (0.01 if tared else 0), atol=1e-12)
    assert_allclose(held[RAW], exact + (0.01 if tared else np.array(OFFSET)), atol=1e-12)


def test_faster_force_samples_replace_the_readings_by_time(tmp_path):
    folder = write_session(tmp_path / "day")
    time = np.arange(-1, 17, 0.005)
    fz = 1.0 - 0.3 * ((time % 10 > 1) & (time % 10 < 9))  # around 0 and 10 s zero, then -0.3 N
    ripple = 0.05 * np.sin(2 * np.pi * time / 0.04)  # averages out over the window of 0.04 s
    samples = pd.DataFrame({"time_s": time, "fx_N": 0.0, "fy_N": 0.0, "fz_N": fz + ripple})
    samples.to_csv(folder / "ft.csv", index=False)
    readings = read_recording(folder).readings
    assert_allclose(readings.loc[readings["phase"] == "dwell", "fz_N"], -0.3, atol=0.01)  # ends of the window
    samples[samples["time_s"] < 12].to_csv(folder / "ft.csv", index=False)
    with pytest.raises(RecordingError, match=r"no force sample within 1.0 s of the reading at 15.0 s"):
        read_recording(folder)


# ------------------------------------------------------------------------------------------------- joining
def test_rows_join_their_cells_survive_the_file_and_are_sampled_at_the_commanded_depth(tmp_path):
    # Presses join their cells and rows survive the file
    recording = read_recording(write_session(tmp_path / "day"), CELLS, SENSOR)
    readings = recording.readings
    assert list(readings.columns) == COLUMNS
    assert readings.groupby("press")["cell"].unique().str[0].to_dict() == {"a": "left", "b": "right"}
    write_readings(tmp_path / "r.csv", recording)
    again = read_readings(tmp_path / "r.csv")
    numbers = readings.select_dtypes("number").columns
    assert_allclose(
        again[numbers].to_numpy(), readings[numbers].to_numpy(), rtol=1e-8
    )  # nine digits in the file
    assert (again.drop(columns=numbers) == readings.drop(columns=numbers)).all(axis=None)

    # Samples are zero rows and held rows at the commanded depth
    sampled = tmp_path / "sampled"
    lines = press_lines("a", 0, 10, 12, 0.5, False)
    x, y, z = np.array(OFFSET) + [0.06, -0.12, -0.3]
    lines[2] = f"a,,0,2,load,10,12,0.3,1,0,{x},{y},{z},"  # a load row on the way down
    recording = read_recording(write_session(sampled / "day", lines=[HEADER, *lines]))
    assert list(at_commanded_depth(recording.readings)) == [False, False, False, True, True, False]
    assert list(sample_rows(recording)["phase"]) == ["zero", "zero", "dwell", "dwell"]


@pytest.mark.parametrize(
    ("offset", "clipped", "refused"), [(0.0, -0.5, True), (3.0, 2.5, True), (3.0, -9.0, False)]
)
def test_a_force_that_stays_at_its_largest_while_presses_go_deeper_is_refused(
    tmp_path, offset, clipped, refused
):
    """Of raw readings, whose zero may be anywhere; what never reaches the end of the range is read."""
    at = [HEADER]
    for k, depth in enumerate((0.25, 0.5, 0.75, 1.0)):
        z = max(offset - depth, clipped)
        at += [
            f"p{k},,{k},{10 * k},zero,10,12,-1,1,,0,0,{offset},",
            f"p{k},,{k},{10 * k + 2},load,10,12,{depth},1,,0,0,{z},",
        ]
    folder = write_session(tmp_path / "day", lines=at)
    if refused:
        with pytest.raises(RecordingError, match=r"\(fz\) stays at .* as a saturated sensor does"):
            read_recording(folder)
    else:
        assert len(read_recording(folder).readings) == 8


@pytest.mark.parametrize(
    ("zeros", "loads"),
    [((0, 0, 0, 0), (0.07, 0.02, 0.05, 0.07)), ((0.05, 0.15, 0.05, 0.05), (0.15, 0.15, 0.15, 0.15))],
)
def test_rounded_noise_that_is_largest_at_several_depths_is_not_a_saturated_sensor(tmp_path, zeros, loads):
    """Sideways forces of a press next to the middle are within the noise: what is rounded to 10 mN is often equal."""
    at = [HEADER]
    for k, (depth, zero, x) in enumerate(zip((0.25, 0.5, 0.75, 1.0), zeros, loads)):
        at += [
            f"p{k},,{k},{10 * k},zero,10,12,-1,1,,{zero},0,0,",
            f"p{k},,{k},{10 * k + 2},load,10,12,{depth},1,,{x},0,{-depth},",
        ]
    assert len(read_recording(write_session(tmp_path / "day", lines=at)).readings) == 8


def test_a_plan_can_be_derived_from_the_recordings(tmp_path):
    one, two = write_session(tmp_path / "one"), write_session(tmp_path / "two", presses=4)
    places = [place for folder in (one, two) for place in places_of(folder, (32.0, 32.0))]
    cells = cells_from_presses(places, 0.01)
    assert [(c.name, c.x_mm, c.y_mm, c.depths_mm) for c in cells.values()] == [
        ("p0000", 10.0, 12.0, (0.5,)),
        ("p0001", 11.0, 12.0, (1.0,)),
    ]
    for name in ("one", "two"):
        assert set(read_recording(tmp_path / name, cells).readings["cell"]) == {"p0000", "p0001"}
    assert list(press_table(read_recording(one).readings)["row"]) == [0, 6]


def test_other_separators_and_other_columns_are_read(tmp_path):
    # Semicolons decimal commas and comments are read
    folder = write_session(tmp_path / "day")
    wanted = read_recording(folder).readings
    text = (folder / "indentations.csv").read_text().replace(",", ";").replace(".", ",")
    (folder / "indentations.csv").write_text("# stage 3\n% by hand\n" + text, encoding="utf-8-sig")
    pd.testing.assert_frame_equal(read_recording(folder).readings, wanted)

    # Extra columns are ignored and cell image and dwell may be absent
    columns = tmp_path / "columns"
    folder = write_session(columns / "day")
    table = pd.read_csv(folder / "indentations.csv").drop(
        columns=["cell", "image", "dwell_s", "speed_mm_per_s"]
    )
    table.assign(colour="red").to_csv(folder / "indentations.csv", index=False)
    readings = read_recording(folder, CELLS, SENSOR).readings
    assert list(readings.columns) == COLUMNS
    assert (readings["image"] == "").all()


# ----------------------------------------------------------------------------------------------- bad input
def replace(old, new, count=-1):
    def edit(folder):
        path = folder / "indentations.csv"
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new, count))

    return edit


def scale(factor, *columns):
    def edit(folder):
        table = pd.read_csv(folder / "indentations.csv")
        table[list(columns)] *= factor
        table.to_csv(folder / "indentations.csv", index=False)

    return edit


def session(text):
    return lambda folder: (folder / "session.yaml").write_text(text)


def swap_lines(i, j):
    def edit(folder):
        lines = (folder / "indentations.csv").read_text().splitlines()
        lines[i], lines[j] = lines[j], lines[i]
        (folder / "indentations.csv").write_text("\n".join(lines))

    return edit


BAD = {
    "no session.yaml": (lambda f: (f / "session.yaml").unlink(), r"session\.yaml: missing; describe"),
    "other name": (session("session: night\n"), r"session 'night' in a folder named 'day'"),
    "unknown key": (session("session: day\nforces: {}\n"), r"forces.*unknown key"),
    "axes not orthonormal": (
        session("session: day\nforce: {axes: [[1,0,0],[0,2,0],[0,0,1]]}\n"),
        "orthonormal",
    ),
    "no table": (lambda f: (f / "indentations.csv").unlink(), r"indentations\.csv: no such file"),
    "column missing": (replace("fz_N", "Fz", 1), r"columns \['fz_N'\] are missing"),
    "empty number": (replace("a,,0,2,load,10,", "a,,0,2,load,,"), r"row 4: x_mm is nothing"),
    "NaN force": (replace(",1,0,0.6,", ",1,0,NaN,", 1), r"row 4: fx_N is 'NaN'"),
    "text for number": (replace("a,,0,2,", "a,,0,two,"), r"row 4: time_s is 'two'"),
    "empty press": (replace("a,,0,2,load", ",,0,2,load"), r"row 4: press is empty"),
    "unknown phase": (replace(",dwell,", ",hold,", 1), r"row 5: phase 'hold' is not one of"),
    "phase order": (swap_lines(3, 7), r"time_s|order"),
    "zero after load": (replace("unload", "zero", 1), r"row 7: phase zero after dwell in indentation a"),
    "time backwards": (replace("a,,0,2,load", "a,,0,0.05,load"), r"row 4: time_s 0\.05 after 0\.1"),
    "order backwards": (replace("b,,1,", "b,,-1,"), r"row 8: order -1 after 0"),
    "two presses of one order": (replace("b,,1,", "b,,0,"), r"row 8: indentation b with order 0"),
    "press comes back": (replace("b,,1,", "a,,1,"), r"row 8: indentation a with order 1"),
    "fractional order": (replace("b,,1,", "b,,1.5,"), r"order 1\.5 is not a whole number"),
    "no load or dwell": (
        lambda f: [replace(p, "approach")(f) for p in ("load", "dwell", "unapproach")],
        r"indentation a has no load or dwell row",
    ),
    "negative depth held": (
        replace("load,10,12,0.5", "load,10,12,-0.5", 1),
        r"row 4: depth_mm -0\.5 in phase load",
    ),
    "positive depth at zero": (
        replace("zero,10,12,-1", "zero,10,12,1", 1),
        r"row 2: depth_mm 1\.0 in phase zero",
    ),
    "depth empty": (replace("load,10,12,0.5", "load,10,12,", 1), r"row 4: depth_mm is empty"),
    "depth in m": (scale(1e-3, "depth_mm"), r"depth_mm 0\.001; 0\.02 to 30.*metres"),
    "depth in um": (scale(1e3, "depth_mm"), r"depth_mm 1000; 0\.02 to 30.*micrometres"),
    "force in mN": (scale(1e3, "fx_N", "fy_N", "fz_N"), r"fx_N 500 N beyond 100 N .*millinewtons"),
    "force in kN": (scale(1e-3, "fx_N", "fy_N", "fz_N"), r"the largest fz_N is -0\.001 N.*kilonewtons"),
    "force beyond range": (
        session("session: day\nforce: {range_N: [5, 5, 0.9]}\n"),
        r"row 2: fz_N 1 N beyond 0\.9 N \(force\.range_N\)",
    ),
    "force on the indenter": (
        session("session: day\nforce: {acts_on: indenter}\n"),
        r"pressing gives fz_N 0\.75 N .* correct force\.acts_on",
    ),
    "no zero rows": (replace("zero", "approach"), r"row 2: indentation a has no zero row; .*tared"),
    "sideways": (replace("dwell,10,", "dwell,10.2,", 1), r"row 5: indentation a moves 0\.2 mm sideways"),
    "outside": (replace(",10,12,", ",10,33,"), r"row 2: position \(10, 33\) mm .*32\.0 x 32\.0 mm"),
    "position in m": (scale(1e-3, "x_mm", "y_mm"), r"row 2: position \(0\.01, 0\.012\) mm .*metres"),
    "position in um": (scale(1e3, "x_mm", "y_mm"), r"row 2: position \(10000, 12000\) mm .*micrometres"),
    "press without its cell": (
        replace(",11,12,", ",11.3,12,"),
        r"row 8: indentation b at \(11\.3000, 12\.0000\) mm has no planned site within 0\.01 mm; the nearest is right",
    ),
    "depth not planned": (
        replace(",11,12,1.0,", ",11,12,0.8,"),
        r"row 8: indentation b: depth_mm 0\.8000 is not among",
    ),
    "another cell": (replace("b,,", "b,left,"), r"indentation b names site 'left' but lies at site 'right'"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_named(tmp_path, name):
    edit, message = BAD[name]
    folder = write_session(tmp_path / "day")
    read_recording(folder, CELLS, SENSOR)  # good before the edit
    edit(folder)
    with pytest.raises((RecordingError, TableError, ConfigError), match=message):
        read_recording(folder, CELLS, SENSOR)


BAD_IMAGES = {
    "no reference": (
        lambda f: (f / "reference.png").unlink(),
        r"reference\.png: the reference frame is missing",
    ),
    "missing": (lambda f: (f / "images" / "b_1.png").unlink(), r"row 11: image b_1\.png is not in"),
    "other size": (
        lambda f: cv2.imwrite(str(f / "images" / "b_1.png"), np.zeros((120, 141), np.uint8)),
        r"b_1\.png: 141 x 120 px, but the reference frame has 140 x 120",
    ),
    "cut short": (
        lambda f: (f / "images" / "b_1.png").write_bytes((f / "images" / "b_1.png").read_bytes()[:-100]),
        r"b_1\.png: the PNG was cut short",
    ),
    "no image": (
        lambda f: (f / "images" / "b_1.png").write_bytes(b"x" * 100),
        r"b_1\.png: not a readable image",
    ),
    "empty": (lambda f: (f / "images" / "b_1.png").write_bytes(b""), r"b_1\.png: not a readable image"),
    "named twice": (replace("a_2.png", "a_1.png"), r"row 6: image a_1\.png is named twice"),
    "camera of another size": (
        session(
            "session: day\ncamera: "
            "{width_px: 64, height_px: 64, focal_px: 9, centre_px: [1, 1], position_mm: [1, 1, -9]}\n"
        ),
        r"140 x 120 px, but session\.yaml has a camera of 64 x 64 px",
    ),
}


@pytest.mark.parametrize("name", BAD_IMAGES)
def test_bad_images_are_named_without_decoding(tmp_path, name, monkeypatch):
    edit, message = BAD_IMAGES[name]
    folder = write_session(tmp_path / "day", images=True)
    read_recording(folder, CELLS, SENSOR)
    edit(folder)
    monkeypatch.setattr(cv2, "imread", None)
    with pytest.raises(RecordingError, match=message):
        read_recording(folder, CELLS, SENSOR)


def test_a_row_that_stands_twice_is_refused_and_a_like_one_is_not(tmp_path):
    lines = press_lines("a", 0, 10, 12, 0.5, False)
    again = [HEADER, *lines[:4], lines[3], *lines[4:]]
    with pytest.raises(
        RecordingError, match=r"row 6: indentation a: the row appears twice, time_s 3 and force included"
    ):
        read_recording(write_session(tmp_path / "day", lines=again))
    later = lines[3].replace(",3,dwell", ",3.5,dwell")  # the same force to the digit half a second later
    other = press_lines("b", 1, 11, 12, 1.0, False)
    read_recording(write_session(tmp_path / "night", lines=[HEADER, *lines[:4], later, *lines[4:], *other]))


@pytest.mark.parametrize(("factor", "right"), [(1.0, True), (3.0, True), (1000.0, False), (1e-3, False)])
def test_a_clock_that_the_dwells_contradict_is_refused(tmp_path, factor, right):
    folder = write_session(tmp_path / "day")
    table = pd.read_csv(folder / "indentations.csv")
    table["time_s"] *= factor
    table.to_csv(folder / "indentations.csv", index=False)
    if right:
        assert len(read_recording(folder).readings)
    else:
        with pytest.raises(RecordingError, match="as fast as dwell_s"):
            read_recording(folder)
