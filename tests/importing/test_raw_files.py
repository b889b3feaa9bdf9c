"""Raw files that cannot be meant: each is refused in one line with the key or the remedy that settles it."""

from datetime import datetime, timedelta
from pathlib import Path

import pytest
from raw_logs import MAPPING, Lab, generate

from gelforge.config import ConfigError
from gelforge.config.foreign.importing import ForceSource, StageSource, load_import
from gelforge.csv_table import TableError
from gelforge.importing.importer import import_logs
from gelforge.importing.refusals import ImportingError
from gelforge.importing.streams import read_force, read_stage

LAB = Lab(presses=3)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    generate(folder, LAB)
    return folder


def refused(logs, tmp_path, mapping, kind, said, **files):
    """Import copies of the logs, some of them replaced; the error is one line and says this."""
    for name in ("ft.csv", "stage.csv"):
        (tmp_path / name).write_bytes((logs / name).read_bytes())
    for name, content in files.items():
        (tmp_path / name.replace("__", ".")).write_text(content)
    (tmp_path / "mapping.yaml").write_text(mapping)
    with pytest.raises(kind, match=said) as error:
        import_logs(tmp_path / "mapping.yaml", "s1")
    assert "\n" not in str(error.value)


def test_an_empty_file(logs, tmp_path):
    refused(logs, tmp_path, MAPPING, TableError, r"ft\.csv: no header line", ft__csv="")


def test_a_header_alone(logs, tmp_path):
    refused(
        logs, tmp_path, MAPPING, TableError, r"ft\.csv: no rows below the header", ft__csv="Time,Fx,Fy,Fz\n"
    )


def test_exchanged_files(logs, tmp_path):
    swapped = (
        MAPPING.replace("file: ft.csv", "file: X")
        .replace("file: stage.csv", "file: ft.csv")
        .replace("file: X", "file: stage.csv")
    )
    refused(
        logs,
        tmp_path,
        swapped,
        ImportingError,
        r"exchange force\.file and stage\.file|exchange stage\.file and force\.file",
    )


def test_a_pickle(logs, tmp_path):
    refused(
        logs,
        tmp_path,
        MAPPING.replace("ft.csv", "ft.pkl"),
        ImportingError,
        r"a pickle can run code .* save the table as CSV",
    )


def test_pickled_frames_and_an_archive(logs, tmp_path):
    camera = "camera: {{video: {}, rate_hz: 25}}\n"
    refused(
        logs,
        tmp_path,
        MAPPING + camera.format("film.pkl"),
        ImportingError,
        r"a pickle .* export the frames as images",
    )
    refused(
        logs,
        tmp_path,
        MAPPING.replace("ft.csv", "ft.zip"),
        ImportingError,
        r"an archive .* into a new folder",
    )


def test_time_that_runs_back(logs, tmp_path):
    lines = (logs / "ft.csv").read_text().splitlines()
    lines[100], lines[101] = lines[101], lines[100]
    refused(
        logs,
        tmp_path,
        MAPPING,
        ImportingError,
        r"row 102: the time runs back by .* set force\.even: true",
        ft__csv="\n".join(lines),
    )


def test_a_gap(logs, tmp_path):
    lines = (logs / "stage.csv").read_text().splitlines()
    refused(
        logs,
        tmp_path,
        MAPPING,
        ImportingError,
        r"no row between .* record without gaps",
        stage__csv="\n".join(lines[:60] + lines[90:]),
    )


def test_rows_of_two_robots(logs, tmp_path):
    lines = (logs / "stage.csv").read_text().splitlines()
    for k in range(40, 60):
        time, x, y, z = lines[k].split(",")
        lines[k] = f"{time},{float(x) + 450e3},{y},{z}"
    refused(
        logs,
        tmp_path,
        MAPPING,
        ImportingError,
        r"jumps by 450 mm within .* \(2 times\).* rows of two robots or of two frames .* keep those of one",
        stage__csv="\n".join(lines),
    )


def test_a_column_without_numbers(logs, tmp_path):
    lines = (logs / "ft.csv").read_text().splitlines()
    empty = [lines[0]] + [line.rsplit(",", 1)[0] + "," for line in lines[1:]]
    refused(logs, tmp_path, MAPPING, TableError, r"ft\.csv, row 2: .*Fz", ft__csv="\n".join(empty))


def test_a_force_that_is_dead(logs, tmp_path):
    lines = (logs / "ft.csv").read_text().splitlines()
    dead = [lines[0]] + [line.split(",")[0] + ",0.0,0.0,0.0" for line in lines[1:]]
    refused(logs, tmp_path, MAPPING, ImportingError, r"does not follow the stage", ft__csv="\n".join(dead))


