"""Nonlinear fits of the few sets that matter: the most probable one and its nearest competitor, in the real model."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, replace

import numpy as np

from gelforge.config import ConfigError
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.evidence.screen import Candidate, Screened, split
from gelforge.mismatch.inference.posterior import Effects, Posterior
from gelforge.mismatch.terms.problem import Problem, secant
from gelforge.mismatch.terms.refit import Refitted, refitted
from gelforge.mismatch.thresholds import COMPETITOR, CURVED_SNR, MOST_FREE, MOST_SOLUTIONS, MOST_SOLVED
from gelforge.progress import stage


@dataclass(frozen=True, eq=False)
class Fits:
    """The posterior with the evidence of what was fitted, and the fits to all readings."""

    problem: Problem  # with columns through what was fitted
    posterior: Posterior
    fits: Mapping[Effects, Refitted]
    notes: tuple[str, ...]  # what could not be fitted, and why

    @property
    def mode(self) -> Effects | None:
        """Return the most probable set of those that were fitted; None where none was."""
        return next((effects for effects in self.posterior.ranked() if effects in self.fits), None)


def fitted(problem: Problem, posterior: Posterior, posterior_of: Callable[[Problem], Posterior]) -> Fits:
    """Return the most probable sets fitted to all readings, until the most probable one and its competitor are.

    posterior: of the problem by posterior_of. Where a fit shows that a change is not linear, the columns are put through it
    and the linear pass is made again, so that no second effect is called in to mend the first one's curvature.
    """
    first, relinearised = posterior, problem
    fits: dict[Effects, Refitted] = {}
    failed: dict[Effects, str] = {}
    left = {True: MOST_SOLVED, False: MOST_FREE}
    while (wanted := _next(found := _with_fits(posterior, first, fits, failed), fits, failed)) is not None:
        wanted = _largest_first(problem, found, wanted, {*fits, *failed})
        costs = any(map(problem.solves, found.sets[wanted].parts))
        if not left[costs]:
            break
        left[costs] -= 1
        stage(f"fit of {words_of(wanted)}")
        try:
            fits[wanted], again = through_solutions(problem, relinearised, found.sets[wanted])
        except (NotConverged, ConfigError) as failure:
            failed[wanted] = f"could not be solved: {failure}"
            continue
        if again is not relinearised:
            relinearised, posterior = again, posterior_of(again)
    notes = tuple(f"{words_of(effects)} {why}" for effects, why in failed.items())
    return Fits(relinearised, found, fits, notes)


def _largest_first(
    problem: Problem, posterior: Posterior, wanted: Effects, done: Container[Effects]
) -> Effects:
    """Return the effect of a set that changes the readings most, alone, if it was not fitted before; else the set.

    A second effect has to explain what the first one leaves when it is solved: by its linear change alone, it may only
    mend the curvature of the first.
    """
    if len(wanted) == 1:
        return wanted
    one = posterior.sets[wanted]
    changes = [part.columns @ a for part, a in zip(one.parts, split(one.parts, one.amounts))]
    sizes = np.linalg.norm(problem.covariance.whiten(np.column_stack(changes)), axis=0)
    alone = frozenset({one.parts[int(np.argmax(sizes))].name})
    return wanted if alone in done or alone not in posterior.sets else alone


def words_of(effects: Effects) -> str:
    """Return the names of a set of effects as words."""
    return " and ".join(sorted(effects)).replace("_", " ")


def through_solutions(problem: Problem, relinearised: Problem, start: Screened) -> tuple[Refitted, Problem]:
    """Return a set fitted by its columns, which are put through what is solved at the fit until both agree.

    And the problem with these columns. What is solved in order takes minutes and is solved once. Raises NotConverged.
    """
    fit = by_columns(relinearised, start)
    for _ in range(1 if problem.path_dependent(start.parts) else MOST_SOLUTIONS):
        change = problem.observations.flat(forces_of(problem, fit) - problem.base)
        again = through(relinearised, fit, change)
        if again is relinearised:
            break
        relinearised = again
        fit = by_columns(relinearised, start)
    return fit, relinearised


def by_columns(problem: Problem, start: Screened) -> Refitted:
    """Return a set fitted to all readings by the problem's columns: nothing is solved."""
    parts = tuple(problem.at_its_place(part) for part in start.parts)
    every = np.ones(len(problem.labels), bool)
    return refitted(problem.linearised(), replace(start, parts=parts), every)


