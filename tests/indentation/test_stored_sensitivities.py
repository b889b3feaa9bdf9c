"""Derivatives with respect to effects, as a cell stores them: against the solver, and in files."""

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.config import ConfigError
from gelforge.indentation.cell_file import read_cell, write_cell
from gelforge.indentation.companion import simulate_label
from gelforge.indentation.effects.catalogue import CATALOGUE
from gelforge.indentation.plan import PlannedCell
from gelforge.indentation.sensitivities import derivable, sensitivities
from gelforge.indentation.simulate import simulate_cell

# An aged, warm session: else ageing and temperature have nothing to act on.
SESSION = {"material": {"circumstances": {"age_days": 10.0, "temperature_C": 33.0}}}
TIGHT = {
    "effects": SESSION,
    "solver": {"force_tolerance": 1e-9, "gap_tolerance_mm": 1e-7, "max_iterations": 80},
}
PLANNED = PlannedCell("place", 10.3, 9.2, (0.3, 0.6))
DERIVABLE = [name for name in CATALOGUE if derivable(name)]


@pytest.fixture(scope="module")
def stored():
    """Return derivatives by name of all effects that have one, and the study."""
    study = specimens.study(**TIGHT)
    return sensitivities(study, specimens.STUDY_LAWS, PLANNED, DERIVABLE), study


@pytest.mark.parametrize("name", DERIVABLE)
def test_a_derivative_predicts_what_a_little_of_the_effect_does(stored, name):
    """The issue: 1e-2 of a plausible width moves every total force by what the derivative predicts within 5 %."""
    derivatives, study = stored
    amount = CATALOGUE[name].step * CATALOGUE[name].width
    forces = [
        simulate_cell(CATALOGUE[name](study, a), specimens.STUDY_LAWS, PLANNED).arrays["total_force_N"]
        for a in (amount, 0.0)
    ]
    change, predicted = forces[0] - forces[1], amount * derivatives[name].total
    size = np.linalg.norm(change, axis=1).max()
    assert size > 0
    assert_allclose(predicted, change, atol=0.05 * size)


def test_shapes_and_sums(stored):
    derivatives, _ = stored
    for derivative in derivatives.values():
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
