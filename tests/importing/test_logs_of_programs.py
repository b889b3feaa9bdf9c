"""Logs as other programs write them, and clocks that go wrong: read by a declared key, or refused by the cause."""

from dataclasses import replace
from io import StringIO

import cv2
import numpy as np
import pandas as pd
import pytest
from PIL import Image
from raw_logs import MAPPING, Lab, generate

from gelforge.config import ConfigError
from gelforge.config.foreign.importing import Stamp, load_import
from gelforge.csv_table import TableError
from gelforge.importing.importer import import_logs
from gelforge.importing.refusals import ImportingError
from gelforge.importing.streams import read_force, read_stage
from gelforge.recording.imaging.frames import frames, images_in
from gelforge.recording.imaging.images import image_size
from gelforge.recording.tables.checks import RecordingError

LAB = Lab(presses=3)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    generate(folder, LAB)
    return folder


@pytest.fixture
def read(logs, tmp_path):
    """Return a function that reads both logs of a folder where ft.csv has another content and the mapping other lines."""

    def run(ft=None, *changes, stage=None):
        for name, text in (("ft.csv", ft), ("stage.csv", stage)):
            (tmp_path / name).write_text((logs / name).read_text() if text is None else text)
        mapping = MAPPING
        for old, new in changes:
            assert old in mapping
            mapping = mapping.replace(old, new)
        (tmp_path / "mapping.yaml").write_text(mapping)
        found = load_import(tmp_path / "mapping.yaml")
        return read_force(tmp_path, found.force, found.stage), read_stage(tmp_path, found.stage, found.force)

    return run


TIME = "time: {column: Time, unit: s}"
ATI = "Start Time:,3/14/2024 2:05:01 PM\nForce Units:,{unit}\nCounts per Unit Force:,{counts}\nCounts per Unit Torque:,7\n"


def counted(logs, counts, above=""):
    table = pd.read_csv(logs / "ft.csv")
    forces = (table[["Fx", "Fy", "Fz"]] * counts).round().astype(int)
    return above + pd.concat([table[["Time"]], forces], axis=1).to_csv(index=False)


@pytest.mark.parametrize("counts", [1000, 1000000, 222411])
def test_counts_are_forces_by_the_line_above_or_the_key(logs, read, counts):
    true = read()[0]
    above = ATI.format(unit="N", counts=counts)
    for force in (
        read(counted(logs, counts, above))[0],
        read(counted(logs, counts), ("unit: N\nstage", f"unit: N\n  counts_per_unit: {counts}\nstage"))[0],
    ):
        np.testing.assert_allclose(force.values, true.values, atol=0.6 / counts)


def test_forces_below_such_lines_are_no_counts_and_another_unit_is_refused(logs, read):
    above = ATI.format(unit="N", counts=1000)
    text = (logs / "ft.csv").read_text()
    np.testing.assert_array_equal(read(above + text)[0].values, read()[0].values)
    with pytest.raises(ImportingError, match=r"'Force Units:,lbf', force\.unit says N; set force\.unit: lbf"):
        read(counted(logs, 1000, ATI.format(unit="lbf", counts=1000)))


@pytest.mark.parametrize(
    "line",
    [
        "Counts/N:,1000",
        'Counts per Unit Force: "1,000"',
        "CpF=1000 CpT=50",
        *(
            f"Counts/N:,1000\nCounts/{torque}:,50000"
            for torque in ("Nm", "N-m", "N mm", "N·m", "unit Torque")
        ),
    ],
)
def test_counts_above_the_header_agree_with_the_key(logs, read, line):
    text = counted(logs, 1000, line + "\n")
    np.testing.assert_allclose(read(text)[0].values, read()[0].values, atol=6e-4)
    key = ("unit: N\nstage", "unit: N\n  counts_per_unit: 500\nstage")
    with pytest.raises(
        ImportingError, match="1000 counts to one N stand above the header, force.counts_per_unit is 500"
    ):
        read(text, key)


