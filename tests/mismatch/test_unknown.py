"""Something that no effect of the catalogue is: its covariance against a dense one, and effects that it beats or not."""

import artificial
import numpy as np
import pytest
from artificial_problem import LOCATED, SETTINGS, judged, problem_of
from numpy.testing import assert_allclose

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.gaussian import UNKNOWN
from gelforge.mismatch.evidence.kernels import kernels_of, modes, weighed_unknown
from gelforge.mismatch.inference.judge import judge
from gelforge.mismatch.inference.posterior import weighed
from gelforge.mismatch.summary.words import sentence_of
from gelforge.mismatch.thresholds import PLAUSIBLE


def problem_with(name, theta, seed=7, **keys):
    base = artificial.context(seed, per_side=3)
    rng = np.random.default_rng(seed + 1)
    return problem_of(artificial.with_effect(base, name, np.array(theta, dtype=float), rng), **keys)


def displaced(seed=7, size_mm=0.8):
    """Return a context whose presses each arrive displaced, one way or the other, by what no effect knows."""
    base, rng = artificial.context(seed, per_side=3), np.random.default_rng(seed)
    rows = base.observations.table
    press = np.unique(rows["press"], return_inverse=True)[1]
    dx, dy = size_mm * rng.choice([-1.0, 1.0], (2, press.max() + 1))[:, press]
    forces = artificial.force(rows["x_mm"] + dx, rows["y_mm"] + dy, rows["depth_mm"].to_numpy())
    return artificial.read(base, forces, rng)


def test_cosines_are_smooth_and_each_manner_is_as_large_as_is_plausible():
    # Cosines are a random function of unit size that is smooth
    values = np.linspace(3.0, 7.0, 4001)
    K = modes(values, 40) @ modes(values, 40).T
    assert_allclose(np.mean(np.diag(K)), 1.0, rtol=2e-3)  # 4001 points: the ends count once too often
    alike = K[0] / np.sqrt(K[0, 0] * np.diag(K))
    assert alike[100] > 0.99 and alike[4000] < 0.5  # a fortieth of the range away, and the other end
    assert np.array_equal(modes(np.full(5, 2.0), 6), np.ones((5, 1)))

    # Each manner adds the product of its directions
    problem = problem_of(artificial.context(3, per_side=3))
    rows = np.random.default_rng(1).permutation(len(problem.labels))[:150]
    mask = np.isin(np.arange(len(problem.labels)), rows)
    for kernel in kernels_of(problem):
        wider = kernel.added_to(problem.covariance, 0.3).restricted(mask)
        plain, U = problem.covariance.restricted(mask), 0.3 * kernel.directions[mask]
        eye = np.eye(mask.sum())
        added = U @ U.T
        if kernel.groups is not None:
            added *= kernel.groups[mask][:, None] == kernel.groups[mask]
        inverse = wider.whiten(eye).T @ wider.whiten(eye)
        dense = np.linalg.inv(plain.whiten(eye).T @ plain.whiten(eye)) + added
        assert_allclose(dense @ inverse, eye, atol=1e-5)
        assert wider.log_det == pytest.approx(np.linalg.slogdet(dense)[1], abs=1e-5)

    # A manner is as large as is plausible. The pressing force differs by PLAUSIBLE of itself, root mean square,
    # whatever the coordinate
    z = (problem.labels["axis"] == 2).to_numpy()
    F = problem.observations.flat(problem.base)
    sizes = {
        m.words: np.sqrt((m.directions[z] ** 2).sum() / (F[z] ** 2).sum())
        for m in kernels_of(problem)
        if "pressing" in m.words
    }
    assert {words.split(" ", 3)[3] for words in sizes} == {
        "with depth", "from place to place", "from one indentation to the next", "over the session's time",
        "along an indentation's path",
    }  # fmt: skip
    assert all(0.5 * PLAUSIBLE < size < 1.5 * PLAUSIBLE for size in sizes.values()), sizes


@pytest.mark.thorough
def test_of_nulls_nothing_unknown_is_likely_and_what_differs_by_press_has_no_name():
    # Of nulls nothing unknown is likely. Evidence against the true model exceeds e^3 in at most e^-3 of recordings,
    # whatever the other (Markov): 1.5 of 30
    found = [problem_of(artificial.context(seed, per_side=3)) for seed in range(30)]
    factors = [weighed_unknown(problem, kernels_of(problem)).log_bayes_factor for problem in found]
    assert np.median(factors) < -1
    assert np.sum(np.array(factors) > 3.0) <= 5  # more in one of 200 such runs

    # What differs from press to press has no name and its manner is reported
    problem, found = judged(displaced())
    assert found.state in ("unexplained",)
    assert found.posterior.holding([UNKNOWN]) > 0.9
    assert "from one indentation to the next" in found.posterior.discrepancy_words
    assert len(sentence_of(problem, found).split()) <= 25


@pytest.mark.thorough(but_first=2)
@pytest.mark.parametrize(
    ("name", "theta"),
    [
        ("misregistration", [0.8, 0.3]),
        ("contact_zero", [0.08]),
        ("viscoelastic", [0.3]),
        ("tilt", [1.0, 0.5]),
    ],
)
def test_an_effect_that_is_right_is_likelier_than_something_unknown_and_leaves_it_nothing(name, theta):
    problem = problem_with(name, theta)
    kernels = kernels_of(problem)
    right = next(one for one in weighed(problem) if one.name == name)
    assert weighed_unknown(problem, kernels).log_bayes_factor < right.log_bayes_factor - 2
    # causes that these readings hardly show neither gain nor lose, and are among those that are averaged
    assert weighed_unknown(problem, kernels, right).log_bayes_factor < -0.5


def test_effects_that_only_happen_to_fit_are_less_likely_than_something_unknown():
    problem = problem_with("misregistration", [0.8, 0.3], left_out=LOCATED | {"misregistration"})
    kernels = kernels_of(problem)
    best = weighed(problem)[0]
    assert weighed_unknown(problem, kernels).log_bayes_factor > best.log_bayes_factor + 5
    assert weighed_unknown(problem, kernels, best).log_bayes_factor > 5


@pytest.mark.thorough
def test_evidence_for_something_unknown_is_a_test_and_a_pair_found_leaves_none():
    # Evidence for something unknown is a test of its own. Of half the backlash neither the sum of squares nor the
    # scan is certain
    _, found = judged(displaced(size_mm=0.4))
    assert min(found.mismatch.test.p, found.mismatch.scan.p) > 1e-3 > found.mismatch.unknown_p
    assert found.state not in ("consistent", "identified")

    # A pair that is found leaves nothing unknown
    base, rng = artificial.context(9, per_side=3), np.random.default_rng(10)
    zero = CATALOGUE["contact_zero"].to_forces(base, {}, base.force, np.array([0.06]))
    both = CATALOGUE["misregistration"].to_forces(base, {}, zero, np.array([0.8, 0.3]))
    problem = problem_of(artificial.read(base, both, rng))
    found = judge(problem, SETTINGS, seed=1)
    names = {name for group in found.answer.groups for name in group.names}
    assert {"contact_zero", "misregistration"} <= names
    assert found.posterior.holding([UNKNOWN]) < 0.5
