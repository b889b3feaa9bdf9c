"""A session that is imported enters its study: the list of sessions, and the plan; comments stay."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from raw_logs import MAPPING, Lab, generate

from gelforge.cli import main
from gelforge.cli.study.add_session import with_session
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
    (folder / "logs.yaml").write_text(MAPPING)
    return folder


@pytest.fixture
def mine(tmp_path, monkeypatch, logs):
    """A folder with a study `mine` and the raw logs."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(logs, tmp_path / "data/mine/raw")
    Path("config").mkdir()

    def written(plan):
        Path("config/mine.yaml").write_text(STUDY.replace("PLAN", plan))

    return written


def imported(name="monday", *arguments):
    out = f"data/mine/recordings/{name}"
    return main(
        ["import", "data/mine/raw/logs.yaml", "--out", out, "--study", "config/mine.yaml", *arguments]
    )


def test_a_plan_from_sessions_needs_no_more_than_the_name(mine, capsys):
    mine("{from: sessions}")
    assert imported() == 0
    assert "monday added to sessions" in capsys.readouterr().out
    assert Path("config/mine.yaml").read_text() == STUDY.replace("PLAN", "{from: sessions}").replace(
        "[]", "[monday]"
    )
    study = load_study("config/mine.yaml")
    session = yaml.safe_load(Path("data/mine/recordings/monday/session.yaml").read_text())
    assert session["stage_to_sensor"]["repeatability_mm"] == pytest.approx(SCATTER_MM, rel=0.6)
    assert len(plan_cells(study)) == 6  # raw_logs presses at six positions
    assert main(["check", "config/mine.yaml"]) == 0
    said = capsys.readouterr().out
    assert "monday: 9 presses" in said and "6 of the plan's 6 positions" in said
    assert "split      2 of 6 sites are held out" in said


def test_a_plan_file_is_extended_and_keeps_what_it_says(mine, capsys):
    mine("{file: data/mine/plan.csv}")
    plan = Path("data/mine/plan.csv")
    before = "# by hand\ncell,note,x_mm,y_mm,depth_mm\nfirst,the first,10.01,12.0,0.4\nunused,,30,30,0.4\n"
    plan.write_text(before)
    assert imported() == 0
    said = capsys.readouterr().out
    assert plan.read_text().startswith(before)
    cells = plan_cells(load_study("config/mine.yaml"))
    assert (cells["first"].x_mm, cells["first"].y_mm) == (10.01, 12.0)
    assert list(cells)[:3] == ["first", "unused", "monday_0000"] and len(cells) == 7
    assert "5 of these sites new" in said and "not joined" not in said
    again = plan.read_text()
    assert main(["check", "config/mine.yaml"]) == 0
    assert plan.read_text() == again


def test_positions_beside_a_grid_say_what_to_write(mine, capsys):
    mine("{grid: {spacing_mm: 6.0}, depths_mm: [0.4, 0.8, 1.2]}")
    assert imported() == 0
    said = capsys.readouterr().out
    assert "not joined" in said and "replace `plan` by  plan: {from: sessions}" in said


def test_a_session_beside_the_study_is_reported_and_another_folder_is_refused(mine, capsys):
    mine("{from: sessions}")
    assert imported() == 0
    shutil.copytree("data/mine/recordings/monday", "data/mine/recordings/tuesday")
    capsys.readouterr()
    assert main(["check", "config/mine.yaml"]) == 0
    said = capsys.readouterr().out
    assert "not named  tuesday in data/mine/recordings" in said and "sessions: [monday, tuesday]" in said
    text = Path("config/mine.yaml").read_text()
    Path("config/mine.yaml").write_text(text.replace("[monday]", "[monday, tuesday]"))
    session = Path("data/mine/recordings/tuesday/session.yaml")
    session.write_text(session.read_text().replace("session: monday", "session: tuesday"))
    assert main(["check", "config/mine.yaml"]) == 1
    assert "sessions monday and tuesday hold the same recording" in capsys.readouterr().err
    assert (
        main(["import", "data/mine/raw/logs.yaml", "--out", "elsewhere", "--study", "config/mine.yaml"]) == 1
    )
    assert "use --out data/mine/recordings/elsewhere" in capsys.readouterr().err
    assert not Path("elsewhere").exists()


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
