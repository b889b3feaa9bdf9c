"""Friction by pressure and a force sensor that lags, with a free form: their maps do what they say. ARTIFICIAL readings."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
import specimens
from artificial_problem import SETTINGS
from test_modules import candidates, module, problem

from gelforge.mismatch.effects.force_hysteresis import largest_so_far
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.free_forms import friction, modules_of
from gelforge.mismatch.free_forms.force_hysteresis import BANDS, COUNT, _of_map
from gelforge.mismatch.inference.judge import judge


def friction_changes(context):
    """Return the changes by the exponents at each reference pressure, as the solver would give them."""
    law = context.observations.flat(context.derivative("friction_law"))
    own = friction.TERM
    return [
        Candidate(
            own.name, hyperparameters, (1.0 + k) * law[:, None] ** (1 + 2 * k), own.prior_sd, np.zeros(1, int)
        )
        for k, hyperparameters in enumerate(own.grid(context))
    ]


def test_a_study_has_the_friction_that_makes_the_map_about_its_own():
    # A study has the friction that makes the map
    context = replace(artificial.context(3, per_side=3), study=specimens.study())
    own = next(one for one in modules_of(context, friction_changes(context)) if one.name == "friction")
    theta = np.array([0.3, 0.4, -0.2, 0.1])
    study, before = own.to_study(context.study, own.basis @ theta), context.study.mechanics
    terms = study.mechanics.effects.contact.pressure_terms
    assert [term.exponent for term in terms] == pytest.approx(friction.WIDTH * theta[1:])
    assert [term.reference_pressure_MPa for term in terms] == pytest.approx([1e-3, 1e-2, 1e-1])
    (excess,) = artificial.CATALOGUE["friction"].prior_sd
    assert study.mechanics.friction == pytest.approx(before.friction + 0.3 * excess)
    # the map is the coefficient's own change, where it is small
    small = 1e-4 * theta
    study, p = own.to_study(context.study, own.basis @ small), own.map["pressure_MPa"].to_numpy()
    mu = study.mechanics.friction * np.prod(
        [
            (1 + p / one.reference_pressure_MPa) ** -one.exponent
            for one in study.mechanics.effects.contact.pressure_terms
        ],
        axis=0,
    )
    assert mu - before.friction == pytest.approx(own.basis @ small, rel=2e-3)
    # more of it comes next to what the study has
    again = own.to_study(study, own.basis @ small).mechanics.effects.contact.pressure_terms
    assert len(again) == 6
    assert own.to_study(context.study, 0 * p) == context.study
    # what no study can have stays on its bounds, and the patch is written
    much = own.to_study(context.study, own.basis @ [50.0, 20.0, -20.0, 1.0]).mechanics
    assert much.friction == 2.0
    assert [one.exponent for one in much.effects.contact.pressure_terms] == pytest.approx([0.99, -0.99, 0.2])

    # A map of friction is about the study's own if it has any
    falls = {"effects": {"contact": {"pressure_exponent": 0.5}}}
    context = replace(artificial.context(3, per_side=3), study=specimens.study(**falls))
    own = next(one for one in modules_of(context, friction_changes(context)) if one.name == "friction")
    p = own.map["pressure_MPa"].to_numpy()
    assert own.basis[:, 0] == pytest.approx(excess * (1 + p / 0.01) ** -0.5)

    # A base without friction has none of another pressure
    context = replace(artificial.context(3, per_side=3), study=specimens.study(friction=0.0))
    assert not friction.TERM.applies(context.study)
    assert "friction" not in {one.name for one in modules_of(context, ())}


def lagging(base, size=0.06):
    """Return the forces as read along z by a sensor whose loop opens late: with the third power of what is gone."""
    peak = largest_so_far(base, base.force)
    gone = np.clip(1 - np.divide(base.force, peak, out=np.ones_like(peak), where=peak != 0), 0.0, 1.0)
    return base.force + size * peak * gone**3 * (np.arange(3) == 2)


def test_a_force_sensor_that_lags_opens_as_on_the_map_if_presses_are_unloaded():
    # A force sensor that lags in another form lags
    hidden = problem(lagging)
    found = judge(hidden, SETTINGS, seed=1)
    assert found.state == "identified" and found.model.module.name == "force_hysteresis"
    assert found.posterior.holding(["force_hysteresis"]) > 0.9

    # Openings on the map are those of the readings. A press to the largest force and back to a half, read by bands
    # and openings, is what the map says of it
    base = artificial.context(3, per_side=3)
    own = module(base, "force_hysteresis")
    table, z = base.observations.table, np.abs(base.force[:, 2])
    flat = base.observations.flat
    deepest = table["press"][int(np.argmax(z))]
    rows = np.flatnonzero((table["press"] == deepest).to_numpy())
    labels = base.observations.labels()
    up = next(i for i in rows if table["phase"][i] == "unload" and z[i] < 0.9 * z[rows].max())
    at = (labels["reading"] == up).to_numpy() & (labels["axis"] == 2).to_numpy()
    peak, left = z[rows].max() / z.max(), z[up] / z[rows].max()
    here = _of_map(np.array([peak]), np.array([left]), artificial.CATALOGUE["force_hysteresis"].prior_sd[0])[
        0
    ]
    q = len(here)
    directions = own.directions[at][0, 2 * q :] / (np.sign(base.force[up, 2]) * z.max())
    # bands lag behind during loading too, where openings are none: of these the map has the whole width
    assert directions[len(BANDS) :] == pytest.approx(here[len(BANDS) :], rel=1e-9)
    halves = here[: len(BANDS)] / 2
    assert directions[: len(BANDS)] == pytest.approx(halves, rel=1e-6)
    assert not own.directions[at][0, : 2 * q].any()
    loading = flat((table["phase"] == "load").to_numpy()[:, None] * np.ones((1, 3))).astype(bool)
    powers = np.concatenate([k * q + np.arange(len(BANDS), q) for k in range(3)])
    assert np.abs(own.directions[loading][:, powers]).max() < 1e-9 * np.abs(own.directions[:, powers]).max()

    # Without unloading no lag can show
    up = (base.observations.table["phase"] != "unload").to_numpy()
    kept = replace(base, observations=base.observations.chosen(up), force=base.force[up])
    assert "force_hysteresis" not in {one.name for one in modules_of(kept, candidates(kept))}


@pytest.mark.parametrize("peak", [0.25, 1.0])
@pytest.mark.parametrize("left", [0.25, 0.75])
def test_bands_on_the_map_open_as_a_reading_that_stays_within_a_band(peak, left):
    """Also where the band is so wide that it is not crossed before the force is read again."""
    width = 0.04  # bands of a hundredth to a third of the largest force
    found = _of_map(np.array([peak]), np.array([left]), width)[0, : len(BANDS)] * np.sqrt(COUNT)
    up = np.linspace(0, peak, 2001)
    for k, half in enumerate(width * np.array(BANDS)):
        shown, path = [0.0], np.r_[up, up[::-1]]
        for force in path[1:]:
            shown.append(float(np.clip(shown[-1], force - half, force + half)))
        at = np.flatnonzero(np.isclose(path, left * peak, atol=1e-9))
        assert found[k] == pytest.approx(shown[at[-1]] - shown[at[0]], abs=1e-9)
