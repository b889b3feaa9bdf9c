"""Derivatives with respect to effects, as a cell stores them: against the solver, and in files."""

from functools import cache

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.config import ConfigError
from gelforge.indentation.cells.cell_file import read_cell, write_cell
from gelforge.indentation.effects.catalogue import CATALOGUE
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import press_path
from gelforge.indentation.solving.companion import simulate_label
from gelforge.indentation.solving.sensitivities import derivable, derivatives, sensitivities, variations_of
from gelforge.indentation.solving.simulate import simulate_cell, solved_cell
from gelforge.mechanics.solving.equilibrium import Press

# An aged, warm session: else ageing and temperature have nothing to act on.
SESSION = {"material": {"circumstances": {"age_days": 10.0, "temperature_C": 33.0}}}
TIGHT = {
    "effects": SESSION,
    "solver": {"force_tolerance": 1e-9, "gap_tolerance": 1e-7, "max_iterations": 80},
}
PLANNED = PlannedCell("place", 10.3, 9.2, (0.3, 0.6))
RELEASED = press_path("place", 10.3, 9.2, [0.3, 0.6], None, unload=True)
DERIVABLE = [name for name in CATALOGUE if derivable(name)]
# Their mesh or path is another: two solutions are subtracted, nothing is followed next to a base.
SUBTRACTED = ["elastic_base", "viscoelastic", "mullins", "frame_compliance", "base_bending"]


ARRAYS = ("total_force_N", "bin_force_N", "gel_displacement_mm")


def tight_study():
    return specimens.study(store_displacement=True, **TIGHT)


def path_of(name):
    """Return the press on which an effect is seen."""
    return RELEASED if CATALOGUE[name].unloading else PLANNED


@pytest.fixture(scope="module")
def stored():
    """Return derivatives by name of all effects that have one, and the study."""
    study = tight_study()
    found = {}
    for planned in (PLANNED, RELEASED):
        names = [name for name in DERIVABLE if path_of(name) is planned]
        found |= sensitivities(study, specimens.STUDY_LAWS, planned, names)
    return found, study


@cache
def pressed(name, amount):
    """Return total and bin forces and the gel's displacement with an amount of an effect."""
    study = CATALOGUE[name](tight_study(), amount)
    cell = simulate_cell(study, specimens.STUDY_LAWS, path_of(name))
    return {array: cell.arrays[array] for array in ARRAYS}


def change(name, amount):
    """Return how much forces, bins and displacements change from no effect to an amount of it."""
    there, none = pressed(name, amount), pressed(name, 0.0)
    return [there[array] - none[array] for array in ARRAYS]


@pytest.mark.thorough(but_first=2)
@pytest.mark.parametrize("name", DERIVABLE)
def test_a_derivative_predicts_what_a_little_of_the_effect_does(stored, name):
    """The issue: 1e-2 of a plausible width moves every total force by what the derivative predicts within 5 %."""
    amount = 1e-2 * CATALOGUE[name].width
    total, *_ = change(name, amount)
    size = np.linalg.norm(total, axis=1).max()
    assert size > 0
    assert_allclose(amount * stored[0][name].total, total, atol=0.05 * size)


@pytest.mark.thorough(but_first=10)
@pytest.mark.parametrize("name", DERIVABLE)
def test_bins_follow_their_derivatives_to_5_per_cent_of_the_largest(stored, name):
    """At the step of the effect's derivative: what an empty ball does to bins bends within 1e-2 of its width by 10 %."""
    amount = CATALOGUE[name].step * CATALOGUE[name].width
    _, bins, _ = change(name, amount)
    assert_allclose(amount * stored[0][name].bins, bins, atol=0.05 * np.abs(bins).max(), rtol=0)


@pytest.mark.thorough(but_first=6)
@pytest.mark.parametrize("name", DERIVABLE)
def test_the_gel_moves_as_its_derivative_says(stored, name):
    """Within 2 % of the largest; displacements of 0.6 mm are kept as float32: a change has 1e-7 mm of rounding."""
    amount = CATALOGUE[name].step * CATALOGUE[name].width
    *_, gel = change(name, amount)
    found = amount * stored[0][name].gel
    assert found.shape == gel.shape
    assert_allclose(found, gel, atol=0.02 * np.abs(gel).max() + 1e-7, rtol=0)


@pytest.mark.parametrize("share", [0.5, 2.0])
@pytest.mark.parametrize("name", SUBTRACTED)
def test_a_subtracted_derivative_predicts_other_amounts_than_its_own(stored, name, share):
    """Such a derivative is the very difference that the test above takes: here against half and twice its amount."""
    amount, derivative = share * CATALOGUE[name].step * CATALOGUE[name].width, stored[0][name]
    total, bins, _ = change(name, amount)
    size = np.linalg.norm(total, axis=1).max()
    assert_allclose(amount * derivative.total, total, atol=0.05 * size)
    assert_allclose(amount * derivative.bins, bins, atol=0.05 * np.abs(bins).max(), rtol=0)


def test_which_derivatives_are_subtracted(stored, request):
    """Those that are the difference of two solutions to rounding; all others are followed next to the base.

    By default of those that other tests here solve for.
    """
    asked = DERIVABLE if request.config.getoption("--thorough") else {*DERIVABLE[:10], *SUBTRACTED}
    apart = []
    for name in filter(asked.__contains__, DERIVABLE):
        amount = CATALOGUE[name].step * CATALOGUE[name].width
        total, *_ = change(name, amount)
        if np.allclose(amount * stored[0][name].total, total, rtol=1e-9, atol=0):
            apart.append(name)
    assert apart == SUBTRACTED


