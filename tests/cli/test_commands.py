"""The command line: arguments, plain errors, and a new study from `init` to `check`."""

import argparse

import pytest

from gelforge.cli import main
from gelforge.cli.values import depth_list
from gelforge.config import load_study
from gelforge.indentation.cells.cell_file import read_cell
from gelforge.mismatch.pipeline.stage import check_matches


@pytest.fixture
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("text", "depths"),
    [
        ("0.25:2:0.25", [0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0]),
        ("0.1:0.3:0.1", [0.1, 0.2, 0.3]),  # 3 * 0.1 > 0.3 in floating point, the last depth must not get lost
        ("0.5,1,1.5", [0.5, 1.0, 1.5]),
        ("1", [1.0]),
    ],
)
def test_depths(text, depths):
    assert depth_list(text) == depths


@pytest.mark.parametrize("text", ["1:2", "2,1", "0:1:0.5", "a", "1:2:0", "1,1", ""])
def test_depths_that_make_no_path_are_refused(text):
    with pytest.raises(argparse.ArgumentTypeError):
        depth_list(text)


def test_errors_of_ours_are_one_plain_message_before_time_is_spent(empty_folder, capsys):
    # Errors of ours are one plain message unless debugged
    assert main(["check", "config/nothing.yaml"]) == 1
    printed = capsys.readouterr().err
    assert printed == "gelforge: config/nothing.yaml: no such file; name a YAML file that exists\n"

    # Debug shows where an error arose
    with pytest.raises(ValueError, match="no such file"):
        main(["check", "config/nothing.yaml", "--debug"])

    # What is outside or not planned is refused before time is spent
    assert main(["press", "--x", "40", "--y", "16", "--depths", "1"]) == 1
    assert "lies outside the sensor" in capsys.readouterr().err

    # Simulate refuses a cell that is not planned
    main(["init", "mine"])
    arguments = ["--study", "config/mine.yaml", "--cell", "x9", "--laws", "law.json", "--out", "x9.h5"]
    assert main(["simulate", *arguments]) == 1
    assert "'x9' is not in the plan" in capsys.readouterr().err


def test_a_new_study_is_valid_and_its_missing_data_are_named(empty_folder, capsys):
    assert main(["init", "mine"]) == 0
    capsys.readouterr()
    assert main(["check", "mine"]) == 0
    printed = capsys.readouterr().out
    for name in ("uniaxial_01.csv", "indentations.csv", "reference.png", "images"):
        assert f"{name}\n" in printed
    assert "2 positions, 4 presses" in printed
    assert (
        "gel: no constitutive model yet, it is fitted by snakemake results/mine/materials/gel/law.json"
        in printed
    )
    assert "ball of radius 5 mm: 10 x 10 x 10 mm" in printed
    assert (empty_folder / "results/mine/check.png").stat().st_size > 10_000
    study = load_study("config/mine.yaml")
    assert study.sensor.height_mm == 6.0
    check_matches([empty_folder / "data/mine/recordings/session1"], study)  # its indenter is its own


def test_init_replaces_nothing(empty_folder, capsys):
    assert main(["init", "mine"]) == 0
    (empty_folder / "data/mine/plan.csv").write_text("my own")
    assert main(["init", "mine"]) == 1
    assert (empty_folder / "data/mine/plan.csv").read_text() == "my own"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("nx: 20", "nxx: 20", ["sensor.bins.nxx", "unknown key"]),
        ("wall_mm: 1.5", "wall_mm: 16", ["wall_mm 16", "thinner"]),
        ("thickness_mm: 1.5", "thickness_mm: -1", ["thickness_mm", "-1", "greater than 0"]),
    ],
)
def test_check_names_key_value_and_limit(empty_folder, capsys, old, new, words):
    main(["init", "mine"])
    path = empty_folder / "data/mine/sensor.yaml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    capsys.readouterr()
    assert main(["check", "mine"]) == 1
    printed = capsys.readouterr().err
    for word in words:
        assert word in printed


def test_press_prints_forces_and_writes_the_cell(empty_folder, capsys):
    """A coarse mesh: the numbers are those of any press (downward, growing with depth), not accurate ones."""
    main(["init", "mine"])
    path = empty_folder / "config/mine.yaml"
    given = "    parameters:\n      mu_kPa: [7.9652, 0.3093]\n      alpha: [1.2769, 3.5676]\n"
    tests = "    tests: data/mine/materials/gel # raw tests, to be fitted\n"
    assert tests in path.read_text()
    mesh = "\nmechanics: {mesh: {near_mm: 1.5, near_radius_mm: 2.5, far_mm: 3.0}}\n"
    written = "".join(line for line in path.read_text().splitlines(True) if "laws: [" not in line)
    path.write_text(written.replace(tests, given) + mesh)
    capsys.readouterr()
    at = ["--x", "16", "--y", "16", "--depths", "0.5,1"]
    assert main(["press", *at, "--study", "config/mine.yaml", "--out", "press.h5"]) == 0
    printed = capsys.readouterr().out
    assert "Fz [N]" in printed and "…" not in printed  # nothing is cut off in 80 columns
    vertical = read_cell("press.h5").arrays["total_force_N"][:, 2]
    assert 0 > vertical[0] > vertical[1]
    assert main(["show", "press.h5", "0"]) == 0
    assert (empty_folder / "press-0.png").is_file()


def test_verify_writes_its_table_and_fails_with_a_failed_check(empty_folder, capsys, monkeypatch):
    from gelforge.verification import run
    from gelforge.verification.check import relative

    checks = {"good": lambda: [relative("force", "known", 2.0, 2.01, 0.02)]}
    monkeypatch.setattr(run, "CHECKS", checks)
    assert main(["verify", "--out", "tables"]) == 0
    checks["bad"] = lambda: [relative("moment", "known", 2.0, 2.3, 0.02)]
    assert main(["verify", "--out", "tables"]) == 1
    assert "1 of 2 checks failed: moment (error 1.5e-01, limit 2.0e-02)" in capsys.readouterr().err
    assert main(["verify", "--only", "good"]) == 0
    assert main(["verify", "--only", "god"]) == 1
    assert "--only god: the checks are good, bad" in capsys.readouterr().err
    rows = (empty_folder / "tables" / "verification.csv").read_text().splitlines()
    assert [row.split(",")[-2] for row in rows] == ["passed", "True", "False"]  # then the checksum
    assert (empty_folder / "tables" / "verification.md").is_file()


def test_a_check_names_everything_that_is_wrong_and_calls_nothing_valid_that_is_incomplete(
    empty_folder, capsys
):
    assert main(["init", "mine"]) == 0
    capsys.readouterr()
    assert main(["check", "mine"]) == 0
    assert "config/mine.yaml: incomplete, " in capsys.readouterr().out
    config = empty_folder / "config" / "mine.yaml"
    config.write_text(config.read_text().replace("seed: 1", "seed: one\nsede: 2"))
    assert main(["check", "mine"]) == 1
    printed = capsys.readouterr().err
    assert "seed, found 'one'" in printed and "sede, found 2: unknown key; did you mean seed?" in printed
