"""Effects weighed by some readings, alone or beside others, errors of their own changes included."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from gelforge.mismatch.alternatives import effects_of
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.screen import Candidate, Screened, believing, chance_of, screened, whitened

# Best answers of a round, beside each of which one more effect is tried: thrice what a group may hold.
BEAM = 12
NOTICED = 0.1  # standard deviations of a change's own error, below which it moves no evidence
FELT_SNR = 0.5  # of a plausible amount; below it nothing can be said for or against


def those_felt(ranked: Sequence[Screened], always: Collection[frozenset[str]] = ()) -> list[Screened]:
    """Return the effects of which a plausible amount is felt by the readings at all, and those of some answers always.

    One that they do not feel has evidence 0, which is no evidence and would win over what they refute.
    """
    return [one for one in ranked if one.plausible_snr > FELT_SNR or effects_of(one) in always]


def chance_of_known(problem: Problem) -> float:
    """Return the bound on the probability of as much evidence for the known effects by chance.

    All readings are asked, and all effects are as likely: the mean of their Bayes factors against none. Those that the
    readings do not feel are among them, as which these are depends on the readings.
    """
    factors = [
        one.log_bayes_factor for one in screened(problem.residual, problem.covariance, problem.candidates)
    ]
    return chance_of(float(logsumexp(factors) - np.log(len(factors)))) if factors else 1.0


def weighed_alone(
    problem: Problem, mask: np.ndarray, names: Collection[str], always: Collection[frozenset[str]] = ()
) -> list[Screened]:
    """Return the effects of some names that entries (n,) bool feel, best first; always: those of answers tried already."""
    return those_felt(weighed(problem, mask, [c for c in problem.candidates if c.name in names]), always)


def weighed_beside(
    problem: Problem, mask: np.ndarray, names: Collection[str], before: Sequence[Screened]
) -> list[Screened]:
    """Return answers with one more effect, of those named, than the best before, judged by entries (n,) bool, best first."""
    candidates = [c for c in problem.candidates if c.name in names]
    white = whitened(problem.covariance.restricted(mask), [c.restricted(mask) for c in candidates])
    best: dict[frozenset[str], Screened] = {}
    for given in before[:BEAM]:
        for judged in those_felt(weighed(problem, mask, candidates, given.parts, given.paid, white)):
            judged = moved(judged, given.refit_gain)
            known = best.get(effects_of(judged))
            if known is None or judged.log_bayes_factor > known.log_bayes_factor:
                best[effects_of(judged)] = judged
    return sorted(best.values(), key=lambda judged: -judged.log_bayes_factor)


def moved(judged: Screened, by: float) -> Screened:
    """Return a screened answer with as much more evidence as refits have given."""
    return replace(
        judged,
        log_bayes_factor=judged.log_bayes_factor + by,
        best_log_bayes_factor=judged.best_log_bayes_factor + by,
        refit_gain=judged.refit_gain + by,
    )


def weighed(
    problem: Problem,
    mask: np.ndarray,
    candidates: Sequence[Candidate],
    given: tuple[Candidate, ...] = (),
    paid: float = 0.0,
    white: Sequence[np.ndarray] | None = None,
) -> list[Screened]:
    """Return effects judged by entries (n,) bool beside those given, best first, errors of their own changes included.

    paid: log evidence that those given have lost to the choice of their shapes, places and scales. white: as in `screened`.
    """
    residual, covariance = problem.residual[mask], problem.covariance.restricted(mask)
    tried = [candidate.restricted(mask) for candidate in candidates]
    before = tuple(part.restricted(mask) for part in given)
    ranked = screened(residual, covariance, tried, before, white=white)
    again = []
    for judged in ranked:
        if max(map(problem.error_of, judged.parts)) * judged.snr > NOTICED:
            wider = problem.believing(unmasked(problem, judged).parts, judged.amounts)
            judged = believing(judged, residual, covariance, wider.covariance.restricted(mask))
        cost = paid + judged.parts[-1].place_cost
        again.append(replace(judged, log_bayes_factor=judged.log_bayes_factor + cost))
    return sorted(again, key=lambda judged: -judged.log_bayes_factor)


def unmasked(problem: Problem, judged: Screened) -> Screened:
    """Return a screened answer whose parts are the problem's own candidates, of all entries."""
    return replace(judged, parts=tuple(whole(problem, part) for part in judged.parts))


def whole(problem: Problem, part: Candidate) -> Candidate:
    """Return a part of an answer with the problem's columns of all entries, at the part's own place."""
    return replace(part, columns=problem.columns_at(part))
