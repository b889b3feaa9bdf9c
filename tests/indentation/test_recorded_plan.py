"""Plans made of what was pressed: sites, depths and the tolerance of a stage; what is refused."""

import numpy as np
import pytest
import yaml
from session_folder import HEADER, press_lines, write_session

from gelforge.config import ConfigError, Plan, study_from
from gelforge.indentation.paths.places import chained, visited, within
from gelforge.indentation.planning.plan import plan_cells
from gelforge.recording.readings import read_recording

SCATTER = 0.015


def study(data, plan=None, sessions=("one",), **more):
    return study_from(
        {
            "study": "own",
            "data": str(data),
            "materials": {"soft": {"parameters": {"mu_kPa": [8.0], "alpha": [2.0]}}},
            "sensor": {"layers": [{"name": "gel", "thickness_mm": 6.0, "material": "soft"}]},
            "plan": plan or {"from": "sessions"},
            "sessions": list(sessions),
            **more,
        }
    )


def record(data, name, places, depths=(0.5, 1.0), repeatability=None, cells=None):
    """Write a session that presses the places (n, 2) in turn, each to the next of the depths."""
    lines = [HEADER]
    for k, (x, y) in enumerate(places):
        own = press_lines(f"p{k}", k, round(x, 6), round(y, 6), depths[k % len(depths)], False)
        lines += [line.replace(",,", f",{cells[k]},", 1) for line in own] if cells else own
    stage = "" if repeatability is None else f"stage_to_sensor: {{repeatability_mm: {repeatability}}}\n"
    return write_session(data / "recordings" / name, lines=lines, extra=stage)


def visits(count, seed=0):
    """Return where a robot of SCATTER lands when it goes to each of four places so often."""
    meant = np.repeat([(10.0, 12.0), (16.0, 16.0), (20.0, 9.0), (24.0, 22.0)], count, axis=0)
    return meant + np.random.default_rng(seed).normal(0, SCATTER, meant.shape)


def test_positions_within_the_stages_repeatability_are_one_site_with_all_its_depths(tmp_path):
    record(tmp_path, "one", visits(10), repeatability=SCATTER)
    cells = plan_cells(study(tmp_path))
    assert [cell.depths_mm for cell in cells.values()] == [(0.5, 1.0)] * 4
    assert list(cells) == ["p0000", "p0001", "p0002", "p0003"]
    assert {cell.within_mm for cell in cells.values()} == {5 * SCATTER}
    readings = read_recording(tmp_path / "recordings/one", cells).readings
    assert readings.groupby("press")["cell"].nunique().eq(1).all() and (readings["cell"] != "").all()


def test_later_sessions_do_not_move_sites_and_the_nearer_site_is_joined(tmp_path):
    # A later session does not move sites. Each site lies where it was first pressed: what has been solved there
    # stays
    record(tmp_path, "one", visits(4), repeatability=SCATTER)
    before = plan_cells(study(tmp_path))
    record(tmp_path, "two", [*visits(4, seed=1), (5.0, 5.0)], (0.7,), SCATTER)
    after = plan_cells(study(tmp_path, sessions=("one", "two")))
    places = {name: (cell.x_mm, cell.y_mm) for name, cell in after.items()}
    assert list(after) == [*before, "p0004"]
    assert all(places[name] == (cell.x_mm, cell.y_mm) for name, cell in before.items())
    assert all(cell.depths_mm == (0.5, 0.7, 1.0) for cell in list(after.values())[:4])

    # Of two sites within the tolerance the nearer is joined
    nearer = tmp_path / "nearer"
    nearer.mkdir()
    rows = "a,16.0,16.0,0.5\na,16.0,16.0,1.0\nb,16.1,16.0,0.5\nb,16.1,16.0,1.0\n"
    (nearer / "plan.csv").write_text("cell,x_mm,y_mm,depth_mm\n" + rows)
    record(nearer, "one", [(16.06, 16.0), (16.02, 16.0)])
    plan = {"file": str(nearer / "plan.csv"), "tolerance_mm": 0.2}
    readings = read_recording(nearer / "recordings/one", plan_cells(study(nearer, plan))).readings
    assert readings.groupby("press")["cell"].first().to_dict() == {"p0": "b", "p1": "a"}


@pytest.mark.parametrize("seed", range(20))
def test_every_recorded_indentation_joins_a_plan_from_its_session(tmp_path, seed):
    """Also where positions crowd: each has a site within the tolerance that has its depth."""
    rng = np.random.default_rng(seed)
    places = 10 + rng.uniform(0, 0.3, (40, 2))
    record(tmp_path, "one", places, depths=rng.uniform(0.2, 1.0, 40).round(4), repeatability=0.02)
    cells = plan_cells(study(tmp_path))
    assert 1 < len(cells) < 40
    read_recording(tmp_path / "recordings/one", cells)


