"""YAML files that cannot be meant: keys twice, truth values as numbers, aliases that grow, pipes and devices."""

import os
from pathlib import Path

import pytest

from gelforge.config import ConfigError, changed_study, load_session, load_study, study_from
from gelforge.config.foreign.mapping import Microindentation
from gelforge.config.studies.files import load_section
from gelforge.csv_table import TableError, read_csv
from gelforge.indentation.planning.plan import plan_cells

ROOT = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def in_repository(monkeypatch):
    monkeypatch.chdir(ROOT)


def study(tmp_path, change=lambda text: text):
    text = change(Path("config/test.yaml").read_text())
    (tmp_path / "study.yaml").write_text(text)
    return load_study(tmp_path / "study.yaml")


def refused(tmp_path, change) -> str:
    with pytest.raises(ConfigError) as error:
        study(tmp_path, change)
    message = str(error.value)
    assert "\n" not in message and len(message) < 2000
    return message


@pytest.mark.parametrize("word", ["true", "yes", "True", "on"])
def test_a_truth_value_is_no_number(tmp_path, word):
    said = refused(
        tmp_path, lambda text: text.replace("friction: 0.45", f"friction: {word}") + f"\nseed: {word}\n"
    )
    assert "seed" in said or "friction" in said
    assert "number" in said or "integer" in said or "stands twice" in said


def test_truth_values_of_python_are_no_numbers_and_changes_are_checked():
    # A truth value that python gives is no number either
    content = {**load_study("config/test.yaml").model_dump(mode="json"), "seed": True}
    with pytest.raises(ConfigError, match="seed: true or false where a number belongs"):
        study_from(content)
    content = {**content, "seed": 1}
    content["mechanics"] = {**content["mechanics"], "error_bars": False}
    assert study_from(content).mechanics.error_bars is False

    # Changes of a study are checked as a file is
    plain = load_study("config/test.yaml")
    whole = plain.model_dump(mode="json")
    whole["mechanics"]["friction"] = 0.2
    assert changed_study(plain, {"mechanics": {"friction": 0.2}}) == study_from(whole)
    for wrong, why in (
        (True, "true or false"),
        (1e13, "nothing is larger|less than"),
        (-1.0, "greater than"),
    ):
        with pytest.raises(ConfigError, match=why):
            changed_study(plain, {"mechanics": {"friction": wrong}})
    with pytest.raises(ConfigError, match="nothing is larger"):
        changed_study(plain, {"mechanics": {"effects": {"kinematics": {"contact_zero_mm": -1e-13}}}})


def session_file(tmp_path, text):
    (tmp_path / "session.yaml").write_text(text)
    return load_session(tmp_path / "session.yaml")


def test_values_are_read_as_written_without_double_keys_or_bombs(tmp_path):
    # Truth values dates and zeros are read as written
    for word in ("true", "yes", "True"):
        assert session_file(tmp_path, f"session: no\nsynthetic: {word}\ndate: 2026-01-02\n").synthetic is True
    read = session_file(tmp_path, "session: no\nsynthetic: no\ndate: 2026-01-02\nsensor_age_days: 010\n")
    assert (read.session, read.synthetic, read.date, read.sensor_age_days) == (
        "no",
        False,
        "2026-01-02",
        10.0,
    )
    with pytest.raises(ConfigError, match="sensor_age_days"):
        session_file(tmp_path, "session: a\nsensor_age_days: 1:30\n")
    assert session_file(tmp_path, "session: a\ntemperature_C: -1e1\n").temperature_C == -10.0

    # A key that stands twice is refused
    with pytest.raises(ConfigError, match=r"session.yaml, line 3: .*the key 'session' stands twice"):
        session_file(tmp_path, "session: a\nnotes: x\nsession: b\n")
    with pytest.raises(ConfigError, match="the key 'by' stands twice"):
        session_file(tmp_path, "session: a\ndepth_zero: {by: press, by: session}\n")
    both = session_file(tmp_path, "session: a\nforce: {tared: true}\ndepth_zero: {by: press}\nnotes: by\n")
    assert both.depth_zero.by == "press"

    # An alias is read and a bomb of them is not
    read = session_file(tmp_path, "session: a\nforce: {resolution_N: &r [1, 1, 1], range_N: *r}\n")
    assert read.force.range_N == [1.0, 1.0, 1.0]
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 9)]
    for text in ("\n".join(lines), "a: &a [*a]", "a: &a {b: *a}", "[" * 3000, "a: " + "{a: " * 3000):
        with pytest.raises(ConfigError) as error:
            session_file(tmp_path, text)
        assert len(str(error.value)) < 2000 and "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text", ["a: [1, 2", "\tx: 1", "a: !!python/object:x {}", "a: \x00", "? {a: b}\n: 1", "3", ""]
)
def test_what_is_no_yaml_is_one_line(tmp_path, text):
    with pytest.raises(ConfigError) as error:
        session_file(tmp_path, text)
    assert "\n" not in str(error.value) and "session.yaml" in str(error.value)


