"""What has no name is modelled where it predicts what it has not seen, and nowhere else."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from artificial_problem import identified, problem_of
from numpy.testing import assert_allclose

from gelforge.mismatch.evidence.kernels import kernels_of
from gelforge.mismatch.inference.discrepancy import _LinearFit, modelled
from gelforge.mismatch.inference.holdout import split
from gelforge.mismatch.inference.judge import _next_to_cause

SEED = 23


@pytest.fixture(scope="module")
def base():
    return artificial.context(SEED, per_side=4)


def bends(context, size=0.06):
    """Return a problem whose pressing force is off by a share that falls and rises with depth, and that share (R,)."""
    depth = context.observations.table["depth_mm"].to_numpy(float)
    share = size * np.cos(2.0 * depth)
    force = context.observations.force.copy()
    force[:, 2] += share * context.force[:, 2]
    return problem_of(replace(context, observations=replace(context.observations, force=force))), share


def found_in(problem):
    return modelled(problem, kernels_of(problem), split(problem.labels, SEED))


def test_a_smooth_change_is_learnt_noise_is_not_and_its_size_is_averaged_over(base):
    # A smooth change is learnt and noise is not
    problem, share = bends(base)
    model = found_in(problem)
    assert model.held.shown and "depth" in model.kernel.words
    z = problem.labels["axis"].to_numpy() == 2
    true = problem.observations.flat(np.column_stack([0 * share, 0 * share, share * problem.base[:, 2]]))
    held = z & split(problem.labels, SEED).held["positions"]
    assert np.std((problem.residual - model.left)[held] - true[held]) < 0.6 * np.std(true[held])
    assert np.std((model.change - true)[z]) < 0.35 * np.std(true[z])

    # Noise is not modelled
    assert not found_in(problem_of(base)).held.shown

    # The size of a change is averaged over. Second moments are those of the scales' own posteriors, weighted by 0.4
    # of their log evidence
    problem, _ = bends(base)
    linear, few = _LinearFit.of(problem, None, None), np.arange(len(problem.labels)) % 40 == 0
    D = next(one for one in problem.modules if one.name == "depth_map").directions
    mean, covariance = linear.posterior(D, few)
    own = [(scale, *linear.learnt_by(scale * D, few)) for scale in (1.0, 0.3, 0.1)]
    weights = np.exp(0.4 * np.array([evidence for _, evidence, *_ in own]))
    assert weights.max() < 0.9 * weights.sum()  # so few readings leave the size open
    parts = [s**2 * (np.outer(m, m) + c) for s, _, m, c in own]
    together = np.tensordot(weights / weights.sum(), parts, 1)
    assert_allclose(np.outer(mean, mean) + covariance, together, rtol=0, atol=1e-9)
    assert_allclose(mean, np.tensordot(weights / weights.sum(), [s * m for s, _, m, _ in own], 1), atol=1e-9)


def test_effects_next_to_a_sure_cause_have_the_values_that_they_have_with_it():
    """Values and map are learnt together: what is reported, and patched, adds up to the figure after."""
    problem, found, _ = identified()
    answer, flat = found.answer, problem.observations.flat
    left = flat(problem.observations.force - answer.after)
    (cause,) = [one for one in problem.modules if one.name == "depth_map"]
    model = modelled(problem, [cause], found.blocks, answer.fit, left, {cause.words: 0.99})
    assert model.sure and model.with_effects
    again = _next_to_cause(problem, answer, model)
    step = np.concatenate(again.fit.theta) - np.concatenate(answer.fit.theta)
    effects = answer.fit.columns[:, : len(step)] @ step
    assert np.abs(effects).max() > 1e-4  # N
    assert_allclose(flat(again.after - answer.after), effects, rtol=0, atol=1e-9)
    assert_allclose(
        flat(problem.observations.force - again.after) - model.change, model.rest, rtol=0, atol=1e-9
    )
    grown, before = (np.diag(one.covariance) for one in (again.fit, answer.fit))
    assert (grown >= before).all() and (grown > before).any()  # a map next to them leaves the values no surer
    unphysical = replace(model, fit=replace(model.fit, theta=tuple(1e3 + a for a in model.fit.theta)))
    for other in (replace(model, probability=0.5), unphysical, None):
        assert _next_to_cause(problem, answer, other) is answer
