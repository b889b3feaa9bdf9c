"""Single readings far off all others: found whatever is hidden, reported, and never taken from what an effect does."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from artificial_problem import SETTINGS, problem_of

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.inference.judge import judge
from gelforge.mismatch.inference.scan import _with_room, spikes, without_spikes


def struck(size, where, seed=7, context=None):
    """Return a context in which readings (reading, axis) are off by a size [standard deviations of the noise]."""
    base = context or artificial.context(seed, per_side=3)
    force = base.observations.force.copy()
    for reading, axis in where:
        force[reading, axis] += size * base.observations.noise_N[reading, axis]
    return replace(base, observations=replace(base.observations, force=force))


def calmed(context):
    problem = problem_of(context)
    return without_spikes(context.observations, context.force, problem.covariance)


def strong(name):
    """Return a context that hides four plausible values of an effect."""
    base, effect = artificial.context(11, per_side=3), CATALOGUE[name]
    theta = [4 * p.width * (p.sign or 1) for p in effect.parameters]
    return artificial.with_effect(base, name, theta, np.random.default_rng(12))


def test_how_far_is_what_others_say_and_a_struck_reading_is_found_beside_an_effect():
    # How far is what the other readings say of one
    problem = problem_of(struck(12.0, [(200, 2)]))
    found = spikes(problem)
    ((entry, away),) = found.items()
    white = _with_room(problem).whiten(np.eye(len(problem.residual)))
    C, r = np.linalg.inv(white.T @ white), problem.residual
    others = np.delete(np.arange(len(r)), entry)
    weights = np.linalg.solve(C[np.ix_(others, others)], C[others, entry])
    expected = (r[entry] - weights @ r[others]) / np.sqrt(C[entry, entry] - weights @ C[others, entry])
    assert away == pytest.approx(expected, rel=1e-3)  # C is an inverse of an inverse

    # A struck reading is found next to a strong effect
    assert np.argwhere(~calmed(struck(15.0, [(200, 2)], context=strong("gel_stiffness"))).read).tolist() == [
        [200, 2]
    ]


@pytest.mark.parametrize(("reading", "axis"), [(40, 0), (200, 2), (301, 1)])
def test_a_struck_reading_is_set_aside_and_told(reading, axis):
    context = struck(-15.0, [(reading, axis)])
    calm = calmed(context)
    assert np.argwhere(~calm.read).tolist() == [[reading, axis]]
    (told,) = calm.set_aside
    row = context.observations.table.iloc[reading]
    assert f"{told.session}/{told.press}" == row["press"] and told.time_s == row["time_s"]
    assert told.axis == "xyz"[axis] and told.depth_mm == row["depth_mm"] and 8 < told.size < 20
    assert np.array_equal(calm.force[calm.read], context.observations.force[calm.read])


@pytest.mark.thorough(but_first=2)
@pytest.mark.parametrize(
    "name", ["mullins", "viscoelastic", "adhesion", "lateral_play", "contact_zero", "tilt"]
)
def test_nothing_is_taken_from_what_an_effect_does(name):
    context = strong(name)
    assert spikes(problem_of(context)) == {} and calmed(context) is context.observations


def test_what_several_readings_share_is_no_glitch():
    """The first touch alone reads less, at all places alike."""
    base = artificial.context(7, per_side=3)
    table = base.observations.table
    first = (table["phase"] == "unload") & (table["depth_mm"] == table["depth_mm"].min())
    assert spikes(problem_of(struck(10.0, [(k, 2) for k in np.flatnonzero(first)]))) == {}

    # A reading that falls into the next step is no glitch
    base = artificial.context(7, per_side=3, noise_N=(0.0005,) * 3)
    seen, step = base.observations, 0.01
    rounded = np.rint(seen.force / step) * step
    seen = replace(
        seen, force=rounded, noise_N=np.full((len(rounded), 3), step / 10), rounding_N=step / 12**0.5
    )
    assert spikes(problem_of(replace(base, observations=seen))) == {}

    # Several of one press are no glitch
    press = artificial.context(7, per_side=3).observations.table["press"].eq("s1/p8")
    first, *_, last = np.flatnonzero(press)
    context = struck(15.0, [(first, 2), (last, 2)])
    assert calmed(context) is context.observations

    # What strikes many presses is no glitch
    table = artificial.context(7, per_side=3).observations.table
    struck_at = table.groupby("press").head(1).index[::2]
    context = struck(25.0, [(k, 2) for k in struck_at])
    assert len(spikes(problem_of(context))) > 1 and calmed(context) is context.observations


@pytest.mark.thorough
def test_one_struck_reading_is_no_mismatch():
    """With it something would differ from press to press; without it there is nothing to explain."""
    context = struck(15.0, [(200, 2)])
    assert judge(problem_of(context), SETTINGS, seed=1).state != "consistent"
    calm = replace(context, observations=calmed(context))
    assert judge(problem_of(calm), SETTINGS, seed=1).state == "consistent"
