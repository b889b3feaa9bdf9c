"""Looking ahead: planned readings, and what dead weights would tell apart."""

import numpy as np
import pytest
import specimens

from gelforge.config import study_from
from gelforge.config.basis.variants import merged
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.identifiability import next_experiment
from gelforge.mismatch.pipeline.experiments import planned_observations, survivor, weights
from gelforge.mismatch.result.verdict import NamedEffect, ParameterEstimate

STUDY = specimens.study()


def effect(name, *values):
    theta = [
        ParameterEstimate(name=p.name, unit=p.unit, value=v, interval_90=(v - 0.02, v + 0.02))
        for p, v in zip(CATALOGUE[name].parameters, values)
    ]
    family = CATALOGUE[name].family
    return NamedEffect(
        name=name, family=family, probability=0.4, log_bayes_factor=9.0, parameters=theta, in_range=True
    )


def test_dead_weights_tell_a_gain_and_the_spread_of_a_cut_range_is_read_from_the_other_side():
    # Dead weights tell a gain from a stiffness and not two stiffnesses
    gain, gel, skin = (
        effect("force_gain", 0.0, 0.0, 0.15),
        effect("gel_stiffness", 0.2),
        effect("skin_stiffness", 0.3),
    )
    plan = weights(STUDY, [gain, gel, skin])
    (decided,) = next_experiment([plan], survivor(gain), survivor(gel))
    assert decided.decides
    (blind,) = next_experiment([plan], survivor(gel), survivor(skin))
    assert blind.expected_log_odds == pytest.approx(0.0, abs=1e-9) and not blind.decides

    # The spread of what is cut at its range is read from the other side. Of 90 % intervals: 1.645 standard
    # deviations to a side; cut on both, or stated beyond its range, it is the prior's

    def spread(value, low, high):
        void = effect("void", value)
        cut = void.parameters[0].model_copy(update={"interval_90": (low, high)})
        return float(np.sqrt(survivor(void.model_copy(update={"parameters": [cut]})).covariance[0, 0]))

    top, width = CATALOGUE["void"].parameters[0].bounds[1], CATALOGUE["void"].parameters[0].width
    assert spread(0.9, 0.9 - 0.1645, top) == pytest.approx(0.1, rel=1e-3)
    assert spread(0.1, 0.0, 0.1 + 0.329) == pytest.approx(0.2, rel=1e-3)
    assert spread(0.5, 0.0, top) == spread(1.6, top, top) == width


def test_planned_readings_are_those_that_would_be_judged():
    planned = planned_observations(STUDY, dwell_s=(1.0, 2.0), ways_up=(0.5,), ages_days=(0.0, 30.0))
    table = planned.table
    presses = table.drop_duplicates("press")
    assert len(presses) == 2 * 9 * 2  # sessions, 3 x 3 positions, depths
    assert set(table["phase"]) == {"load", "dwell", "unload"} and set(table["age_days"]) == {0.0, 30.0}
    assert np.all(np.diff(table["time_s"]) > 0)
    up = table[table["phase"] == "unload"]
    assert np.allclose(up["depth_mm"], 0.5 * up["deepest_mm"])
    assert presses["site"].is_monotonic_increasing is False
    assert planned.read.all() and not planned.force.any()
    assert (
        not planned.press_depth_mm.any() and planned.session_depth_mm.all()
    )  # as session.yaml has it by default

    # Planned readings are those that would be judged
    few = study_from(
        merged(
            STUDY.model_dump(mode="json"),
            {
                "plan": {"depths_mm": [0.2, 0.4, 0.6, 0.8]},
                "mismatch": {"depths": 3, "contact_point_scatter_mm": 0.005},
            },
        )
    )
    planned = planned_observations(few)
    assert planned.table["deepest_mm"].nunique() == 3 and (planned.session_depth_mm == 0.005).all()
