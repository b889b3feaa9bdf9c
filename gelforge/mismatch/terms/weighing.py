"""Effects weighed by some readings, each alone, errors of their own changes included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from gelforge.mismatch.evidence.screen import Screened, chance_of, judged_under, screened
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.thresholds import FORM_ERRORS, NOTICED, OBSERVABLE_SNR


def observable_ones(ranked: Sequence[Screened]) -> list[Screened]:
    """Return the effects of which a plausible value is observable in the readings at all.

    One that they cannot show has evidence 0, which is no evidence and would win over what they refute.
    """
    return [one for one in ranked if one.plausible_snr > OBSERVABLE_SNR]


def chance_of_known(problem: Problem) -> float:
    """Return the bound on the probability of as much evidence for the known effects by chance.

    All readings are asked, and all effects are as likely: the mean of their Bayes factors against none. Those that the
    readings cannot show are among them, as which these are depends on the readings.
    """
    factors = [
        one.log_bayes_factor for one in screened(problem.residual, problem.covariance, problem.candidates)
    ]
    return chance_of(float(logsumexp(factors) - np.log(len(factors)))) if factors else 1.0


def weighed(problem: Problem) -> list[Screened]:
    """Return effects judged alone by all readings, best first, errors of their own changes included."""
    again = []
    for judged in screened(problem.residual, problem.covariance, problem.candidates):
        if max(map(problem.error_of, judged.parts)) * judged.snr > NOTICED:
            judged = with_form_errors(problem, judged)
        again.append(judged)
    return sorted(again, key=lambda judged: -judged.log_bayes_factor)


def with_form_errors(problem: Problem, judged: Screened) -> Screened:
    """Return a set judged with the errors of its own change, at the best of FORM_ERRORS.

    Its evidence is averaged over these. Judged without errors, at its best shapes and scales; the others are taken to
    follow.
    """
    residual, exact = problem.residual, problem.covariance
    found = []
    for error in FORM_ERRORS:
        parts = tuple(replace(part, form_error=error) for part in judged.parts)
        wider = problem.with_model_error(parts, judged.amounts).covariance
        again = judged_under(wider, residual, parts)
        more = again.log_bayes_factor - judged.best_log_bayes_factor
        more += wider.log_density(residual) - exact.log_density(residual)
        found.append(
            replace(
                again,
                log_bayes_factor=judged.log_bayes_factor + more,
                best_log_bayes_factor=judged.best_log_bayes_factor + more,
                snr=float(np.linalg.norm(exact.whiten(again.change))),
                plausible_snr=judged.plausible_snr,
            )
        )
    factors = [one.log_bayes_factor for one in found]
    best = found[int(np.argmax(factors))]
    return replace(best, log_bayes_factor=float(logsumexp(factors) - np.log(len(factors))))
