"""A site that nothing touches is no label, nor one that a part of the indenter never touches."""

import numpy as np
import pytest
import specimens

from gelforge.cli import main
from gelforge.config import ConfigError, study_from, write_yaml
from gelforge.config.basis.variants import merged
from gelforge.indentation.cells.cell_file import read_cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import plan_cells
from gelforge.indentation.solving.companion import simulate_label

LAWS = specimens.STUDY_LAWS
MESH = {"near_mm": 1.0, "near_radius_mm": 2.0, "growth": 0.4, "far_mm": 2.0}


def balls(height, **keys):
    """Return two balls side by side, the second one higher [mm]."""
    parts = [
        {"radius_mm": 3.0, "offset_mm": [-2.5, 0.0, 0.0]},
        {"radius_mm": 3.0, "offset_mm": [2.5, 0.0, height]} | keys,
    ]
    return {"kind": "several", "parts": parts}


def study(indenter=None, zero=0.0, depths=(0.4, 0.8), margin=6.0, **keys):
    plan = {"grid": {"spacing_mm": 3.0, "margin_mm": margin}, "depths_mm": list(depths)}
    described = specimens.study(plan=plan, indenter=indenter, mesh=MESH, error_bars=False, **keys)
    effects = {"mechanics": {"effects": {"kinematics": {"contact_zero_mm": zero}}}}
    return study_from(merged(described.model_dump(mode="json"), effects))


def label(described, depths=(0.4, 0.8), place=specimens.CENTRE):
    return simulate_label(described, LAWS, {}, PlannedCell("a", *place, tuple(depths)))


def test_a_site_is_a_label_if_something_touches():
    cell = label(study(zero=-1.0))
    assert not cell.converged
    assert (
        "no depth touches: the indenter stays clear of the sensor down to 0.8 mm" in cell.attributes["reason"]
    )

    # Depths before contact are labels of zero
    cell = label(study(zero=-0.6))
    assert cell.converged and list(cell.attributes["touched_parts"]) == [True]
    forces = cell.arrays["total_force_N"]
    assert not forces[0].any() and forces[1, 2] < 0

    # Two balls of different height that both touch are a label
    described = study(balls(0.3))
    assert plan_cells(described)
    cell = label(described)
    assert cell.converged and list(cell.attributes["touched_parts"]) == [True, True]


def test_what_never_touches_is_refused_before_anything_is_solved():
    with pytest.raises(
        ConfigError, match=r"part 2 never touches: it lies 1 mm over the lowest part.*need_not_touch"
    ):
        plan_cells(study(balls(1.0)))
    assert plan_cells(study(balls(1.0, need_not_touch=True)))

    # A ball next to the sensor is refused
    wide = balls(0.0)
    wide["parts"][1]["offset_mm"] = [12.0, 0.0, 0.0]
    with pytest.raises(ConfigError, match="part 2 never touches: it lies next to the sensor there"):
        plan_cells(study(wide))
    wide["parts"][1]["need_not_touch"] = True
    assert plan_cells(study(wide))

    # An indenter alone must touch
    with pytest.raises(ConfigError, match="need_not_touch is for one of several parts"):
        study({"radius_mm": 3.0, "need_not_touch": True})

    # Positions next to a dome are refused
    dome = {"shape": {"kind": "dome"}, "wall_mm": 0.0}
    assert plan_cells(study(sensor=dome))
    with pytest.raises(ConfigError, match=r"no surface of the sensor lies below \(2, 2\) mm"):
        plan_cells(study(sensor=dome, margin=2.0))


def test_parts_that_touch_are_told_apart_and_a_site_without_one_has_failed():
    # A solved site that a ball never touched has failed. Known only afterwards: the first ball's place yields to
    # neither rule of the plan, the mesh decides
    cell = label(study(balls(0.7)), depths=(0.4,))
    assert not cell.converged and "part(s) [2] of the indenter never touch(es)" in cell.attributes["reason"]
    stem = label(study(balls(0.7, need_not_touch=True)), depths=(0.4,))
    assert stem.converged
    assert np.array_equal(stem.arrays["total_force_N"], cell.arrays["total_force_N"])

    # Parts are distinguished where the set is turned
    turned = balls(0.3) | {"orientation_deg": [0.0, 0.0, 90.0]}
    assert list(label(study(turned)).attributes["touched_parts"]) == [True, True]
    tilted = balls(0.0) | {"orientation_deg": [0.0, 15.0, 0.0]}  # lowers one ball by 1.3 mm
    touched = list(label(study(tilted)).attributes["touched_parts"])
    assert sorted(touched) == [False, True]
    about = balls(0.7) | {
        "orientation_deg": [0.0, 0.0, 180.0]
    }  # the second ball, 0.7 mm higher, is now on the left
    assert list(label(study(about), depths=(0.4,)).attributes["touched_parts"]) == [True, False]


def test_a_press_and_a_site_without_contact_fail_in_a_line(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    write_yaml(tmp_path / "s.yaml", study(zero=-1.0))
    at = ["--x", "8", "--y", "8", "--depths", "0.4,0.8"]
    assert main(["press", *at, "--study", "s.yaml"]) == 1
    error = capfd.readouterr().err
    assert (
        error.startswith("gelforge: the indentation failed: no depth touches")
        and len(error.splitlines()) == 1
    )

    # A site of the workflow that nothing touches is written as failed
    monkeypatch.chdir(tmp_path)
    described = study(zero=-1.0)
    write_yaml(tmp_path / "s.yaml", described)
    for name in described.materials:
        assert main(["fit-law", "--study", "s.yaml", "--material", name, "--out", name]) == 0
    laws = ["--laws", *(f"{name}/law.json" for name in described.materials)]
    assert main(["simulate", "--study", "s.yaml", "--cell", "x0_y0", *laws, "--out", "a.h5"]) == 0
    assert "x0_y0: failed no depth touches" in capfd.readouterr().out
    assert read_cell("a.h5").attributes["status"] == "failed"
