"""docs/effects.md is what the catalogue says, and the effect that docs/adding/effect.md shows is a whole one."""

import shutil
from dataclasses import replace
from pathlib import Path

import artificial
import numpy as np
from numpy.testing import assert_allclose

import gelforge.mismatch.effects as effects
from docs.effects_table import PAGE, page, parameters

EXAMPLE = Path("docs/adding/examples/depth_scale.py")
CATALOGUE = effects.CATALOGUE


def test_the_page_has_a_row_for_every_effect_and_its_cells_tell_bars_once():
    # The page has a row for every effect
    assert PAGE.read_text(encoding="utf-8") == page(CATALOGUE), (
        "docs/effects.md is old: python docs/effects_table.py"
    )

    # Every effect has one row of five cells
    rows = [line for line in page(CATALOGUE).splitlines() if line.startswith("| ")][1:]
    assert sorted(line.split(" | ")[0].removeprefix("| ") for line in rows) == sorted(CATALOGUE)
    assert all(line.count(" | ") == 4 for line in rows)

    # Cells tell bars and like parameters once
    split = replace(CATALOGUE["yaw"], signature="|F| grows")
    assert "| \\|F\\| grows |" in page({"yaw": split})

    # Parameters that differ by name only are reported once
    assert parameters(CATALOGUE["force_gain"].parameters) == "x, y, z [-] 0.05, -0.5 .. 0.5"
    pose = "shift_x, shift_y, shift_z [mm] 0.5, -5 .. 5; turn_x, turn_y, turn_z [deg] 1, -15 .. 15"
    assert parameters(CATALOGUE["camera_pose"].parameters) == pose


def test_the_guides_example_is_an_effect(tmp_path, monkeypatch):
    """As printed it enters by its file; nothing of it is the base bit for bit, and it acts as the guide says."""
    shutil.copy(EXAMPLE, tmp_path)
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    effect = effects.catalogue_of_modules()["depth_scale"]
    context = artificial.context(per_side=2)
    assert np.array_equal(effect.to_forces(context, {}, context.force, [0.0]), context.force)
    found = effect.to_forces(context, {}, context.force, [0.01]) - context.force
    depth = context.observations.table["depth_mm"].to_numpy()
    # the same as depth zero found too late by 1 % of the depth; 1e-14 N is rounding of the sum with the force
    assert_allclose(found, 0.01 * depth[:, None] * context.derivative("contact_zero"), atol=1e-14)
    assert np.abs(found).max() > 1e-3
    assert "| depth_scale | kinematics | growth [-] 0.01, -0.1 .. 0.1 |" in page({"depth_scale": effect})
