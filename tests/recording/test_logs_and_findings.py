"""The force log's stamps, and the findings: of a plan, through their file, one line a test."""

from dataclasses import replace

import numpy as np
import pytest
from generated_sessions import FORCE, Kind, generate
from numpy.testing import assert_allclose

from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.recording.plausibility.findings import (
    Finding,
    Findings,
    collect,
    read_findings,
    write_findings,
)
from gelforge.recording.plausibility.streams import read_force_log, spread_stamps
from gelforge.recording.readings import read_recording
from gelforge.recording.tables.checks import RecordingError


# ------------------------------------------------------------------------------------------------- ft.csv
def test_equal_stamps_of_a_coarse_clock_are_spread(tmp_path):
    def coarse(log, rng):
        return log.assign(time_s=np.floor(log["time_s"] * 100 + 1e-6) / 100)

    kind = Kind(log_s=0.005, sites=[(16, 16)])
    honest = read_recording(generate(tmp_path / "true", kind)).readings
    folder = generate(tmp_path / "s", replace(kind, fault={"log": coarse}))
    log = read_force_log(folder / "ft.csv")
    assert_allclose(np.diff(log.time_s), 0.005, atol=1e-9)
    found = read_recording(folder)
    assert found.findings.lines() == []
    assert_allclose(found.readings[FORCE], honest[FORCE], atol=1e-12)

    # A gap is no room for samples of one stamp
    time = spread_stamps(np.array([0.0, 1.0, 1.1]), np.array([2, 1, 1]), 0.1)
    assert_allclose(time, [0.0, 0.05, 1.0, 1.1])


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda log, rng: log.assign(time_s=np.floor(log["time_s"])), r"samples share the stamp 0 s .* 1 s"),
        (lambda log, rng: log.iloc[::-1], r"runs back; sort the rows by time_s"),
        (lambda log, rng: log[log["time_s"] < 60], r"no force sample within 1\.0 s of the reading"),
    ],
)
def test_a_log_that_cannot_be_read_is_named(tmp_path, edit, message):
    folder = generate(tmp_path / "s", Kind(log_s=0.01, fault={"log": edit}))
    with pytest.raises(RecordingError, match=message):
        read_recording(folder)


# ------------------------------------------------------------------------------------------- plan, findings
def test_findings_tell_of_the_plan_and_survive_their_file(tmp_path):
    # Fewer indentations than planned are information
    kind = Kind()
    cells = {
        f"c{k}": PlannedCell(f"c{k}", float(x), float(y), (0.4, 0.8, 1.2, 1.6))
        for k, (x, y) in enumerate(kind.sites)
    }
    findings = read_recording(generate(tmp_path / "s", kind), cells).findings
    (note,) = findings
    assert (note.level, note.value) == ("note", 5)
    assert "20 indentations at the sites visited, 5 of them not recorded: c" in note.found
    whole = {name: replace(cell, depths_mm=(0.4, 0.8, 1.2)) for name, cell in cells.items()}
    assert read_recording(tmp_path / "s", whole).findings.lines() == []

    # Findings survive their file and speak one line a test
    made = [
        Finding("gap", "excluded", "force", f"misses {k} s", "log", f"p{k}", 1.0 * k, k, 0.5, "s", (k,))
        for k in range(1, 6)
    ]
    findings = Findings("s", tuple(made))
    (line,) = findings.lines()
    assert line == (
        "indentation p5 at 5 s: force misses 5 s (limit 0.5 s); 5 indentations in all: p1, p2, p3, ...; "
        "force left out there; log"
    )
    write_findings(tmp_path / "f.csv", findings)
    again = read_findings(tmp_path / "f.csv")
    assert list(again["press"]) == [f"p{k}" for k in range(1, 6)]
    assert_allclose(again["value"], range(1, 6))
    write_findings(tmp_path / "none.csv", Findings("s"))
    assert read_findings(tmp_path / "none.csv").empty
    assert [f.level for f in collect("s", made, ["gap"])] == ["note"] * 5
    with pytest.raises(ValueError, match="takes rows out"):
        Finding("gap", "excluded", "plan", "", "")
