"""Blunders are found before physics is blamed: another unit, other axes; and what no force can tell from a gain."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from artificial_problem import judged
from numpy.testing import assert_allclose

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.effects.force_frame import READ
from gelforge.mismatch.summary.words import sentence_of
from gelforge.mismatch.thresholds import DETECTED_SNR


def read_with(name, hyperparameters, seed=7):
    """Return the context of readings with a switch on."""
    base = artificial.context(seed, per_side=3)
    force = CATALOGUE[name].to_forces(base, hyperparameters, base.force, np.array([1.0]))
    return artificial.read(base, force, np.random.default_rng(seed + 1))


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize("axes", READ)
def test_lateral_axes_that_are_others_are_named_and_no_physics_is(axes):
    problem, found = judged(read_with("force_frame", {"axes": axes}))
    assert found.state == "identified"
    (part,) = found.answer.fit.parts
    assert (part.name, part.hyperparameters) == ("force_frame", {"axes": axes})
    assert f"Forces are recorded in another frame than assumed ({axes})" in sentence_of(problem, found)


@pytest.mark.thorough
@pytest.mark.parametrize("unit", ["kgf", "lbf"])
def test_another_unit_comes_first(unit):
    _, found = judged(read_with("force_unit", {"unit": unit}))
    assert found.answer.fit.parts[0].name == "force_unit"
    assert found.answer.fit.parts[0].hyperparameters == {"unit": unit}


def test_all_other_axes_are_tried_and_data_entry_errors_say_nothing_of_what_readings_could_see():
    # All other axes are the other seven ways to lay a square on itself
    turns = {tuple(np.array(way).ravel()) for way in READ.values()}
    assert len(turns) == 7 and (1, 0, 0, 1) not in turns
    for way in READ.values():
        assert_allclose(np.array(way) @ np.array(way).T, np.eye(2))

    # Data entry errors say nothing of what the readings could have seen. A unit is seen by any reading; were it
    # counted, readings that see no physics would say that none is missing
    loud = artificial.context(3, per_side=3)
    noise = replace(loud.observations, noise_N=60 * loud.observations.noise_N)
    context = artificial.read(replace(loud, observations=noise), loud.force, np.random.default_rng(4))
    tried = {"force_unit", "gel_stiffness"}
    problem, found = judged(context, left_out=set(CATALOGUE) - tried)
    seen = {one.name: one.plausible_snr > DETECTED_SNR for one in found.posterior.singles.values()}
    assert seen == {"force_unit": True, "gel_stiffness": False}
    assert found.state == "inconclusive"
    assert {candidate.name for candidate in problem.physics} == {"gel_stiffness"}


@pytest.mark.thorough
def test_a_common_gain_and_the_stiffness_of_all_layers_are_one_group():
    base = artificial.context(7, per_side=3)
    gained = artificial.read(base, 1.06 * base.force, np.random.default_rng(8))
    _, found = judged(gained)
    (group,) = found.answer.groups
    assert found.state == "identified" and {"force_gain", "body_stiffness"} <= set(group.members)