def both_logs(logs):
    force, stage = pd.read_csv(logs / "ft.csv"), pd.read_csv(logs / "stage.csv")
    stage = stage.assign(Time=stage.pop("t_ms") / 1e3)
    both = pd.concat([force.assign(Time=force["Time"] + LAB.stage_epoch_s * 0), stage]).sort_values(
        "Time", kind="stable"
    )
    return both[["Time", "Fx", "Fy", "Fz", "X", "Y", "Z"]].to_csv(index=False)


STAGE = ("file: stage.csv\n  time: {column: t_ms, unit: ms}", "file: ft.csv\n  time: {column: Time, unit: s}")


@pytest.mark.parametrize("nothing", ["", "nan", "N/A"])
def test_a_table_of_several_topics_has_rows_without_the_others(logs, read, nothing):
    force, stage = read()
    both = read(pd.read_csv(StringIO(both_logs(logs))).to_csv(index=False, na_rep=nothing), STAGE)
    for one, other in zip((force, stage), both):
        np.testing.assert_allclose(one.values, other.values)
        np.testing.assert_allclose(one.time_s, other.time_s, atol=2e-6)


def test_a_row_that_lacks_values_and_a_date_of_another_form_are_refused(logs, read):
    # A row that lacks values is refused. Dropped, it would move all readings after it
    counted = ("file: stage.csv\n  time: {column: t_ms, unit: ms}", "file: ft.csv\n  rate_hz: 100")
    with pytest.raises(TableError, match="X is nothing"):
        read(both_logs(logs), counted)

    # A row with a part of the values is refused
    lines = both_logs(logs).splitlines()
    k = next(i for i, line in enumerate(lines) if i > 50 and line.split(",")[1])
    cells = lines[k].split(",")
    lines[k] = ",".join([cells[0], "", *cells[2:]])
    with pytest.raises(TableError, match=rf"row {k + 1}: Fx is nothing"):
        read("\n".join(lines), STAGE)

    # A date of another form names the key and the form
    ft = "\n".join(["Time,Fx,Fy,Fz", *stamped(logs, date("%m/%d/%Y %I:%M:%S.%f %p"))])
    with pytest.raises(
        ImportingError, match=r"no date .* set force\.time\.format \('%m/%d/%Y %I:%M:%S\.%f %p' fits\)"
    ):
        read(ft, (TIME, "time: {column: Time, unit: iso}"))
    with pytest.raises(ImportingError, match=r"row 2: .*not of the format '%d\.%m\.%Y'"):
        read(ft, (TIME, "time: {column: Time, format: '%d.%m.%Y'}"))


def stamped(logs, text):
    """Return ft.csv with other stamps: text gives the cells of a time stamp of the clock."""
    table = pd.read_csv(logs / "ft.csv")
    lines = [f"{text(t)},{a},{b},{c}" for t, a, b, c in table.to_numpy()]
    return lines


DAY = np.datetime64("2024-03-14T23:59:30")


def date(form):
    return lambda t: (DAY + np.timedelta64(round(t * 1e6), "us")).astype(object).strftime(form)


@pytest.mark.parametrize(
    ("header", "text", "stamp"),
    [
        ("Time", date("%m/%d/%Y %I:%M:%S.%f %p"), {"column": "Time", "format": "%m/%d/%Y %I:%M:%S.%f %p"}),
        ("Time", date("%d.%m.%Y %H:%M:%S.%f"), {"column": "Time", "format": "%d.%m.%Y %H:%M:%S.%f"}),
        ("Date,Clock", date("%Y-%m-%d,%H:%M:%S.%f"), {"column": ["Date", "Clock"], "unit": "iso"}),
        (
            "Date,Clock",
            date("%d/%m/%y,%H:%M:%S.%f"),
            {"column": ["Date", "Clock"], "format": "%d/%m/%y %H:%M:%S.%f"},
        ),
        (
            "secs,nsecs",
            lambda t: f"{1700000000 + int(t)},{round(t % 1 * 1e9)}",
            {"column": ["secs", "nsecs"], "unit": ["s", "ns"]},
        ),
        (
            "Clock",
            lambda t: f"{int(t + 3500) // 60}:{(t + 3500) % 60:09.6f}",
            {"column": "Clock", "unit": "h:mm:ss"},
        ),
        ("Time", lambda t: f"{1.7e9 + t:.6f}", {"column": "Time", "unit": "s"}),
    ],
)
def test_stamps_as_dates_in_two_columns_and_of_a_clock(logs, read, header, text, stamp):
    ft = "\n".join([f"{header},Fx,Fy,Fz", *stamped(logs, text)])
    force = read(ft, (TIME, f"time: {stamp}"))[0]
    np.testing.assert_allclose(force.time_s, read()[0].time_s, atol=3e-6)