@pytest.mark.parametrize("turn", [0.0, 0.6435011])
@pytest.mark.parametrize("gap", [0.01, 0.0100005, 0.0102])
def test_a_position_at_the_tolerance_is_within_it_everywhere(tmp_path, gap, turn):
    """Of an indentation that moves, of one next to its site, of a depth, of sites side by side."""
    away = gap * np.array([np.cos(turn), np.sin(turn)])
    x, y = np.round(np.array([16.0, 16.0]) + away, 7)
    inside = gap < 0.0101
    plan = {"grid": {"spacing_mm": 6.0, "margin_mm": 14.0}, "depths_mm": [0.8]}
    beside = write_session(tmp_path / "beside", lines=[HEADER, *press_lines("a", 0, x, y, 0.8, False)])
    deep = write_session(tmp_path / "deep", lines=[HEADER, *press_lines("a", 0, 16, 16, 0.8 + gap, False)])
    lines = press_lines("a", 0, 16.0, 16.0, 0.8, False)
    lines[2:] = [line.replace(",16.0,16.0,", f",{x},{y},") for line in lines[2:]]
    moving = write_session(tmp_path / "moving", lines=[HEADER, *lines])
    cells = plan_cells(study(tmp_path, plan, sessions=()))
    refused = 0
    for folder in (beside, deep, moving):
        try:
            read_recording(folder, cells)
        except ValueError:
            refused += 1
    assert refused == (0 if inside else 3)
    assert bool(within(gap)) == inside
    for same in (visited, chained):
        assert same(np.array([(16.0, 16.0), (x, y)]), 0.01).tolist() == ([0, 0] if inside else [0, 1])
    (tmp_path / "plan.csv").write_text(f"cell,x_mm,y_mm,depth_mm\na,16.0,16.0,0.8\nb,{x},{y},0.8\n")
    if inside:
        with pytest.raises(ConfigError, match="sites a and b are both at"):
            plan_cells(study(tmp_path, {"file": str(tmp_path / "plan.csv")}, sessions=()))
    else:
        assert len(plan_cells(study(tmp_path, {"file": str(tmp_path / "plan.csv")}, sessions=()))) == 2


def test_the_tolerance_of_a_planned_grid_follows_the_stage_and_its_key(tmp_path):
    plan = {"grid": {"spacing_mm": 6.0, "margin_mm": 10.0}, "depths_mm": [0.5, 1.0]}
    near = np.array([(16.04, 16.0), (16.0, 16.06)])
    record(tmp_path, "one", near)
    with pytest.raises(ValueError, match=r"no planned site within 0.01 mm.*repeatability_mm.*from: sessions"):
        read_recording(tmp_path / "recordings/one", plan_cells(study(tmp_path, plan)))
    record(tmp_path, "two", near, repeatability=SCATTER)
    by_stage, by_key = study(tmp_path, plan, ("two",)), study(tmp_path, plan | {"tolerance_mm": 0.06})
    for described, name in ((by_stage, "two"), (by_key, "one")):
        readings = read_recording(tmp_path / "recordings" / name, plan_cells(described)).readings
        assert set(readings["cell"]) == {"x1_y1"}
    with pytest.raises(ConfigError, match="below three times the repeatability 0.015 mm"):
        plan_cells(study(tmp_path, plan | {"tolerance_mm": 0.03}, ("two",)))


def test_recorded_names_are_kept_and_the_key_survives_the_written_study(tmp_path):
    # Recorded names are kept and name one position each
    record(tmp_path, "one", [(10, 12), (10.004, 12), (16, 16)], cells=["left", "left", ""])
    assert list(plan_cells(study(tmp_path))) == ["left", "p0001"]
    record(tmp_path, "two", [(10, 12), (16, 16)], cells=["left", "left"])
    with pytest.raises(ConfigError, match=r"site 'left' lies at \(16.0000, 16.0000\) mm, 7.21 mm from"):
        plan_cells(study(tmp_path, sessions=("two",)))

    # The key survives the written study
    keyed = tmp_path / "keyed"
    plan = study(keyed, {"from": "sessions", "tolerance_mm": 0.05}).plan
    written = plan.model_dump(mode="json")
    assert written["from"] == "sessions" and "from_" not in written
    assert Plan.model_validate(yaml.safe_load(yaml.safe_dump(written))) == plan
    grid = Plan.model_validate({"grid": {"spacing_mm": 1.0}, "depths_mm": [1.0]}).model_dump(mode="json")
    assert not {"from", "tolerance_mm"} & set(grid)  # digests of studies without these keys stay
    with pytest.raises(ConfigError, match="give one of `grid` with `depths_mm`, `file` and `from: sessions`"):
        study(keyed, {"from": "sessions", "file": "plan.csv"})


def test_what_no_plan_can_be_made_of_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"sessions.*names none.*gelforge import --study"):
        plan_cells(study(tmp_path, sessions=()))
    with pytest.raises(ConfigError, match=r"one/session.yaml: missing"):
        plan_cells(study(tmp_path))
    folder = record(tmp_path, "one", [(10, 12)])
    table = folder / "indentations.csv"
    table.write_text(table.read_text().replace(",unload,", ",shear,"))
    with pytest.raises(ConfigError, match="indentation p0 moves sideways.*plan.file"):
        plan_cells(study(tmp_path))
    with pytest.raises(ConfigError, match="plan.from: sessions, but virtual_lab"):
        plan_cells(study(tmp_path, virtual_lab="config/virtual_lab/test.yaml"))


@pytest.mark.parametrize(
    ("offset", "factor", "words"),
    [
        ((-412.0, 155.0), 1.0, "in the robot's frame"),
        ((412.0, -655.0), 1.0, "in the robot's frame"),
        ((0.0, 0.0), 1000.0, "in micrometres"),
        ((0.0, 0.0), 0.001, "in metres"),
        ((20.0, 0.0), 1.0, "correct x_mm, y_mm or stage_to_sensor"),
    ],
)
@pytest.mark.parametrize("from_sessions", [True, False])
def test_positions_outside_the_sensor_say_what_they_may_be(tmp_path, offset, factor, words, from_sessions):
    places = np.array([(10.0, 12.0), (20.0, 18.0)]) * factor + offset
    folder = record(tmp_path, "one", places)
    described = study(tmp_path)
    with pytest.raises(ValueError, match=words) as refused:
        plan_cells(described) if from_sessions else read_recording(folder, None, described.sensor)
    assert f"{folder}/indentations.csv, row " in str(refused.value)
