"""Evidence and posterior of linear models with normal and half-normal priors, and the prior of sets of effects."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import gammaln, log_ndtr, logsumexp

from gelforge.mismatch.thresholds import NULL_PRIOR

NOTHING: frozenset[str] = frozenset()
UNKNOWN = "unknown"  # what no known effect explains: as likely, before the readings, as any one of them


def evidence(
    r: np.ndarray, J: np.ndarray, prior_sd: np.ndarray, signs: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    r"""Return the log Bayes factor of r = J a + e against r = e, and the posterior mean (p,) and covariance (p, p) of a.

    e ~ N(0, I), a ~ N(0, diag(widths^2)), on the physical half lines only. Without signs

    .. math:: \ln B = \tfrac12 b^T A^{-1} b - \tfrac12 \ln\det(W A W), \quad A = J^T J + W^{-2}, \; b = J^T r

    and signs multiply by the posterior's share of the allowed orthant over the prior's, 2^-k. Exact without signs and
    with one; with more the orthant is taken one side at a time, the posterior being kept normal between (Mendell & Elston
    1974, doi:10.2307/2529136).
    """
    W = np.asarray(prior_sd, dtype=float)
    scaled = J * W
    factor, mean, cov = evidences((scaled.T @ r)[None], (scaled.T @ scaled)[None], np.asarray(signs)[None])
    return float(factor[0]), W * mean[0], W[:, None] * cov[0] * W


def evidences(
    b: np.ndarray, gram: np.ndarray, signs: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return log evidence (m,), posterior means (m, p) and covariances (m, p, p) of m models at once.

    Values have standard normal priors on their physical half lines. b (m, p) and gram (m, p, p): whitened columns with the
    residual and with each other, in units of the prior; signs (m, p): 1, -1, or 0 for both sides. The orthant's share is
    taken one side at a time, see `evidence`.
    """
    B = gram + np.eye(b.shape[1])
    cov = np.linalg.inv(B)
    mean = (cov @ b[:, :, None])[:, :, 0]
    # standard deviations on the wrong side, from where phi / Phi is its asymptotic series to 1e-6
    far = -50.0
    log_evidence = 0.5 * (b * mean).sum(axis=1) - 0.5 * np.linalg.slogdet(B)[1]
    for i in np.flatnonzero(signs.any(axis=0)).tolist():
        signed = signs[:, i] != 0
        sd = np.sqrt(cov[:, i, i])
        h = np.where(signed, signs[:, i], 1.0) * mean[:, i] / sd
        share = log_ndtr(h)
        near = np.maximum(h, far)
        ratio = np.exp(-0.5 * near**2 - 0.5 * np.log(2 * np.pi) - log_ndtr(near))  # phi(h) / Phi(h)
        left = 1 - ratio * (near + ratio)  # of the variance
        ratio = np.where(h > far, ratio, -h - 1 / np.minimum(h, far))
        left = np.where(h > far, left, 1 / np.minimum(h, far) ** 2)
        log_evidence += np.where(signed, share + np.log(2), 0.0)
        gain = cov[:, :, i] / cov[:, i, i][:, None]
        mean = mean + np.where(signed, ratio * sd * signs[:, i], 0.0)[:, None] * gain
        less = np.where(signed, (1 - left) * cov[:, i, i], 0.0)
        cov = cov - less[:, None, None] * gain[:, :, None] * gain[:, None, :]
    return log_evidence, mean, cov


def log_prior(effects: int, known: int) -> float:
    """Return the log prior of one answer of so many effects out of those known.

    Each is left out by itself and all as likely, such that none is with NULL_PRIOR: their number has Poisson's law, and
    the answers of one number share its probability.
    """
    mean = -np.log(NULL_PRIOR)
    count = gammaln(known + 1) - gammaln(effects + 1) - gammaln(known - effects + 1)
    return float(np.log(NULL_PRIOR) + effects * np.log(mean) - gammaln(effects + 1) - count)


def normalised(log_weights: Mapping) -> dict:
    """Return weights given by their logarithms as probabilities."""
    total = logsumexp(list(log_weights.values()))
    return {name: float(np.exp(value - total)) for name, value in log_weights.items()}
