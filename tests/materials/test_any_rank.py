"""A covariance of any rank, as parameters at their bounds leave it: fit, choice, law file, press, site and verdict."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import gelforge as gf
from gelforge.config import study_from
from gelforge.indentation.solving.error_bars import AMOUNT
from gelforge.laws_of_study import laws_and_doubts, material_laws_of
from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.fitting import choice
from gelforge.materials.fitting.curves import mean_curves
from gelforge.materials.fitting.law_file import LawFileError, MaterialLaw, moved_laws, read_law, write_law
from gelforge.mechanics.laws.homogeneous import nominal_stress, stress_points
from gelforge.mechanics.laws.models import FAMILIES
from gelforge.mechanics.laws.models.gent import Gent
from gelforge.mechanics.laws.models.mooney_rivlin import MooneyRivlin
from gelforge.mechanics.laws.models.yeoh import Yeoh
from gelforge.mismatch.fem.solutions import along_laws
from gelforge.mismatch.pipeline.stage import solver_of

BLOCKS = {
    "sensor": {
        "width_x_mm": 12,
        "width_y_mm": 12,
        "wall_mm": 0,
        "layers": [{"name": "gel", "thickness_mm": 4, "material": "gel"}],
        "bins": {"nx": 6, "ny": 6},
    },
    "indenter": {"kind": "sphere", "radius_mm": 4},
    "mechanics": {"mesh": {"near_mm": 1, "near_radius_mm": 2, "far_mm": 2}},
}
YEOH = Yeoh(0.021, 1e-4, 0.0)
SIGMA = np.array([0.5, 0.1, 0.02])  # kPa
COVARIANCES = {
    "full": np.diag(SIGMA**2) + 0.5 * np.outer(SIGMA, SIGMA),
    "rank 1": np.outer(SIGMA, SIGMA),
    "C30 at its bound": np.diag(SIGMA * [1, 1, 0]) ** 2,
    "C10 alone": np.diag(SIGMA * [1, 0, 0]) ** 2,
    "zero": np.zeros((3, 3)),
}


def specimens(softening):
    """Return tests of a nearly neo-Hookean rubber that softens a little: C30 of Yeoh's model sticks at its bound, 0."""
    rng, tests = np.random.default_rng(0), []
    law = Yeoh(0.021, softening, -softening / 6)
    for kind, largest in (("uniaxial", 2.2), ("uniaxial", 2.2), ("pure_shear", 1.9)):
        lam = np.linspace(1, largest, 40)
        stress = nominal_stress(law, kind, lam) * (1 + 0.001 * rng.normal()) + 2e-5 * rng.normal(size=40)
        tests.append(MaterialTest(kind, f"s{len(tests)}", lam, stress))
    return tests


def folder_of(tests, folder):
    """Write tests as a user's folder and return it."""
    rows = "".join(f"{t.sample}.csv,{t.test},{t.sample}\n" for t in tests)
    (folder / "samples.csv").write_text("file,test,sample\n" + rows)
    for t in tests:
        lines = "".join(f"{a:.12g},{b * 1e3:.12g}\n" for a, b in zip(t.stretch, t.nominal_stress))
        (folder / f"{t.sample}.csv").write_text("stretch_1,nominal_stress_kPa\n" + lines)
    return folder


@pytest.fixture
def chosen(monkeypatch):
    """Return a comparison of models, without the costly profile of what was not tested."""
    monkeypatch.setattr(choice, "prediction_widths", lambda curves, fit: [])
    return lambda names, softening, choose="aicc": choice.compare_laws(
        mean_curves(specimens(softening)), names, choose=choose
    )


# ------------------------------------------------------------------------------------------- choice
@pytest.mark.parametrize("choose", ["aicc", "held_out"])
def test_a_parameter_at_its_bound_gives_way_to_the_simpler_model(chosen, choose, monkeypatch):
    monkeypatch.setattr(choice, "SAME_ERROR", 2.0)  # the two predict what is left out nearly alike
    found = chosen(["yeoh", "neo_hooke"], 1e-5, choose)
    yeoh, neo = found.candidates
    assert yeoh.fitted.at_bound == ("C30_kPa",)
    criterion = {"aicc": "aicc", "held_out": "held_out_error"}[choose]
    assert getattr(yeoh, criterion) < getattr(neo, criterion)
    assert found.chosen is neo and "C30_kPa is 0" in found.reason


