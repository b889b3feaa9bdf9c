"""Plans: positions, names, mirrored cells and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.config import ConfigError, Variant, load_study
from gelforge.indentation.planning.plan import landmarks, plan_cells, variant_cells
from gelforge.indentation.planning.plan_table import plan_table
from gelforge.indentation.sensor.symmetry import transform_points

GRID = {"grid": {"spacing_mm": 3.0, "margin_mm": 5.0}, "depths_mm": [0.4, 0.8]}


def from_csv(folder: Path, text: str, **plan):
    path = folder / "plan.csv"
    path.write_text(text)
    return plan_cells(specimens.study({"file": str(path)} | plan))


def test_grid_is_centred_named_ordered_and_mirrored():
    # Grid is centred named and ordered
    cells = plan_cells(specimens.study(GRID | {"symmetry": "none"}))
    assert list(cells)[:4] == ["x0_y0", "x1_y0", "x2_y0", "x0_y1"]
    assert [(c.x_mm, c.y_mm) for c in list(cells.values())[:2]] == [(5.0, 5.0), (8.0, 5.0)]
    assert cells["x1_y1"].depths_mm == (0.4, 0.8)
    assert all(name == cell.name and cell.source is None for name, cell in cells.items())

    # Names have as many digits as the grid needs
    cells = plan_cells(specimens.study({"grid": {"spacing_mm": 0.6, "margin_mm": 5.0}, "depths_mm": [0.5]}))
    assert {"x00_y00", "x10_y10"} <= set(cells)
    assert len(cells) == 121

    # A grid that does not fill its span stays centred
    cells = plan_cells(specimens.study({"grid": {"spacing_mm": 4.0, "margin_mm": 5.0}, "depths_mm": [0.5]}))
    assert sorted({c.x_mm for c in cells.values()}) == [6.0, 10.0]

    # Mirrored cells name a solved source and the symmetry that carries it there
    cells = plan_cells(specimens.study(GRID | {"symmetry": "d4"}))
    solved = {name for name, cell in cells.items() if cell.source is None}
    assert solved == {"x0_y0", "x1_y0", "x1_y1"}
    for cell in cells.values():
        if cell.source:
            source = cells[cell.source]
            assert source.source is None
            assert source.depths_mm == cell.depths_mm
            landing = transform_points(cell.symmetry, np.array([source.x_mm, source.y_mm]), 16.0)
            assert_allclose(landing, [cell.x_mm, cell.y_mm], atol=1e-9)


def test_symmetry_by_itself_is_found_and_the_table_has_a_row_per_depth():
    # Symmetry by itself is the one that is asked for
    asked, by_itself, none = (
        plan_cells(specimens.study(GRID | plan)) for plan in ({"symmetry": "d4"}, {}, {"symmetry": "none"})
    )
    assert by_itself == asked != none
    assert not any(cell.source for cell in none.values())

    # The papers study solves 231 of 1681 cells without being asked
    study = load_study("config/paper.yaml")
    assert "symmetry" not in study.plan.model_fields_set
    cells = plan_cells(study)
    assert len(cells) == 1681
    assert sum(cell.source is None for cell in cells.values()) == 231

    # Table has a row per cell and depth
    cells = plan_cells(specimens.study(GRID | {"symmetry": "d4"}))
    table = plan_table(cells)
    assert len(table) == 18
    row = table[(table.cell == "x2_y2") & (table.depth_mm == 0.8)].iloc[0]
    assert (row.x_mm, row.y_mm, row.source) == (11.0, 11.0, "x0_y0")
    assert (table[table.cell == "x0_y0"].source == "").all()


@pytest.mark.parametrize(
    "keys",
    [
        {"sensor": {"width_y_mm": 18.0}},
        {"sensor": {"bins": {"nx": 10, "ny": 12}}},
        {"indenter": {"kind": "box", "size_mm": [4.0, 4.0, 6.0]}},
        {"indenter": {"kind": "cylinder", "radius_mm": 3.0, "orientation_deg": [5.0, 0.0, 0.0]}},
        {"effects": {"kinematics": {"tilt_deg": [1.0, 0.0]}}},
        {"effects": {"kinematics": {"misregistration_mm": [0.1, 0.0]}}},
        {
            "effects": {"geometry": {"inclusions": [{"centre_mm": [5.0, 5.0, -2.0], "radius_mm": 1.0}]}}
        },  # a void
        {"effects": {"geometry": {"thickness": {"gel": {"gradient": [0.01, 0.0]}}}}},
        {"effects": {"geometry": {"prestretch": {"skin": [1.1, 1.0]}}}},
        {"effects": {"history": {"mullins": {"gel": {"amount": 0.2}}}}},
        {"sensitivities": ["friction"]},  # no symmetry is broken, but mirrored cells have no derivatives
        {"store_displacement": True},
    ],
    ids=lambda keys: "-".join(str(part) for part in keys.values()),
)
def test_every_cell_is_solved_where_symmetry_does_not_hold(keys):
    cells = plan_cells(specimens.study(GRID, **keys))
    assert len(cells) >= 9
    assert not any(cell.source for cell in cells.values())


@pytest.mark.parametrize(
    "keys",
    [
        {"indenter": {"kind": "cylinder", "radius_mm": 3.0}},
        {"effects": {"material": {"stiffness_factor": {"gel": 1.2}}, "kinematics": {"contact_zero_mm": 0.1}}},
        {"sensor": {"shape": {"kind": "dome"}, "wall_mm": 0.0}},
    ],
    ids=["cylinder", "effects of everywhere", "dome"],
)
def test_cells_are_mirrored_wherever_symmetry_holds(keys):
    cells = plan_cells(specimens.study(GRID, **keys))
    assert sum(cell.source is None for cell in cells.values()) == 3


@pytest.mark.parametrize("sensor", [{"width_y_mm": 18.0}, {"bins": {"nx": 10, "ny": 12}}])
def test_symmetry_is_refused_where_the_sensor_breaks_it(sensor):
    with pytest.raises(ConfigError, match=r"needs a square sensor and square bins.*use symmetry: auto"):
        plan_cells(specimens.study(GRID | {"symmetry": "d4"}, sensor))


def test_plans_that_cannot_be_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="no two positions"):
        from_csv(tmp_path, "cell,x_mm,y_mm,depth_mm\na,5,6,0.5\nb,7,6.5,0.5\n", symmetry="d4")

    # A missing plan file is named
    with pytest.raises(ValueError, match=r"nowhere\.csv: no such file"):
        plan_cells(specimens.study({"file": str(tmp_path / "nowhere.csv")}))

    # A margin beyond the middle is refused
    with pytest.raises(ConfigError, match="margin_mm 9.0 exceeds half"):
        plan_cells(specimens.study({"grid": {"spacing_mm": 1.0, "margin_mm": 9.0}, "depths_mm": [0.5]}))


def test_a_plan_file_states_its_positions_and_depths(tmp_path):
    text = "# by hand\ncell,x_mm,y_mm,depth_mm,note\nedge,4.5,8,1.0,second\nedge,4.5,8,0.5,first\nmiddle,8,8,0.25,\n"
    cells = from_csv(tmp_path, text)
    assert list(cells) == ["edge", "middle"]
    assert (cells["edge"].x_mm, cells["edge"].depths_mm) == (4.5, (0.5, 1.0))

    # The first of each set of images is solved, not one in a corner that is always the same.
    text = "cell,x_mm,y_mm,depth_mm\na,11,6,0.5\nb,7,6.5,0.5\nc,10,11,0.5\nd,5,6,0.7\n"
    cells = from_csv(tmp_path, text)
    assert {name: cell.source for name, cell in cells.items()} == {"a": None, "b": None, "c": "a", "d": None}
    alone = from_csv(tmp_path, "cell,x_mm,y_mm,depth_mm\na,5,6,0.5\nb,7,6.5,0.5\n")
    assert not any(cell.source for cell in alone.values())  # nothing to mirror is no error

    # Cells with other depths are no images
    text = "cell,x_mm,y_mm,depth_mm\na,5,6,0.5\nb,11,6,0.7\nc,11,10,0.5\n"
    cells = from_csv(tmp_path, text, symmetry="d4")
    assert [cells[name].source for name in "abc"] == [None, None, "a"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("cell,x_mm,depth_mm\na,5,0.5\n", ["plan.csv", "y_mm", "missing"]),
        ("cell,x_mm,y_mm,depth_mm\na b,5,5,0.5\n", ["plan.csv", "a b", "letters"]),
        ("cell,x_mm,y_mm,depth_mm\na,5,,0.5\n", ["plan.csv"]),
        ("cell,x_mm,y_mm,depth_mm\na,five,5,0.5\n", ["plan.csv", "five"]),
        ("cell,x_mm,y_mm,depth_mm\na,5,5,0.5\na,6,5,0.7\n", ["plan.csv", "site a", "several positions"]),
        ("cell,x_mm,y_mm,depth_mm\na,5,5,0.5\na,5,5,0.5\n", ["plan.csv", "site a", "differ"]),
        ("cell,x_mm,y_mm,depth_mm\na,5,5,-0.5\n", ["plan.csv", "site a", "-0.5", "positive"]),
        ("cell,x_mm,y_mm,depth_mm\na,17,5,0.5\n", ["site a", "17", "outside", "16.0"]),
        ("cell,x_mm,y_mm,depth_mm\na,5,5,2.5\n", ["site a", "2.5", "4.0", "press less deep"]),
    ],
)
def test_a_plan_file_that_cannot_be_used_is_refused(tmp_path, text, words):
    with pytest.raises(ValueError) as error:
        from_csv(tmp_path, text)
    assert type(error.value).__module__.startswith("gelforge."), (
        "an error of a library, without file and remedy"
    )
    assert all(word in str(error.value) for word in words), error.value


def test_rows_with_phases_or_moves_are_a_path_in_the_order_of_the_file(tmp_path):
    text = (
        "cell,x_mm,y_mm,depth_mm,phase,shear_x_mm,tilt_y_deg\n"
        "a,8,8,0.4,,,\na,8,8,0.8,,,\na,8,8,0.8,,0.2,\na,8,8,0.8,,0.2,3\na,8,8,0.8,dwell,0.2,3\na,8,8,0.0,,0.2,3\n"
    )
    cell = from_csv(tmp_path, text)["a"]
    assert cell.depths_mm == (0.4, 0.8, 0.8, 0.8, 0.8, 0.0)
    assert cell.phases == ("load", "load", "shear", "tilt", "dwell", "unload")
    assert cell.shears_mm[1:3] == ((0.0, 0.0), (0.2, 0.0))
    assert cell.tilts_deg[2:4] == ((0.0, 0.0), (0.0, 3.0))
    table = plan_table({"a": cell})
    assert list(table["phase"]) == list(cell.phases)
    assert list(table["shear_x_mm"]) == [0.0, 0.0, 0.2, 0.2, 0.2, 0.2]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("a,8,8,0.4,press,0\n", "phase 'press' is not one of load, shear, tilt, twist, dwell, unload"),
        ("a,8,8,0.0,load,0\n", "its path begins at depth 0 mm; begin with a positive depth"),
        ("a,8,8,0.4,load,0\na,8,8,0.4,shear,9\n", r"position \(17, 8\) mm lies outside the sensor"),
    ],
)
def test_a_path_that_cannot_be_followed_is_refused(tmp_path, rows, words):
    with pytest.raises(ConfigError, match=words):
        from_csv(tmp_path, "cell,x_mm,y_mm,depth_mm,phase,shear_x_mm\n" + rows)


# ------------------------------------------------------------------------------------------- variants
def with_variant(cells=(), plan=None):
    study = specimens.study(plan or GRID | {"symmetry": "d4"})
    study = study.model_copy(update={"variants": {"v": Variant(cells=list(cells))}})
    return plan_cells(study), study


def test_variants_solve_the_landmarks_or_the_cells_they_name():
    cells, study = with_variant()
    assert {name: cell.name for name, cell in landmarks(cells, study).items()} == {
        "centre": "x1_y1",
        "corner": "x2_y2",
    }
    del cells["x2_y2"]  # (5 mm from two edges: the next corner stands in)
    assert landmarks(cells, study)["corner"].name == "x2_y0"

    # Cells of a variant are solved themselves
    cells, study = with_variant()
    assert cells["x2_y2"].source == "x0_y0"
    chosen = variant_cells(cells, study, "v")
    assert {name: (cell.source, cell.symmetry) for name, cell in chosen.items()} == {
        "x1_y1": (None, None),
        "x2_y2": (None, None),
    }
    assert list(variant_cells(cells, with_variant(["x0_y1"])[1], "v")) == ["x0_y1"]

    # Cells that the plan lacks are refused
    cells, study = with_variant(["x9_y9"])
    with pytest.raises(ConfigError, match=r"variants\.v\.cells: \['x9_y9'\] are not in the plan"):
        variant_cells(cells, study, "v")
    cells, study = with_variant(plan={"grid": {"spacing_mm": 4.0, "margin_mm": 6.0}, "depths_mm": [0.5]})
    with pytest.raises(ConfigError, match="no site at the centre or 5 mm from two edges"):
        variant_cells(cells, study, "v")
