"""Evidence of many sets at once is that of each by itself, and that of a linear model with normal values."""

from itertools import combinations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.gaussian import evidence, evidences
from gelforge.mismatch.evidence.screen import Candidate, judged_by
from gelforge.mismatch.inference.linear import Linear

N = 40


def candidates(rng, signs=(0, 1, -1)):
    found = []
    for k, columns in enumerate((1, 2, 1, 3)):
        values = rng.normal(size=(N, columns))
        sign = np.array([signs[(k + i) % len(signs)] for i in range(columns)])
        prior_sd = rng.uniform(0.2, 2.0, columns)
        found.append(Candidate(f"effect {k}", {}, values, prior_sd, sign))
    return [*found, Candidate("binary", {}, rng.normal(size=(N, 1)), np.ones(1), np.zeros(1), binary=True)]


@pytest.mark.parametrize("size", [1, 2, 3])
def test_many_sets_at_once_are_as_likely_as_each_by_itself(size):
    rng = np.random.default_rng(size)
    covariance = Covariance(rng.uniform(0.5, 2.0, N))
    tried = candidates(rng)
    residual = rng.normal(size=N) + tried[1].columns @ [0.4, -0.3]
    linear = Linear.of(residual, covariance, tried)
    sets = np.array([*combinations(range(len(tried)), size)])
    scales = np.where(linear.binary[sets], 1.0, 0.3)
    found = linear.log_bayes_factors(sets, scales)
    for own, scale, value in zip(sets, scales, found):
        parts = [
            Candidate(
                c.name, c.hyperparameters, c.columns, c.prior_sd * (1.0 if c.binary else s), c.signs, c.binary
            )
            for c, s in zip((tried[k] for k in own), scale)
        ]
        white = [covariance.whiten(part.columns) for part in parts]
        alone = judged_by(covariance.whiten(residual), parts, white).log_bayes_factor
        assert value == pytest.approx(alone, rel=1e-9, abs=1e-9)


def test_evidence_is_that_of_a_normal_model_with_and_without_a_sign():
    rng = np.random.default_rng(5)
    J, prior_sd, r = rng.normal(size=(N, 3)), np.array([0.5, 1.0, 2.0]), rng.normal(size=N)
    Z = J * prior_sd
    exact = multivariate_normal(np.zeros(N), np.eye(N) + Z @ Z.T).logpdf(r)
    exact -= multivariate_normal(np.zeros(N), np.eye(N)).logpdf(r)
    found = evidences((Z.T @ r)[None], (Z.T @ Z)[None], np.zeros((1, 3)))[0]
    assert found[0] == pytest.approx(exact, rel=1e-9)
    assert evidence(r, J, prior_sd, np.zeros(3))[0] == pytest.approx(exact, rel=1e-9)

    # One value: the evidence with a sign is twice the share of the posterior on that side (exact).
    from scipy.stats import norm

    b, G = 3.0, 4.0
    mean, sd = b / (1 + G), 1 / np.sqrt(1 + G)
    both = evidences(np.array([[b]]), np.array([[[G]]]), np.zeros((1, 1)))[0][0]
    for sign in (1.0, -1.0):
        found = evidences(np.array([[b]]), np.array([[[G]]]), np.array([[sign]]))[0][0]
        assert found == pytest.approx(both + np.log(2) + norm.logcdf(sign * mean / sd), rel=1e-9)
