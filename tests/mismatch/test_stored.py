"""Derivatives that are stored next to the sites: a verdict takes them for its own, and solves what they do not say."""

from dataclasses import replace

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import plan_cells
from gelforge.mismatch.evidence.candidates import effects_of_forces
from gelforge.mismatch.fem import solutions
from gelforge.mismatch.fem.asked import asked_of, observed_by
from gelforge.mismatch.fem.site_slopes import slopes_of_site, write_site_slopes
from gelforge.mismatch.fem.solutions import Solver, follow
from gelforge.mismatch.model.effect import Context

TRIED = ("gel_stiffness", "tilt", "misregistration", "inclusion", "elastic_base")
PLAN = {"grid": {"spacing_mm": 3.0, "margin_mm": 5.0}, "depths_mm": [0.2, 0.4, 0.6]}


@pytest.fixture(scope="module")
def study():
    plain = specimens.study(plan=PLAN)
    left_out = [name for name in effects_of_forces(plain) if name not in TRIED]
    return plain.model_copy(update={"mismatch": plain.mismatch.model_copy(update={"leave_out": left_out})})


@pytest.fixture(scope="module")
def stored(study, tmp_path_factory):
    """Return a solver that knows the derivatives of one site, its folder empty else, and the site."""
    folder = tmp_path_factory.mktemp("stored")
    cell = next(cell for cell in plan_cells(study).values() if cell.solved and cell.x_mm != cell.y_mm)
    solver = Solver(
        study,
        specimens.STUDY_LAWS,
        {"soft": [replace(specimens.GEL, mu=tuple(1.01 * m for m in specimens.GEL.mu))]},
        folder,
    )
    site = slopes_of_site(solver, cell)
    write_site_slopes(folder / f"{cell.name}.h5", solver, site)
    return replace(solver, stored=folder), site


def task(solver, x, y, depths):
    effects = [one for one in effects_of_forces(solver.study).values() if one.name in TRIED]
    asked = list(asked_of(solver, effects, Context.before_readings(solver.study)))
    planned = PlannedCell("", x, y, depths)
    return solver, planned, observed_by(asked, planned)


def nothing_is_solved(*_):
    raise AssertionError("solved what is stored")


def test_what_is_stored_is_what_would_be_solved(stored, tmp_path, monkeypatch):
    solver, site = stored
    place = site.planned.x_mm, site.planned.y_mm, (0.2, 0.4, 0.6)
    expected = follow(task(replace(solver, stored=None, kept=tmp_path), *place))
    monkeypatch.setattr(solutions, "each_derivative", nothing_is_solved)
    found = follow(task(replace(solver, kept=tmp_path / "none"), *place))
    assert found.keys() == expected.keys() and len(found) > 10
    for key, values in expected.items():
        # More right-hand sides side by side are summed in another order.
        assert_allclose(found[key], values, rtol=1e-9, atol=1e-12, err_msg=key)


@pytest.mark.parametrize("change", [{"discretisation": 0.01}, {"sites": 9}, {"draws": 4000}], ids=str)
def test_settings_that_decide_no_derivative_leave_what_is_stored(stored, change, tmp_path, monkeypatch):
    solver, site = stored
    mismatch = solver.study.mismatch.model_copy(update=change)
    study = solver.study.model_copy(update={"mismatch": mismatch, "seed": 77})
    monkeypatch.setattr(solutions, "solved_cell", nothing_is_solved)
    x, y = site.planned.x_mm, site.planned.y_mm
    found = follow(task(replace(solver, study=study, kept=tmp_path), x, y, (0.2, 0.4, 0.6)))
    assert len(found) > 10


def test_deeper_than_stored_is_solved_and_between_depths_only_the_base_is(stored, tmp_path):
    # Between the depths derivatives are interpolated and only the base is solved
    between_them = tmp_path / "between_them"
    between_them.mkdir()
    solver, site = stored
    place = site.planned.x_mm, site.planned.y_mm, (0.3, 0.5)
    smooth = ("law", "gel_stiffness", "tilt.about_x")
    found = follow(task(replace(solver, kept=between_them / "a"), *place))
    expected = follow(task(replace(solver, stored=None, kept=between_them / "b"), *place))
    assert len(list((between_them / "a").iterdir())) == 1
    assert_allclose(found["base"], expected["base"], rtol=1e-6, atol=1e-9)
    assert found.keys() == expected.keys()
    for key in [key for key in expected if key.startswith(smooth)]:
        # On nodes 2 mm apart a contact grows by leaps; what is small of a wall or a ball leaps most and is not looked at.
        size = np.abs(expected[key]).max()
        assert_allclose(found[key], expected[key], atol=0.15 * size, err_msg=key)

    # Deeper than stored is solved
    deep = tmp_path / "deep"
    deep.mkdir()
    follow(task(replace(solver, kept=deep), site.planned.x_mm, site.planned.y_mm, (0.2, 0.8)))
    assert len(list(deep.iterdir())) > 10


@pytest.mark.parametrize("how", ["other laws", "other mesh", "damaged", "another place"])
def test_what_is_stored_of_other_inputs_is_not_taken(stored, how, tmp_path, monkeypatch):
    solver, site = stored
    x, y = site.planned.x_mm, site.planned.y_mm
    solver = replace(solver, kept=tmp_path / "kept")
    if how == "other laws":
        solver = replace(solver, laws=specimens.STUDY_LAWS | {"soft": specimens.SKIN})
    elif how == "other mesh":
        mismatch = solver.study.mismatch.model_copy(update={"coarser": 2.5})
        solver = replace(solver, study=solver.study.model_copy(update={"mismatch": mismatch}))
    elif how == "damaged":
        content = bytearray(solver.stored_at(x, y).read_bytes())
        content[len(content) // 2] ^= 1
        (tmp_path / "stored").mkdir()
        solver = replace(solver, stored=tmp_path / "stored")
        solver.stored_at(x, y).write_bytes(content)
    else:
        x += 0.5
    monkeypatch.setattr(solutions, "each_derivative", nothing_is_solved)
    with pytest.raises(AssertionError, match="solved what is stored"):
        follow(task(solver, x, y, (0.2, 0.4, 0.6)))


def test_why_there_is_no_derivative_is_stored_too(stored, tmp_path, monkeypatch):
    solver, site = stored
    refused = replace(site, found=site.found | {"gel_stiffness": "it does not converge"})
    x, y = site.planned.x_mm, site.planned.y_mm
    write_site_slopes(tmp_path / solver.stored_at(x, y).name, solver, refused)
    monkeypatch.setattr(solutions, "each_derivative", nothing_is_solved)
    found = follow(task(replace(solver, stored=tmp_path, kept=tmp_path / "kept"), x, y, (0.2, 0.4, 0.6)))
    assert found["reason gel_stiffness"] == "it does not converge" and "gel_stiffness" not in found


def test_a_file_belongs_to_all_mirror_images_of_its_place(stored):
    solver, _ = stored
    cells = plan_cells(solver.study)
    for cell in cells.values():
        found = solver.stored_at(cell.x_mm, cell.y_mm)
        assert found.stem == (cell.source or cell.name) and cells[found.stem].solved
    assert solver.stored_at(1.0, 2.0) is None