@pytest.mark.parametrize("header", ["Clock (s)", "Clock [min]"])
def test_a_time_of_day_under_a_header_with_a_unit(logs, read, header):
    text = stamped(logs, lambda t: f"{int(t + 3500) // 60}:{(t + 3500) % 60:09.6f}")
    ft = "\n".join([f"{header},Fx,Fy,Fz", *text])
    force = read(ft, (TIME, f"time: {{column: '{header}', unit: 'h:mm:ss'}}"))[0]
    np.testing.assert_allclose(force.time_s, read()[0].time_s, atol=3e-6)
    other = "\n".join(["Clock (N),Fx,Fy,Fz", *text])
    with pytest.raises(ImportingError, match=r"says N, force\.time\.unit says h:mm:ss"):
        read(other, (TIME, "time: {column: Clock (N), unit: 'h:mm:ss'}"))


@pytest.mark.parametrize(
    "keys",
    [
        {"column": ["a", "b", "c"], "unit": "iso"},
        {"column": ["a", "b"], "unit": "s"},
        {"column": "a", "unit": "s", "format": "%Y"},
        {"column": "a", "unit": "N"},
    ],
)
def test_stamps_that_say_too_much_or_too_little(keys):
    with pytest.raises((ConfigError, ValueError)):
        Stamp(**keys)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (lambda t: f"{1.7e9 + t:g}", "significant digits"),
        (lambda t: f"{1.7e9 + t:.7g}", "significant digits, too few for 1700000000"),
        (lambda t: f"{1.7e9 + t:.9g}", "9 significant digits"),
        (lambda t: f"{1e3 * (1.7e9 + t):.5E}", "significant digits"),
        (lambda t: f"{float(np.float32(1.70012345e9 + t)):.1f}", "single precision"),
        (lambda t: f"{3e5 + t:g}", "6 significant digits"),
        (lambda t: f"{1.7e9 + t:.0f}", "a clock with steps of 1 s"),
        (lambda t: "0", "all rows have one time"),
        (lambda t: f"{t - 0.4 * (t > 12):.6f}", r"runs back by 0\.\d+ s, .* the clock was set there"),
    ],
)
def test_stamps_without_their_digits_are_named(logs, read, text, said):
    with pytest.raises(ImportingError, match=said):
        read("\n".join(["Time,Fx,Fy,Fz", *stamped(logs, text)]))


def later(name, at, by):
    return lambda table: table.assign(**{name: table[name] + by * (table[name] > at)})


BY_RATE = {
    "stage": ("time: {column: t_ms, unit: ms}", f"rate_hz: {LAB.stage_hz}"),
    "force": ("time: {column: Time, unit: s}", f"rate_hz: {LAB.force_hz}"),
    "wrong": ("time: {column: t_ms, unit: ms}", f"rate_hz: {0.98 * LAB.stage_hz}"),
}
JUMPS = {
    "force clock steps": (
        {"force": later("Time", 20.0, 0.25)},
        None,
        r"its lag jumps .* the clock of force steps by 0\.25\d* s at.* split the session",
    ),
    "stage clock steps": (
        {"stage": later("t_ms", 20e3, 250.0)},
        None,
        r"its lag jumps .* the stage's clock steps by 0\.25\d* s at.* split the session",
    ),
    "stage by rate lost rows": (
        {"stage": lambda table: table.drop(range(620, 631))},
        "stage",
        r"its lag jumps .* rows of the stage's log were dropped; .*stage.time",
    ),
    "force by rate lost rows": (
        {"force": lambda table: table.drop(range(4220, 4290))},
        "force",
        r"its lag jumps .* rows were dropped; .*force.time",
    ),
    "wrong rate": (None, "wrong", r"rows of the stage's log were dropped, or a rate is wrong by 0\.02"),
}