def test_adhesion_and_a_base_that_yields_have_derivatives_of_their_own():
    # A base that yields has its own forces and derivatives. Next to it nothing can be followed: differences of
    # cells, as d Fz / d gel without any compliance but for a little
    study = specimens.study(**TIGHT)
    yielding = CATALOGUE["frame_compliance"](study, 0.05)
    cell = simulate_cell(yielding, specimens.STUDY_LAWS, PLANNED)
    variations = variations_of(yielding, specimens.STUDY_LAWS, ["gel_stiffness"])
    plain, found = derivatives(yielding, specimens.STUDY_LAWS, PLANNED, variations)
    assert_allclose(plain.arrays["total_force_N"], cell.arrays["total_force_N"], rtol=1e-9, atol=1e-12)
    held = sensitivities(study, specimens.STUDY_LAWS, PLANNED, ["gel_stiffness"])["gel_stiffness"].total
    assert_allclose(found["gel_stiffness"].total, held, atol=0.1 * np.abs(held).max())

    # Adhesion does nothing on loading. Its cohesion begins where a node has touched: derivatives of a press
    # without unloading are nothing
    found = sensitivities(study, specimens.STUDY_LAWS, PLANNED, ["adhesion"])["adhesion"]
    amount = CATALOGUE["adhesion"].width
    force = simulate_cell(study, specimens.STUDY_LAWS, PLANNED).arrays["total_force_N"]
    assert np.abs(amount * found.total).max() < 1e-7 * np.abs(force).max()


def test_shapes_and_sums(stored):
    by_name, _ = stored
    for name, derivative in by_name.items():
        steps = len(path_of(name).depths_mm)
        assert derivative.total.shape == (steps, 3) and derivative.bins.shape == (steps, 100, 3)
        size = np.abs(derivative.total).max()
        assert_allclose(derivative.bins.sum(axis=1), derivative.total, atol=1e-6 * size + 1e-7)
        assert derivative.seconds > 0


@pytest.mark.parametrize("name", ["frictionless", "gel_stifness"])
def test_what_has_no_derivative_is_refused_with_what_has(name):
    with pytest.raises(ConfigError, match="gel_stiffness"):
        sensitivities(specimens.study(), specimens.STUDY_LAWS, PLANNED, [name])


def test_they_are_stored_on_request_with_one_solution(tmp_path, monkeypatch):
    # They are stored on request
    names = ["gel_stiffness", "friction"]
    study = specimens.study(sensitivities=names, error_bars=False)
    cell = simulate_label(study, specimens.STUDY_LAWS, {}, PLANNED)
    write_cell(tmp_path / "c.h5", cell)
    back = read_cell(tmp_path / "c.h5")
    assert list(back.attributes["sensitivity_names"]) == names
    assert list(back.attributes["sensitivity_units"]) == ["N per 1", "N per 1"]
    assert back.arrays["sensitivity_total"].shape == (2, 2, 3)
    assert back.arrays["sensitivity_total"][0, -1, 2] < 0  # a stiffer gel pushes back harder
    plain = simulate_label(specimens.study(error_bars=False), specimens.STUDY_LAWS, {}, PLANNED)
    assert not any("sensitivity" in key for key in [*plain.arrays, *plain.attributes])

    # Those of the gel are stored where its displacement is
    study = specimens.study(sensitivities=["contact_zero"], error_bars=False, store_displacement=True)
    write_cell(tmp_path / "c.h5", simulate_label(study, specimens.STUDY_LAWS, {}, PLANNED))
    arrays = read_cell(tmp_path / "c.h5").arrays
    gel = arrays["sensitivity_gel_displacement"]
    assert gel.shape == (1, *arrays["gel_displacement_mm"].shape)
    # Pressed deeper by a little, the gel under the ball goes down by most of that.
    down = gel[0, :, :, 2].min(axis=1)
    assert (down > -1.1).all() and (down < -0.5).all()
    assert "sensitivity_gel_displacement" not in read_cell(_without_gel(tmp_path)).arrays

    # A site with derivatives is solved once
    starts, start_at = [], Press.start_at
    monkeypatch.setattr(Press, "start_at", lambda self, centre: starts.append(self) or start_at(self, centre))
    study = specimens.study(sensitivities=["gel_stiffness"], error_bars=False)
    assert "sensitivity_total" in simulate_label(study, specimens.STUDY_LAWS, {}, PLANNED).arrays
    assert len(starts) == 1


def _without_gel(folder):
    study = specimens.study(sensitivities=["contact_zero"], error_bars=False)
    write_cell(folder / "forces.h5", simulate_label(study, specimens.STUDY_LAWS, {}, PLANNED))
    return folder / "forces.h5"


@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"kinematics": {"frame_compliance_mm_per_N": 0.02}},
        {"geometry": {"prestretch": {"gel": [1.01, 1.01]}}},
    ],
    ids=["plain", "machine that yields", "residual stretch"],
)
def test_a_site_lends_its_own_solution(effects):
    """Derivatives along the solution at hand are those of a site that is solved anew, down to the last digit."""
    study = specimens.study(effects=effects)
    cell, solution = solved_cell(study, specimens.STUDY_LAWS, PLANNED)
    assert cell.converged
    own, anew = (
        sensitivities(study, specimens.STUDY_LAWS, PLANNED, ["gel_stiffness", "friction"], lent)
        for lent in (solution, None)
    )
    for name, one in anew.items():
        assert np.array_equal(own[name].total, one.total) and np.array_equal(own[name].bins, one.bins)
    force = np.linalg.norm(cell.arrays["total_force_N"], axis=1)
    assert (
        np.linalg.norm(anew["gel_stiffness"].total, axis=1) < 2 * force
    ).all()  # that of all moduli is the force
