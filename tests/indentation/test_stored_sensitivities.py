"""Derivatives with respect to effects, as a cell stores them: against the solver, and in files."""

from functools import cache

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.config import ConfigError
from gelforge.indentation.cell_file import read_cell, write_cell
from gelforge.indentation.companion import simulate_label
from gelforge.indentation.effects.catalogue import CATALOGUE
from gelforge.indentation.plan import PlannedCell
from gelforge.indentation.sensitivities import derivable, derivatives, sensitivities, variations_of
from gelforge.indentation.simulate import simulate_cell

# An aged, warm session: else ageing and temperature have nothing to act on.
SESSION = {"material": {"circumstances": {"age_days": 10.0, "temperature_C": 33.0}}}
TIGHT = {
    "effects": SESSION,
    "solver": {"force_tolerance": 1e-9, "gap_tolerance_mm": 1e-7, "max_iterations": 80},
}
PLANNED = PlannedCell("place", 10.3, 9.2, (0.3, 0.6))
DERIVABLE = [name for name in CATALOGUE if derivable(name)]
# Their mesh, path or beginning is another: two solutions are subtracted, nothing is followed beside a base.
SUBTRACTED = ["elastic_base", "viscoelastic", "mullins", "prestretch", "frame_compliance", "base_bending"]


@pytest.fixture(scope="module")
def stored():
    """Return derivatives by name of all effects that have one, and the study."""
    study = specimens.study(**TIGHT)
    return sensitivities(study, specimens.STUDY_LAWS, PLANNED, DERIVABLE), study


@cache
def pressed(name, amount):
    """Return total and bin forces with an amount of an effect."""
    study = CATALOGUE[name](specimens.study(**TIGHT), amount)
    cell = simulate_cell(study, specimens.STUDY_LAWS, PLANNED)
    return {array: cell.arrays[array] for array in ("total_force_N", "bin_force_N")}


def change(name, amount):
    """Return how much total and bin forces change from no effect to an amount of it."""
    there, none = pressed(name, amount), pressed(name, 0.0)
    return there["total_force_N"] - none["total_force_N"], there["bin_force_N"] - none["bin_force_N"]


@pytest.mark.parametrize("name", DERIVABLE)
def test_a_derivative_predicts_what_a_little_of_the_effect_does(stored, name):
    """The issue: 1e-2 of a plausible width moves every total force by what the derivative predicts within 5 %."""
    amount = 1e-2 * CATALOGUE[name].width
    total, _ = change(name, amount)
    size = np.linalg.norm(total, axis=1).max()
    assert size > 0
    assert_allclose(amount * stored[0][name].total, total, atol=0.05 * size)


@pytest.mark.parametrize("name", DERIVABLE)
def test_bins_follow_their_derivatives_to_5_per_cent_of_the_largest(stored, name):
    """At the step of the effect's derivative: what an empty ball does to bins bends within 1e-2 of its width by 10 %."""
    amount = CATALOGUE[name].step * CATALOGUE[name].width
    _, bins = change(name, amount)
    assert_allclose(amount * stored[0][name].bins, bins, atol=0.05 * np.abs(bins).max(), rtol=0)


@pytest.mark.parametrize("share", [0.5, 2.0])
@pytest.mark.parametrize("name", SUBTRACTED)
def test_a_subtracted_derivative_predicts_other_amounts_than_its_own(stored, name, share):
    """Such a derivative is the very difference that the test above takes: here against half and twice its amount."""
    amount, derivative = share * CATALOGUE[name].step * CATALOGUE[name].width, stored[0][name]
    total, bins = change(name, amount)
    size = np.linalg.norm(total, axis=1).max()
    assert_allclose(amount * derivative.total, total, atol=0.05 * size)
    assert_allclose(amount * derivative.bins, bins, atol=0.05 * np.abs(bins).max(), rtol=0)


def test_which_derivatives_are_subtracted(stored):
    """Those that are the difference of two solutions to rounding; all others are followed beside the base."""
    apart = []
    for name in DERIVABLE:
        amount = CATALOGUE[name].step * CATALOGUE[name].width
        total, _ = change(name, amount)
        if np.allclose(amount * stored[0][name].total, total, rtol=1e-9, atol=0):
            apart.append(name)
    assert apart == SUBTRACTED


def test_a_base_that_yields_has_its_own_forces_and_derivatives():
    """Beside it nothing can be followed: differences of cells, as d Fz / d gel without any compliance but for a little."""
    study = specimens.study(**TIGHT)
    yielding = CATALOGUE["frame_compliance"](study, 0.05)
    cell = simulate_cell(yielding, specimens.STUDY_LAWS, PLANNED)
    variations = variations_of(yielding, specimens.STUDY_LAWS, ["gel_stiffness"])
    force, found = derivatives(yielding, specimens.STUDY_LAWS, PLANNED, variations)
    assert_allclose(force, cell.arrays["total_force_N"], rtol=1e-9, atol=1e-12)
    held = sensitivities(study, specimens.STUDY_LAWS, PLANNED, ["gel_stiffness"])["gel_stiffness"].total
    assert_allclose(found["gel_stiffness"].total, held, atol=0.1 * np.abs(held).max())


def test_shapes_and_sums(stored):
    by_name, _ = stored
    for derivative in by_name.values():
        assert derivative.total.shape == (2, 3) and derivative.bins.shape == (2, 100, 3)
        size = np.abs(derivative.total).max()
        assert_allclose(derivative.bins.sum(axis=1), derivative.total, atol=1e-6 * size + 1e-7)
        assert derivative.seconds > 0


@pytest.mark.parametrize("name", ["frictionless", "gel_stifness"])
def test_what_has_no_derivative_is_refused_with_what_has(name):
    with pytest.raises(ConfigError, match="gel_stiffness"):
        sensitivities(specimens.study(), specimens.STUDY_LAWS, PLANNED, [name])


def test_they_are_stored_on_request(tmp_path):
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
