"""A decision about solved sites that is made again takes back what followed from the one before."""

import pytest
import specimens

from gelforge.cli.jobs import interpolation
from gelforge.cli.products.sites import cell_path
from gelforge.config import write_yaml
from gelforge.files import write_product_json
from gelforge.indentation.planning.plan import plan_cells
from gelforge.interpolation import levels
from gelforge.interpolation.levels import Decision

PLAN = {
    "grid": {"spacing_mm": 0.5, "margin_mm": 5.0},
    "depths_mm": [0.4, 0.8],
    "interpolation": {"tolerance": 0.5},
}


@pytest.fixture
def decided(tmp_path, monkeypatch):
    """Return a study in whose folder three levels are decided and every cell is made, and its cells."""
    monkeypatch.chdir(tmp_path)
    study = specimens.study(plan=PLAN)
    write_yaml(tmp_path / "study.yaml", study)
    folder = study.results_folder / "interpolation"
    folder.mkdir(parents=True)
    for number, more in enumerate((["i8_8"], ["i4_4"], [])):
        found = {"solved": ["i16_16"], "more": more, "themselves": []}
        write_product_json(folder / f"level_{number}.json", found)
    cells = plan_cells(study)
    for name in cells:
        path = cell_path(study, name)
        path.parent.mkdir(exist_ok=True)
        path.touch()
    # What is solved and decided is of no matter here.
    monkeypatch.setattr(interpolation, "study_laws", lambda *_: {})
    monkeypatch.setattr(interpolation, "solved_sites", lambda *_: None)
    monkeypatch.setattr(
        levels, "decide", lambda _, level, *__: Decision(level, ("i16_16",), (), (), 1, 0, 0.1, "")
    )
    return study, cells


@pytest.mark.parametrize("level", [0, 1, 2])
def test_later_decisions_and_interpolated_cells_are_removed(decided, tmp_path, level):
    study, cells = decided
    folder = study.results_folder / "interpolation"
    interpolation.level(tmp_path / "study.yaml", level, [], folder / f"level_{level}.json")
    assert sorted(path.name for path in folder.iterdir()) == [f"level_{k}.json" for k in range(level + 1)]
    assert interpolation.read_decision(folder / f"level_{level}.json")["more"] == [], "the new one"
    left = {path.stem for path in (study.results_folder / "cells").iterdir()}
    interpolated = {name for name, cell in cells.items() if cell.between}
    assert 0 < len(interpolated) and left == set(cells) - interpolated
