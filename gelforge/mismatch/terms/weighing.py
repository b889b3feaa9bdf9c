"""Effects weighed by some readings, each alone, errors of their own changes included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from gelforge.mismatch.evidence.screen import (
    FORM_ERRORS,
    Candidate,
    Screened,
    White,
    chance_of,
    screened,
    with_model_error,
)
from gelforge.mismatch.terms.problem import Problem

NOTICED = 0.1  # standard deviations of a change's own error, below which it moves no evidence
FELT_SNR = 0.5  # of a plausible value; below it nothing can be said for or against


def observable_ones(ranked: Sequence[Screened]) -> list[Screened]:
    """Return the effects of which a plausible value is observable in the readings at all.

    One that they cannot show has evidence 0, which is no evidence and would win over what they refute.
    """
    return [one for one in ranked if one.plausible_snr > FELT_SNR]


def chance_of_known(problem: Problem) -> float:
    """Return the bound on the probability of as much evidence for the known effects by chance.

    All readings are asked, and all effects are as likely: the mean of their Bayes factors against none. Those that the
    readings cannot show are among them, as which these are depends on the readings.
    """
    factors = [
        one.log_bayes_factor for one in screened(problem.residual, problem.covariance, problem.candidates)
    ]
    return chance_of(float(logsumexp(factors) - np.log(len(factors)))) if factors else 1.0


def weighed(problem: Problem, mask: np.ndarray, candidates: Sequence[Candidate]) -> list[Screened]:
    """Return effects judged alone by entries (n,) bool, best first, errors of their own changes included."""
    residual, covariance = problem.residual[mask], problem.covariance.restricted(mask)
    again = []
    for judged in screened(residual, covariance, [candidate.restricted(mask) for candidate in candidates]):
        if max(map(problem.error_of, judged.parts)) * judged.snr > NOTICED:
            judged = with_form_errors(problem, judged, mask)
        again.append(judged)
    return sorted(again, key=lambda judged: -judged.log_bayes_factor)


def with_form_errors(problem: Problem, judged: Screened, mask: np.ndarray) -> Screened:
    """Return a set judged by entries (n,) bool with the errors of its own change, at the best of FORM_ERRORS.

    Its evidence is averaged over these. Judged without errors by the same entries, at its best shapes and scales.
    """
    residual, parts = problem.residual[mask], unmasked(problem, judged).parts
    wrong = [[replace(part, form_error=error) for part in parts] for error in FORM_ERRORS]
    errors = [problem.errors_of(own, judged.amounts)[mask] for own in wrong]
    scattering = problem.scattering(parts, judged.amounts).covariance.restricted(mask)
    # All errors at once, of which one size counts at a time; half are common, half are drawn for readings alike.
    sizes = np.tile(np.repeat(np.eye(len(errors)), errors[0].shape[1], axis=1), 2)
    draws = scattering.erring_draws(np.column_stack(errors))
    exact = White.under(problem.covariance.restricted(mask), residual, judged.parts)
    each = White.with_draws(scattering, residual, judged.parts, draws, sizes)
    found = [
        with_model_error(
            replace(judged, parts=tuple(replace(part, form_error=error) for part in judged.parts)),
            exact,
            white,
        )
        for error, white in zip(FORM_ERRORS, each)
    ]
    factors = [one.log_bayes_factor for one in found]
    best = found[int(np.argmax(factors))]
    return replace(best, log_bayes_factor=float(logsumexp(factors) - np.log(len(factors))))


def unmasked(problem: Problem, judged: Screened) -> Screened:
    """Return a screened answer whose parts are the problem's own candidates, of all entries."""
    return replace(judged, parts=tuple(whole(problem, part) for part in judged.parts))


def whole(problem: Problem, part: Candidate) -> Candidate:
    """Return a part of an answer with the problem's columns of all entries, at the part's own place."""
    return replace(part, columns=problem.columns_at(part))
