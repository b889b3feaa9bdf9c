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


def swapped(lines):
    return [*lines[:100], lines[101], lines[100], *lines[102:]]


def of_two_robots(lines):
    """Move 20 rows by 450 mm."""
    moved = [line.split(",") for line in lines[40:60]]
    return [*lines[:40], *(f"{t},{float(x) + 450e3},{y},{z}" for t, x, y, z in moved), *lines[60:]]


def with_force(values):
    """Return a change of ft.csv: other values of each row below the header."""
    return lambda lines: [lines[0], *(values(line) for line in lines[1:])]


CAMERA = "camera: {{video: {}, rate_hz: 25}}\n"
FORCE, STAGE = "file: ft.csv", "file: stage.csv"
EXCHANGED = MAPPING.replace(FORCE, "file: X").replace(STAGE, FORCE).replace("file: X", STAGE)
POUNDS = MAPPING.replace("[Fx, Fy, Fz]", '["Fx (lbf)", "Fy (lbf)", "Fz (lbf)"]')
# by name: the mapping, what becomes of the lines of files, the error
REFUSED = {
    "an empty file": (MAPPING, {"ft.csv": lambda lines: []}, r"ft\.csv: no header line"),
    "a header alone": (
        MAPPING,
        {"ft.csv": lambda lines: [lines[0], ""]},
        r"ft\.csv: no rows below the header",
    ),
    "exchanged files": (
        EXCHANGED,
        {},
        r"exchange force\.file and stage\.file|exchange stage\.file and force\.file",
    ),
    "a pickle": (
        MAPPING.replace("ft.csv", "ft.pkl"),
        {},
        r"a pickle can run code .* save the table as CSV",
    ),
    "pickled frames": (MAPPING + CAMERA.format("film.pkl"), {}, r"a pickle .* export the frames as images"),
    "an archive": (MAPPING.replace("ft.csv", "ft.zip"), {}, r"an archive .* into a new folder"),
    "time that runs back": (
        MAPPING,
        {"ft.csv": swapped},
        r"row 102: the time runs back by .* set force\.even: true",
    ),
    "a gap": (
        MAPPING,
        {"stage.csv": lambda lines: lines[:60] + lines[90:]},
        r"no row between .* record without gaps",
    ),
    "rows of two robots": (
        MAPPING,
        {"stage.csv": of_two_robots},
        r"jumps by 450 mm within .* \(2 times\).* rows of two robots or of two frames .* keep those of one",
    ),
    "a column without numbers": (
        MAPPING,
        {"ft.csv": with_force(lambda line: line.rsplit(",", 1)[0] + ",")},
        r"ft\.csv, row 2: .*Fz",
    ),
    "a dead force": (
        MAPPING,
        {"ft.csv": with_force(lambda line: line.split(",")[0] + ",0.0,0.0,0.0")},
        r"does not follow the stage",
    ),
    "a folder in the place of a log": (
        MAPPING.replace("stage.csv", "frames"),
        {},
        r"frames: a folder, no file",
    ),
    "a header that says another unit": (
        POUNDS,
        {"ft.csv": lambda lines: ["Time,Fx (lbf),Fy (lbf),Fz (lbf)", *lines[1:]]},
        r"'Fx \(lbf\)' says lbf, force\.unit says N; set force\.unit: lbf",
    ),
    "a video that is none": (
        MAPPING + CAMERA.format("film.avi"),
        {"film.avi": lambda lines: ["no video"]},
        r"film\.avi: no frame can be decoded",
    ),
}


@pytest.mark.parametrize(("mapping", "changes", "said"), REFUSED.values(), ids=REFUSED)
def test_logs_that_cannot_be_meant(logs, tmp_path, mapping, changes, said):
    (tmp_path / "frames").mkdir()
    for name in {"ft.csv", "stage.csv", *changes}:
        lines = (logs / name).read_text().splitlines() if (logs / name).is_file() else []
        (tmp_path / name).write_text("\n".join(changes.get(name, list)(lines)))
    (tmp_path / "mapping.yaml").write_text(mapping)
    with pytest.raises((ImportingError, TableError), match=said) as error:
        import_logs(tmp_path / "mapping.yaml", "s1")
    assert "\n" not in str(error.value)


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


def test_the_documented_mapping_and_the_layouts_of_makers_are_read(tmp_path):
    # The documented mapping is short and valid
    page = (Path(__file__).parents[2] / "docs" / "importing.md").read_text(encoding="utf-8")
    block = page.split("    describes:")[1].split("\n\n")[0]
    lines = ("    describes:" + block).splitlines()
    assert len(lines) <= 15  # the number, force, stage and video together
    (tmp_path / "mapping.yaml").write_text("\n".join(line[4:] for line in lines))
    assert load_import(tmp_path / "mapping.yaml").camera.video == "film.avi"

    # Layouts of makers. Semicolons and decimal commas, lines above the header, a line of units, dates, milliseconds
    # of a day
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