@pytest.mark.parametrize(("fault", "rate", "said"), JUMPS.values(), ids=JUMPS)
def test_a_lag_that_jumps_is_told_with_its_cause(tmp_path, fault, rate, said):
    generate(tmp_path, replace(LAB, presses=8, fault=fault or {}))
    (tmp_path / "mapping.yaml").write_text(MAPPING.replace(*BY_RATE[rate]) if rate else MAPPING)
    with pytest.raises(ImportingError, match=said):
        import_logs(tmp_path / "mapping.yaml", "s1")


def picture(path, level=90, turned=None):
    image = Image.fromarray(np.full((20, 30), level, np.uint8))
    exif = Image.Exif()
    if turned is not None:
        exif[0x0112] = turned
    image.save(path, exif=exif)


def test_frames_are_in_the_order_of_their_numbers(tmp_path):
    # Frames are sorted by their numbers
    for k in range(1, 13):
        picture(tmp_path / f"frame_{k}.png", 10 * k)
    assert [int(frame.image[0, 0]) for frame in frames(tmp_path)] == [10 * k for k in range(1, 13)]

    # Numbers after a point count on or are fractions
    for folder, names in (
        ("counted", [f"cam1.{k}" for k in range(1, 13)]),
        ("fractions", ["t0.5", "t1", "t1.125", "t1.25", "t1.5", "t2.0"]),
        ("both", [f"cam{c}.{k}" for c in (1, 2) for k in (2, 9, 10, 20)]),
        ("every second", [f"cam1.{k}" for k in range(1, 20, 2)]),
        ("padded", [f"t1.{k:02d}" for k in range(1, 21)]),
        ("some lost", ["cam1.9", "cam1.11", "cam1.12", "cam1.14"]),
        ("hundredths", [f"t0.{k:02d}".rstrip("0") for k in range(1, 13)]),
    ):
        (tmp_path / folder).mkdir()
        for name in names:
            picture(tmp_path / folder / f"{name}.png")
        assert [path.stem for path in images_in(tmp_path / folder)] == names

    # Unpadded frames of an import are in their order
    unpadded = tmp_path / "unpadded"
    unpadded.mkdir()
    from gelforge.config.foreign.importing import CameraSource
    from gelforge.importing.camera import read_film

    for k in range(1, 31):
        cv2.imwrite(str(unpadded / f"f{k}.png"), np.full((20, 30), 3 * k, np.uint8))
    film = read_film(unpadded, CameraSource(frames=".", rate_hz=10))
    assert film.names == [f"f{k}.png" for k in range(1, 31)] and (np.diff(film.change) > 0).all()
    named = CameraSource(frames=".", from_name=r"f(\d+)", name_unit="s")
    np.testing.assert_allclose(read_film(unpadded, named).time_s, np.arange(30))
    picture(unpadded / "f31.jpg", turned=6)
    with pytest.raises(RecordingError, match=r"f31\.jpg: EXIF orientation 6"):
        read_film(unpadded, named)


@pytest.mark.parametrize("suffix", ["jpg", "tif", "png"])
@pytest.mark.parametrize("turned", [3, 6, 8])
def test_an_exif_orientation_is_refused_by_name(tmp_path, suffix, turned):
    picture(tmp_path / f"a.{suffix}", turned=turned)
    with pytest.raises(RecordingError, match=rf"a\.{suffix}: EXIF orientation {turned}, .* upright"):
        image_size(tmp_path / f"a.{suffix}")
    for upright in (None, 1):
        picture(tmp_path / f"b.{suffix}", turned=upright)
        assert image_size(tmp_path / f"b.{suffix}") == (30, 20)