def forces_of(problem: Problem, fit: Refitted) -> np.ndarray:
    """Return the forces (R, 3) [N] at all readings with fitted effects, solved. Raises NotConverged."""
    return problem.forces_with(fit.parts, fit.amounts, np.ones(len(problem.base), bool))


def through(problem: Problem, fit: Refitted, change: np.ndarray) -> Problem:
    """Return the problem with the fitted effects' columns through their change (n,) [N]; itself where that is linear.

    What has a place changes by the same factor, least squares, at all others.
    """
    own = [problem.tried(part) for part in fit.parts]
    columns = np.column_stack([problem.columns_at(part) for part in fit.parts])
    amounts = np.concatenate(fit.amounts)
    linear = columns @ amounts
    white = problem.covariance.whiten(np.column_stack([linear, change]))
    if np.linalg.norm(white[:, 1] - white[:, 0]) < CURVED_SNR or not np.any(white[:, 0]):
        return problem
    prior_sd = np.concatenate([np.broadcast_to(c.prior_sd, c.columns.shape[1]) for c in own])
    relinearised = split(own, secant(columns, change - linear, amounts, prior_sd).T)
    factor = float(white[:, 0] @ white[:, 1] / (white[:, 0] @ white[:, 0]))
    placed = {c.name for c in own if "x_mm" in c.shape}

    def with_it(candidate: Candidate) -> Candidate:
        for part, one, new in zip(fit.parts, own, relinearised):
            if candidate is one and part.moved_from is None:
                return replace(one, columns=new.T)
        return (
            replace(candidate, columns=factor * candidate.columns) if candidate.name in placed else candidate
        )

    return replace(problem, candidates=[with_it(c) for c in problem.candidates])


def _next(
    posterior: Posterior, fits: Mapping[Effects, Refitted], failed: Mapping[Effects, str]
) -> Effects | None:
    """Return the set to fit next: the most probable one, else its nearest competitor, else none.

    A competitor does without one of the most probable set's lines; whether there is more beside these is asked of the
    linear pass about the fit.
    """
    ranked = [effects for effects in posterior.ranked() if effects not in failed]
    if not ranked or ranked[0] not in fits:
        return ranked[0] if ranked else None
    own, best = posterior.lines_of(ranked[0]), posterior.weight(ranked[0])
    for other in ranked[1:]:
        if posterior.weight(other) < best - COMPETITOR:
            return None
        if not own <= posterior.lines_of(other):
            return None if other in fits else other
    return None


def _with_fits(
    posterior: Posterior, first: Posterior, fits: Mapping[Effects, Refitted], failed: Mapping[Effects, str]
) -> Posterior:
    """Return the posterior with the fits' evidence; sets of the same lines gain what a fitted one gained.

    They would gain as much if they were fitted. Failures are dropped.
    """
    sets = {effects: first.sets[effects] for effects in fits if effects in first.sets} | dict(posterior.sets)
    evidence = {effects: one.log_bayes_factor for effects, one in sets.items()} | dict(posterior.evidence)
    gained = {
        first.lines_of(effects): fit.log_bayes_factor - first.evidence[effects]
        for effects, fit in fits.items()
        if effects in first.evidence
    }
    for effects in [*evidence]:
        known = frozenset(effects & posterior.singles.keys())
        beside = evidence[effects] - posterior.evidence.get(known, 0.0) if known != effects else 0.0
        if known in fits:
            evidence[effects] = fits[known].log_bayes_factor + beside
        elif known in first.evidence and posterior.lines_of(known) in gained:
            evidence[effects] = first.evidence[known] + gained[posterior.lines_of(known)] + beside
    return replace(
        posterior,
        sets={effects: one for effects, one in sets.items() if effects not in failed},
        evidence={effects: value for effects, value in evidence.items() if effects not in failed},
    )
