"""The law for what nothing explains: found when planted, none when there is nothing, and never called a cause."""

from itertools import combinations

import numpy as np
import pytest
from artificial_readings import covariance_of, flat_base, grid, readings
from scipy.stats import multivariate_normal

from gelforge.mismatch.holdout import conditional_gram
from gelforge.mismatch.law_search import LABEL, WIDTH, Terms, _gains, search, terms


@pytest.fixture(scope="module")
def world():
    context = readings(grid(4), depths=(0.5, 1.0, 1.5, 2.0))
    labels, base = context.observations.labels(), flat_base(context)
    return (
        labels,
        base,
        covariance_of(context),
        terms(labels, base, radius_mm=5.0, height_mm=9.0, widths_mm=(32.0, 32.0)),
    )


def column(candidates, name):
    return candidates.values[:, candidates.names.index(name)]


def test_terms_are_dimensionless_times_a_force(world):
    labels, base, _, found = world
    assert len(set(found.names)) == found.values.shape[1] == len(found.names)
    assert np.abs(found.values).max() <= np.abs(base).max() * (1 + 1e-12)
    # Lengths in another unit, forces unchanged: the same terms.
    scaled = labels.assign(**{name: labels[name] * 10 for name in ("depth_mm", "x_mm", "y_mm")})
    same = terms(scaled, base, radius_mm=50.0, height_mm=90.0, widths_mm=(320.0, 320.0))
    np.testing.assert_allclose(same.values, found.values, rtol=1e-12)
    np.testing.assert_allclose(column(found, "(depth/radius)^2 F_base"), (labels["depth_mm"] / 5) ** 2 * base)


def test_one_planted_term_is_found(world):
    labels, _, covariance, found = world
    r = 0.3 * column(found, "(x/half width) F_base") + covariance.draw(np.random.default_rng(1), 1)[:, 0]
    law = search(r, covariance, found, labels)
    assert law.terms == ("(x/half width) F_base",)
    assert abs(law.coefficients[0] - 0.3) < 3.5 * law.standard_deviations[0]
    assert law.gain > 2 * law.standard_error
    assert LABEL in law.text and law.label == "a law, not a cause"


def test_two_planted_terms_are_found(world):
    labels, _, covariance, found = world
    names = ("(x/half width) F_base", "(order/last)^1 F_max e_y")
    r = 0.4 * column(found, names[0]) + 0.08 * column(found, names[1])
    r = r + covariance.draw(np.random.default_rng(2), 1)[:, 0]
    assert set(search(r, covariance, found, labels).terms) == set(names)


def test_nothing_gives_no_terms(world):
    labels, _, covariance, found = world
    draws = covariance.draw(np.random.default_rng(3), 40)
    laws = [search(r, covariance, found, labels, seed=k) for k, r in enumerate(draws.T)]
    named = sum(bool(law.terms) for law in laws)
    # Without paying for the thousands of subsets looked at more than half of these would be given a law.
    assert named <= 4
    assert all("residual = 0" in law.text for law in laws if not law.terms)


def test_gains_are_those_of_dense_matrices():
    context = readings(grid(2))
    labels, base, covariance = context.observations.labels(), flat_base(context), covariance_of(context)
    rng = np.random.default_rng(4)
    T = Terms(("a", "b", "c"), base[:, None] * rng.normal(size=(len(base), 3)))
    r = 0.2 * T.values[:, 0] + covariance.draw(rng, 1)[:, 0]
    held = (labels["site"] == 2).to_numpy()
    V = np.column_stack([r, WIDTH * T.values])
    train = covariance.restricted(~held).whiten(V[~held])
    subsets = [(), (0,), (1,), (2,), *combinations(range(3), 2)]
    found = _gains(train.T @ train, conditional_gram(V, covariance, ~held, held)[0], subsets)
    W = covariance.whiten(np.eye(len(r)))
    C = np.linalg.inv(W.T @ W)

    def predictive(K):
        t = np.ix_(~held, ~held)
        return multivariate_normal.logpdf(r, cov=K) - multivariate_normal.logpdf(r[~held], cov=K[t])

    for subset, value in zip(subsets, found):
        J = WIDTH * T.values[:, list(subset)]
        assert value == pytest.approx(predictive(C + J @ J.T) - predictive(C), abs=1e-6)


def test_one_site_has_nothing_to_hold_out():
    context = readings(grid(1))
    labels, base, covariance = context.observations.labels(), flat_base(context), covariance_of(context)
    with pytest.raises(ValueError, match="two sites"):
        search(base, covariance, terms(labels, base, 5.0, 9.0, (32.0, 32.0)), labels)