def test_a_bound_is_kept_and_terms_are_left_out_as_the_tests_support(chosen, tmp_path):
    # A model with a parameter at its bound is kept where the simpler one has no support
    found = chosen(["yeoh", "neo_hooke"], 4e-5)
    assert found.chosen.name == "yeoh" and found.chosen.fitted.at_bound == ("C30_kPa",)

    # Terms that the tests do not determine are left out with a word
    found = chosen(["ogden2"], 0.0)
    assert found.chosen.name == "ogden1"
    assert found.warnings[0].startswith("ogden1 IS FITTED IN PLACE OF ogden2")
    assert list(found.table()["law"]) == ["ogden2", "ogden1"]
    assert chosen(["ogden2", "neo_hooke"], 0.0).chosen.name == "neo_hooke"  # nothing to replace
    assert chosen(["ogden2", "neo_hooke"], 0.0, "first").chosen.name == "ogden1"

    # A fit in python warns of terms that were left out
    with pytest.warns(UserWarning, match="ogden1 IS FITTED IN PLACE OF ogden2"):
        fitted = gf.fit(folder_of(specimens(0.0), tmp_path))
    assert fitted.model == "ogden1" and "IN PLACE OF ogden2" in str(fitted)


# ------------------------------------------------------------------------------------------- law file, moves
@pytest.mark.parametrize("name", COVARIANCES)
def test_a_covariance_of_any_rank_goes_through_the_file_to_the_stress(tmp_path, name):
    C = COVARIANCES[name]
    write_law(tmp_path / "law.json", MaterialLaw("gel", YEOH, "", C, samples={"uniaxial": 2}, freedom=1))
    read = read_law(tmp_path / "law.json")
    assert_allclose(read.covariance, C, rtol=1e-9)
    moved = moved_laws(read, AMOUNT)
    assert len(moved) <= np.linalg.matrix_rank(C)
    points = stress_points("pure_shear", np.array([1.25]))
    gradient = (
        FAMILIES["yeoh"].stress(points, np.array(YEOH.point_constants)[[0, 2, 3]])[1][0] / 1e3
    )  # by kPa
    change = [
        (law.principal_stress(points.lam) - YEOH.principal_stress(points.lam)) / AMOUNT for law in moved
    ]
    found = sum(float((c[0, 0] - c[0, 2]) * points.scale[0]) ** 2 for c in change)
    assert found == pytest.approx(gradient @ C @ gradient, rel=5e-3, abs=1e-20)  # moved_laws.NEGLIGIBLE


def test_a_covariance_that_is_none_is_refused_and_a_parameter_at_its_limit_is_moved(tmp_path):
    # A covariance that is none is refused
    for bad in (np.full((3, 3), np.nan), np.eye(2), -np.eye(3)):
        write_law(tmp_path / "law.json", MaterialLaw("gel", YEOH, "", bad))
        with pytest.raises(LawFileError, match="3 x 3 finite numbers"):
            read_law(tmp_path / "law.json")

    # A parameter next to its bound or limit is moved
    near = MaterialLaw("gel", MooneyRivlin(0.02, 0.0), "", np.diag([0.1, 0.3]) ** 2)
    assert all(law.C01 >= 0 for law in moved_laws(near, AMOUNT)) and len(moved_laws(near, AMOUNT)) == 2

    # A model whose limit lies within the states looked at is moved
    short = MaterialLaw("gel", Gent(0.02, 0.8), "", np.diag([0.5, 0.05]) ** 2)  # I1 - 3 reaches 1.2 there
    assert len(moved_laws(short, AMOUNT)) == 2


# ------------------------------------------------------------------------------------------- press, site, verdict
def test_a_fit_with_a_parameter_at_its_bound_is_pressed_with_error_bars(tmp_path):
    fitted = gf.fit(folder_of(specimens(4e-5), tmp_path), models=["yeoh", "neo_hooke"])
    assert fitted.model == "yeoh" and np.linalg.matrix_rank(fitted.law.covariance) == 2
    answer = gf.press(6.0, 6.0, [0.4], materials={"gel": fitted}, **BLOCKS)
    assert (answer.cell.arrays["total_sigma_material_N"][0, 2] > 0) and answer.total_sigma_N[0, 2] > 0


@pytest.mark.parametrize("name", ["rank 1", "C30 at its bound", "zero"])
def test_a_study_site_and_a_verdict_take_a_covariance_of_any_rank(tmp_path, name):
    """The command of a site, and the directions of the laws in the covariance of a verdict's readings."""
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.indentation.solving.companion import simulate_label

    path = tmp_path / "law.json"
    write_law(path, MaterialLaw("gel", YEOH, "", COVARIANCES[name], samples={"uniaxial": 2}, freedom=1))
    study = study_from(
        BLOCKS
        | {
            "study": "any_rank",
            "materials": {"gel": {"tests": "nowhere"}},
            "plan": {"grid": {"spacing_mm": 2.0, "margin_mm": 5.0}, "depths_mm": [0.4]},
        },
        "test",
    )
    laws, doubts = laws_and_doubts(material_laws_of(study, [path]))
    planned = next(iter(plan_cells(study).values()))
    cell = simulate_label(study, laws, doubts, planned)
    assert cell.converged and cell.attributes["uncertain_materials"] == ["gel"]
    assert (cell.arrays["total_sigma_material_N"][0, 2] > 0) == (name != "zero")
    solver = solver_of(study, tmp_path, [path], None, 1, [])
    assert len(along_laws(solver, solver.coarse)) == len(moved_laws(read_law(path), AMOUNT))
