"""A session that is imported enters its study: the list of sessions, and the plan; comments stay."""

import contextlib
import io
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from raw_logs import MAPPING, Lab, generate

from gelforge.cli import main
from gelforge.cli.study.add_session import add_session, unjoined, with_session
from gelforge.cli.study.split_and_sessions import print_unnamed
from gelforge.config import load_study
from gelforge.indentation.planning.plan import plan_cells

SCATTER_MM = 0.015
STUDY = """\
study: mine # the first
materials: {soft: {parameters: {mu_kPa: [8.0], alpha: [2.0]}}}
sensor:
  layers: [{name: gel, thickness_mm: 6.0, material: soft}]
plan: PLAN
sessions: [] # none yet
dataset: {test_fraction: 0.3}
"""


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Raw logs of a robot whose positions scatter, and their mapping."""
    folder = tmp_path_factory.mktemp("logs")

    def scattered(table):
        rng = np.random.default_rng(1)
        for axis in "XY":
            press = (table[axis].diff().abs() > 500).cumsum()
            table[axis] += 1e3 * rng.normal(0, SCATTER_MM, press.max() + 1)[press]
        return table

    generate(folder, Lab(presses=9, fault={"stage": scattered}), seed=3)
    stage = (
        "session: {stage_to_sensor: {repeatability_mm: null}, "  # as `gelforge init` writes it: to be found
    )
    (folder / "logs.yaml").write_text(MAPPING.replace("session: {", stage))
    return folder


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, logs):
    """What `gelforge import --study` said and left of a study whose plan is what was pressed."""
    folder = tmp_path_factory.mktemp("recorded")
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()) as said:
        write_study(logs, "{from: sessions}")
        assert imported() == 0
    return folder, said.getvalue()


@pytest.fixture
def mine(tmp_path, monkeypatch, logs, recorded):
    """A folder with a study `mine` and a session `monday` that has been imported without it."""
    monkeypatch.chdir(tmp_path)

    def written(plan, text=STUDY):
        write_study(logs, plan, text)
        shutil.copytree(recorded[0] / "data/mine/recordings", "data/mine/recordings")
        return Path("config/mine.yaml")

    return written


def write_study(logs, plan, text=STUDY):
    shutil.copytree(logs, "data/mine/raw")
    Path("config").mkdir()
    Path("config/mine.yaml").write_text(text.replace("PLAN", plan))


def imported(out="data/mine/recordings/monday"):
    return main(["import", "data/mine/raw/logs.yaml", "--out", out, "--study", "config/mine.yaml"])


def test_a_plan_from_sessions_needs_no_more_than_the_name(recorded, monkeypatch, capsys):
    folder, said = recorded
    monkeypatch.chdir(folder)
    assert "monday added to sessions" in said and "not joined" not in said
    expected = STUDY.replace("PLAN", "{from: sessions}").replace("[]", "[monday]")
    assert Path("config/mine.yaml").read_text() == expected
    session = yaml.safe_load(Path("data/mine/recordings/monday/session.yaml").read_text())
    assert session["stage_to_sensor"]["repeatability_mm"] == pytest.approx(SCATTER_MM, rel=0.6)
    assert len(plan_cells(load_study("config/mine.yaml"))) == 6  # raw_logs presses at six positions
    assert main(["check", "config/mine.yaml"]) == 0
    said = capsys.readouterr().out
    assert "monday: 9 presses" in said and "6 of the plan's 6 positions" in said
    assert "split      2 of 6 sites are held out" in said


def test_a_plan_file_is_extended_and_keeps_what_it_says(mine):
    study = mine("{file: data/mine/plan.csv}")
    plan = Path("data/mine/plan.csv")
    before = "# by hand\ncell,note,x_mm,y_mm,depth_mm\nfirst,the first,10.01,12.0,0.4\nunused,,30,30,0.4\n"
    plan.write_text(before)
    said = "\n".join(add_session(study, "monday"))
    assert plan.read_text().startswith(before)
    cells = plan_cells(load_study(study))
    assert (cells["first"].x_mm, cells["first"].y_mm) == (10.01, 12.0)
    assert list(cells)[:3] == ["first", "unused", "monday_0000"] and len(cells) == 7
    assert "5 of these sites new" in said and unjoined(study, Path("data/mine/recordings/monday")) == []
    assert "has every position and depth of monday" in "\n".join(add_session(study, "monday"))
    plan.unlink()
    add_session(study, "monday")
    assert len(plan_cells(load_study(study))) == 6


def test_a_plan_file_in_another_unit_keeps_it(mine):
    study = mine("{file: data/mine/plan.csv, mm_per_unit: 1000}")
    Path("data/mine/plan.csv").write_text("cell;x_mm;y_mm;depth_mm\nunused;0,03;0,03;0,0004\n")
    add_session(study, "monday")
    assert unjoined(study, Path("data/mine/recordings/monday")) == []
    assert len(plan_cells(load_study(study))) == 7


def test_positions_beside_a_grid_say_what_to_write(mine):
    study = mine("{grid: {spacing_mm: 6.0}, depths_mm: [0.4, 0.8, 1.2]}")
    add_session(study, "monday")
    why, what = unjoined(study, Path("data/mine/recordings/monday"))
    assert "no planned site" in why and "replace the plan's grid by  from: sessions" in what


def test_a_list_that_is_no_plain_one_is_left_and_the_line_is_said(mine):
    study = mine("{from: sessions}", STUDY.replace("sessions: []", "sessions: &none\n  []"))
    before = study.read_text()
    assert add_session(study, "monday") == [
        "study      config/mine.yaml: add monday to its sessions, the line is  sessions: [monday]"
    ]
    assert study.read_text() == before


def test_a_session_beside_the_study_is_reported_and_a_copy_is_refused(mine, capsys):
    study = mine("{from: sessions}")
    add_session(study, "monday")
    shutil.copytree("data/mine/recordings/monday", "data/mine/recordings/tuesday")
    described = load_study(study)
    print_unnamed(described)
    said = capsys.readouterr().out
    assert "not named  tuesday in data/mine/recordings" in said and "sessions: [monday, tuesday]" in said
    study.write_text(study.read_text().replace("[monday]", "[monday, tuesday]"))
    session = Path("data/mine/recordings/tuesday/session.yaml")
    session.write_text(session.read_text().replace("session: monday", "session: tuesday"))
    assert main(["check", "config/mine.yaml"]) == 1
    assert "sessions monday and tuesday hold the same recording" in capsys.readouterr().err


def test_another_folder_and_another_frame_are_refused_before_anything_is_written(mine, capsys):
    mine("{from: sessions}")
    assert imported("elsewhere") == 1
    assert "use --out data/mine/recordings/elsewhere" in capsys.readouterr().err
    mapping = Path("data/mine/raw/logs.yaml")
    mapping.write_text(mapping.read_text().replace("repeatability_mm: null", "origin_mm: [-400, 0]"))
    assert imported("data/mine/recordings/tuesday") == 1
    assert "are they in the robot's frame" in capsys.readouterr().err
    assert sorted(path.name for path in Path("data/mine/recordings").iterdir()) == ["monday"]
    assert "[] # none yet" in Path("config/mine.yaml").read_text()


@pytest.mark.parametrize(
    ("text", "names", "expected"),
    [
        ("a: 1\nsessions: [] # none\nb: 2\n", ["new"], "a: 1\nsessions: [new] # none\nb: 2\n"),
        ("sessions: [one]\n", ["one", "new"], "sessions: [one, new]\n"),
        ("sessions:\n  - one # kept\nb: 2\n", ["one", "new"], "sessions:\n  - one # kept\n  - new\nb: 2\n"),
        ("sessions:\n- one\n", ["one", "new"], "sessions:\n- one\n- new\n"),
        ("a: 1\n", ["new"], "a: 1\n\nsessions: [new]\n"),
        ("sessions: &all [\n  one]\n", ["one", "new"], None),
        ("sessions: null\n", ["new"], None),
    ],
)
def test_the_list_of_sessions_is_changed_as_it_is_written(text, names, expected):
    assert with_session(text, names) == expected