def test_pipes_and_huge_values_are_not_waited_for(tmp_path):
    # Pipes devices and folders are not waited for
    os.mkfifo(tmp_path / "pipe.yaml")
    for path in (tmp_path / "pipe.yaml", Path("/dev/zero"), tmp_path, tmp_path / "nowhere/pipe.yaml"):
        with pytest.raises(ConfigError, match="a pipe or a device|a folder|no such file"):
            load_section(path, Microindentation)
        with pytest.raises(TableError, match="a pipe or a device|a folder|no such file"):
            read_csv(path, numbers=["a"])

    # A huge value is reported in short
    assert "has at most" not in refused(tmp_path, lambda text: text + "\nnotes: [" + "x, " * 5000 + "x]\n")
    with pytest.raises(ConfigError, match="characters, at most"):
        session_file(tmp_path, "# " + "x" * 3_000_000)


def planned(tmp_path, rows, **plan):
    """Return the cells of a plan file of the test study, whose sensor is read from its own keys."""
    (tmp_path / "plan.csv").write_text("cell,x_mm,y_mm,depth_mm,phase,shear_x_mm\n" + "\n".join(rows) + "\n")
    content = load_study("config/test.yaml").model_dump(mode="json")
    content["plan"] = {"file": str(tmp_path / "plan.csv"), **plan}
    content["mechanics"]["mesh"]["near_mm"] = 1.0  # finer than what the lightest press touches
    return plan_cells(study_from(content))


def test_plans_with_two_cells_at_one_place_or_in_metres_are_asked_about(tmp_path):
    # Two cells at one place are refused and two paths are not
    with pytest.raises(ConfigError, match=r"sites a and b are both at \(8, 8\) mm"):
        planned(tmp_path, ["a,8,8,0.2,,", "b,8.004,8,0.4,,"])
    assert len(planned(tmp_path, ["a,8,8,0.2,,", "b,8.4,8,0.4,,"])) == 2
    left, right = ["a,8,8,0.4,load,0", "a,8,8,0.4,shear,-0.1"], ["b,8,8,0.4,load,0", "b,8,8,0.4,shear,0.1"]
    assert len(planned(tmp_path, [*left, *right])) == 2
    with pytest.raises(ConfigError, match="sites a and b follow the same path"):
        planned(tmp_path, [*left, *(row.replace("a,", "b,") for row in left)])

    # A plan in metres or inches is asked about
    metres = ["a,0.006,0.006,0.0004,,", "b,0.008,0.008,0.0004,,"]
    with pytest.raises(ConfigError, match="are these metres. `plan.mm_per_unit: 1000` reads metres"):
        planned(tmp_path, metres)
    assert planned(tmp_path, metres, mm_per_unit=1000)["b"].x_mm == pytest.approx(8)
    small = ["a,1.0,1.0,0.15,,", "b,1.2,1.2,0.15,,"]
    with pytest.raises(ConfigError, match="are these inches"):
        planned(tmp_path, small)
    assert planned(tmp_path, small, mm_per_unit=1)["a"].x_mm == 1.0
    with pytest.raises(ConfigError, match="depth 0.0004 mm .* are these metres"):
        planned(tmp_path, ["a,6,6,0.0004,,"])
    assert len(planned(tmp_path, ["a,0.3,0.3,0.2,,", "b,1,0.3,0.4,,"])) == 2  # near the corner, honest


def test_grids_and_steps_that_nobody_solves_are_refused_at_once(tmp_path):
    content = load_study("config/test.yaml").model_dump(mode="json")
    for spacing in (1e-9, 0.002):
        content["plan"] = {"grid": {"spacing_mm": spacing, "margin_mm": 2}, "depths_mm": [0.3]}
        with pytest.raises(ConfigError, match="at most 200000 are planned"):
            plan_cells(study_from(content))

    # Steps that nobody solves are refused
    content = load_study("config/test.yaml").model_dump(mode="json")
    for step, right in ((1e-9, False), (0.01, True)):
        content["mechanics"]["effects"]["history"]["timing"]["step_mm"] = step
        if right:
            assert plan_cells(study_from(content))
        else:
            with pytest.raises(ConfigError, match="step_mm 1e-09 mm: .* at most 10000 are solved"):
                plan_cells(study_from(content))


@pytest.mark.parametrize(("key", "size"), [("near_mm", 1e-3), ("far_mm", 1e4)])
def test_a_mesh_beyond_any_memory_is_refused_before_it_is_made(key, size):
    content = load_study("config/test.yaml").model_dump(mode="json")
    content["mechanics"]["mesh"][key] = size
    with pytest.raises(ConfigError, match="elements in a body|more than 1000 times near_mm"):
        plan_cells(study_from(content))
    content["mechanics"]["mesh"] |= {"near_mm": 0.1, "far_mm": 3.0}
    assert plan_cells(study_from(content))


def test_numbers_of_no_size_are_refused(tmp_path):
    for word in ("1e13", "1e-13", "-1e300"):
        with pytest.raises(ConfigError, match=r"origin_mm.0: nothing is larger than 1e\+12, or smaller"):
            session_file(tmp_path, f"session: a\nstage_to_sensor: {{origin_mm: [{word}, 0]}}\n")
    assert session_file(tmp_path, "session: a\nstage_to_sensor: {origin_mm: [0, 1e-3]}\n")