def test_a_folder_in_the_place_of_a_log(logs, tmp_path):
    (tmp_path / "frames").mkdir()
    refused(logs, tmp_path, MAPPING.replace("stage.csv", "frames"), TableError, r"frames: a folder, no file")


def test_a_header_that_says_another_unit(logs, tmp_path):
    text = (logs / "ft.csv").read_text().replace("Fx,Fy,Fz", "Fx (lbf),Fy (lbf),Fz (lbf)")
    mapping = MAPPING.replace("[Fx, Fy, Fz]", '["Fx (lbf)", "Fy (lbf)", "Fz (lbf)"]')
    refused(
        logs,
        tmp_path,
        mapping,
        ImportingError,
        r"'Fx \(lbf\)' says lbf, force\.unit says N; set force\.unit: lbf",
        ft__csv=text,
    )


def test_a_video_that_is_none(logs, tmp_path):
    mapping = MAPPING + "camera: {video: film.avi, rate_hz: 25}\n"
    refused(
        logs, tmp_path, mapping, ImportingError, r"film\.avi: no frame can be decoded", film__avi="no video"
    )


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("unit: N", "unit: kV", r"force\.unit: unit 'kV' is no force"),
        ("unit: um", "unit: N", r"stage\.unit: unit 'N' is no length"),
        ("{acts_on: sensor}", "{tared: true}", r"session\.force\.acts_on is missing"),
        ("depth_zero: session\n", "", r"depth_zero: Field required"),
        ("pressing: -z", "pressing: down", r"stage\.pressing, found 'down'"),
        ("  file: ft.csv\n", "  file: ft.csv\n  lagg_s: 1\n", r"lagg_s, found 1: unknown key; did you mean lag_s\?"),
        ("  time: {column: Time, unit: s}\n", "", r"no time: name the column of stamps under `time`, or give rate_hz"),
        ("unit: s}", "unit: weeks}", r"unit 'weeks' is no time"),
        ("describes", "camera: {video: a.avi}\ndescribes", r"say once when frames were taken"),
        ("describes", "camera: {rate_hz: 25}\ndescribes", r"give either video \(a file\) or frames \(a folder\)"),
    ],
)  # fmt: skip
def test_mappings_that_leave_something_open(tmp_path, old, new, said):
    (tmp_path / "mapping.yaml").write_text(MAPPING.replace(old, new))
    with pytest.raises(ConfigError, match=said) as error:
        load_import(tmp_path / "mapping.yaml")
    assert "\n" not in str(error.value)


def test_the_documented_mapping_is_short_and_valid(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "importing.md").read_text(encoding="utf-8")
    block = page.split("    describes:")[1].split("\n\n")[0]
    lines = ("    describes:" + block).splitlines()
    assert len(lines) <= 15  # the number, force, stage and video together
    (tmp_path / "mapping.yaml").write_text("\n".join(line[4:] for line in lines))
    assert load_import(tmp_path / "mapping.yaml").camera.video == "film.avi"


def test_layouts_of_makers(tmp_path):
    """Semicolons and decimal commas, lines above the header, a line of units, dates, milliseconds of a day."""
    rows = [f"{9.81 + 0.004 * k:.3f};0,1{k % 10};-0,5;{k % 7},25".replace(".", ",") for k in range(30)]
    (tmp_path / "optoforce.csv").write_text(
        "Sensor: HEX-E\nRate: 250\nTime;Fx;Fy;Fz\ns;N;N;N\n" + "\n".join(rows)
    )
    source = {"file": "optoforce.csv", "time": {"column": "Time", "unit": "s"}, "columns": ["Fx", "Fy", "Fz"], "unit": "N",
              "table": {"separator": ";", "decimal": ",", "header_begins_with": "Time"}}  # fmt: skip
    stage = {"file": "robot.csv", "time": {"column": "stamp", "unit": "iso"}, "x": "x", "y": 16.0, "z": "z", "unit": "m",
             "pressing": "+z"}  # fmt: skip
    midnight = datetime(2026, 3, 1, 23, 59, 45)
    moves = [f"{(midnight + timedelta(seconds=k)).isoformat()}Z,0.0101,{0.001 * k}" for k in range(30)]
    (tmp_path / "robot.csv").write_text("# robot\nstamp,x,z\n" + "\n".join(moves))
    force, stage = ForceSource(**source), StageSource(**stage)
    log = read_force(tmp_path, force, stage)
    assert log.values[3] == pytest.approx([0.13, -0.5, 3.25])
    assert log.time_s[:3] == pytest.approx([0, 0.004, 0.008])
    path = read_stage(tmp_path, stage, force)
    assert path.values[2] == pytest.approx([10.1, 16.0, 2.0])
    assert path.time_s[1] == pytest.approx(1.0)
