"""Nonlinear fits of the few sets that matter: the most probable one and its nearest competitor, in the real model.

Changes are solved at a few sites: at the others the linear change is bent as it is at those that were solved. How much more,
or less, a body changes than in proportion depends on the depth far more than on the place: a polynomial of depth, one for
pressing and one for sideways forces, carries it from the few sites to all.

A strong defect is put where the finite elements fit it best, before sets of effects are weighed. Places are tried on a grid;
what a strong defect between them leaves is larger than many an effect, and would call for two or three others.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gelforge.config import ConfigError
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.evidence.problem import Problem, secant
from gelforge.mismatch.evidence.refit import Refitted, refitted
from gelforge.mismatch.evidence.screen import Candidate, Screened, Term, screened, split
from gelforge.mismatch.inference.posterior import Effects, Posterior
from gelforge.mismatch.model.effect import unturned
from gelforge.mismatch.readings.observations import spread_out
from gelforge.mismatch.thresholds import (
    COMPETITOR,
    CURVED_SNR,
    MOST_FREE,
    MOST_SITES,
    MOST_SOLUTIONS,
    MOST_SOLVED,
    OBSERVABLE,
    STRONG_SNR,
)
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
    while (wanted := _next(current := _with_fits(posterior, first, fits, failed), fits, failed)) is not None:
        wanted = _largest_first(problem, current, wanted, {*fits, *failed})
        costs = any(map(problem.solves, current.sets[wanted].parts))
        if not left[costs]:
            break
        left[costs] -= 1
        stage(f"fit of {words_of(wanted)}")
        try:
            fits[wanted], again = through_solutions(problem, relinearised, current.sets[wanted])
        except (NotConverged, ConfigError) as failure:
            failed[wanted] = f"could not be solved: {failure}"
            continue
        if again is not relinearised:
            relinearised, posterior = again, posterior_of(again)
    notes = tuple(f"{words_of(effects)} {why}" for effects, why in failed.items())
    return Fits(relinearised, current, fits, notes)


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
    changes = [part.columns @ a for part, a in one.terms]
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
    return problem.forces_with(fit.terms, np.ones(len(problem.base), bool))


def solved_or_linear(problem: Problem, terms: Sequence[Term]) -> tuple[np.ndarray, str]:
    """Return the forces at all readings with effects, and why they are not solved, if so.

    The last values of a fit are not always solved: a defect may be placed where the finite elements do not converge. Then
    what is solved changes the forces by the terms' own columns, which are those of solutions near by.

    Parameters
    ----------
    problem : Problem
        R readings.
    terms : sequence of (Candidate, numpy.ndarray)
        Effects with columns at their places, and parameters.

    Returns
    -------
    numpy.ndarray
        (R, 3) [N].
    str
        Empty where the forces are solved.
    """

    def change_of(solved: Sequence[Term], rows: np.ndarray) -> np.ndarray:
        change = np.zeros_like(problem.base)
        change[problem.observations.read] = sum(part.columns @ np.asarray(a) for part, a in solved)
        return change

    every = np.ones(len(problem.base), bool)
    try:
        return problem.forces_with(terms, every), ""
    except (NotConverged, ConfigError) as failure:
        why = f"could not be solved, sensitivities are used: {failure}"
    names = words_of(frozenset(part.name for part, _ in terms))
    return problem.with_changes(problem.solves, change_of).forces_with(
        terms, every
    ), f"forces with {names} {why}"


def through(problem: Problem, fit: Refitted, change: np.ndarray) -> Problem:
    """Return the problem with the fitted effects' columns through their change (n,) [N]; itself where that is linear.

    What has a place changes by the same factor, least squares, at all others.
    """
    origin = [problem.tried(part) for part in fit.parts]
    columns = np.column_stack([problem.columns_at(part) for part in fit.parts])
    theta = np.concatenate(fit.theta)
    linear = columns @ theta
    white = problem.covariance.whiten(np.column_stack([linear, change]))
    if np.linalg.norm(white[:, 1] - white[:, 0]) < CURVED_SNR or not np.any(white[:, 0]):
        return problem
    prior_sd = np.concatenate([np.broadcast_to(c.prior_sd, c.columns.shape[1]) for c in origin])
    relinearised = split(origin, secant(columns, change - linear, theta, prior_sd).T)
    factor = float(white[:, 0] @ white[:, 1] / (white[:, 0] @ white[:, 0]))
    placed = {c.name for c in origin if c.located}

    def with_it(candidate: Candidate) -> Candidate:
        for part, one, new in zip(fit.parts, origin, relinearised):
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

    A competitor does without one of the most probable set's lines; whether there is more next to these is asked of the
    linear pass about the fit.
    """
    ranked = [effects for effects in posterior.ranked() if effects not in failed]
    if not ranked or ranked[0] not in fits:
        return ranked[0] if ranked else None
    lines, best = posterior.lines_of(ranked[0]), posterior.weight(ranked[0])
    for other in ranked[1:]:
        if posterior.weight(other) < best - COMPETITOR:
            return None
        if not lines <= posterior.lines_of(other):
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
        more = evidence[effects] - posterior.evidence.get(known, 0.0) if known != effects else 0.0
        if known in fits:
            evidence[effects] = fits[known].log_bayes_factor + more
        elif known in first.evidence and posterior.lines_of(known) in gained:
            evidence[effects] = first.evidence[known] + gained[posterior.lines_of(known)] + more
    return replace(
        posterior,
        sets={effects: one for effects, one in sets.items() if effects not in failed},
        evidence={effects: value for effects, value in evidence.items() if effects not in failed},
    )


def at_few_sites(problem: Problem) -> Problem:
    """Return the problem with forces solved at a few sites; itself where there are no more, or nothing says how to bend.

    What is solved in order, or switched on, is solved everywhere.
    """
    if problem.read_with is None or len(problem.observations.sites) <= MOST_SITES:
        return problem
    table = problem.observations.table

    def change_of(terms: Sequence[Term], rows: np.ndarray) -> np.ndarray:
        linear, near, parts = problem.linear_change(terms), rows, [part for part, _ in terms]
        if not (any(part.binary for part in parts) or problem.path_dependent(parts)):
            near = np.isin(table["site"], chosen_sites(problem, linear, parts))
        solved = problem.forces_with(terms, near) - problem.base
        return bent(linear, solved, near, table["depth_mm"].to_numpy(float))

    return problem.with_changes(problem.solves, change_of)


def bent(
    linear: np.ndarray, solved: np.ndarray, near: np.ndarray, depth: np.ndarray, order: int = 2
) -> np.ndarray:
    """Return a change (R, 3) [N]: as solved at the rows near (R,) bool, elsewhere linear, bent by a polynomial of depth."""
    change = linear.copy()
    change[near] = np.where(np.isfinite(solved[near]), solved[near], linear[near])
    powers = (depth / max(depth.max(initial=0.0), np.finfo(float).tiny))[:, None] ** np.arange(order + 1)
    for axes in ([2], [0, 1]):
        columns = (linear[:, axes, None] * powers[:, None, :]).reshape(-1, order + 1)
        rows = np.repeat(near, len(axes))
        more = (change[:, axes] - linear[:, axes]).ravel()
        # a prior that holds the bend at none, as a share of the change's mean square
        hold = 1e-3 * np.mean(columns[rows, 0] ** 2) * rows.sum() * np.eye(order + 1)
        A = columns[rows].T @ columns[rows] + hold
        if A.any():
            bend = columns @ np.linalg.lstsq(A, columns[rows].T @ more[rows], rcond=None)[0]
            change[:, axes] += np.where(near[:, None], 0.0, bend.reshape(-1, len(axes)))
    return change


def chosen_sites(problem: Problem, linear: np.ndarray, parts: Sequence[Candidate]) -> np.ndarray:
    """Return the numbers of the sites that are solved for a linear change (R, 3) [N]: observable ones, spread out.

    The first shows it most. Of effects that are the same from all sides one eighth of a square stands for all of it.
    """
    site = problem.observations.table["site"].to_numpy()
    size = np.sqrt(np.bincount(site, (linear**2).sum(axis=1), len(problem.observations.sites)))
    observable = np.flatnonzero(size >= OBSERVABLE * size.max())  # all, of a change that is nothing anywhere
    places = problem.observations.sites[observable]
    if all(not part.located and problem.effects[part.name].turned is unturned for part in parts):
        folded = np.sort(np.abs(places - places.mean(axis=0)).round(3), axis=1)
        _, first = np.unique(folded, axis=0, return_index=True)
        observable, places = observable[first], folded[first]
    return observable[spread_out(places, MOST_SITES, int(np.argmax(size[observable])))]


def placed(problem: Problem, real: Problem) -> tuple[Problem, str]:
    """Return the problem with the candidate of a strong defect at its place, and why it could not be placed.

    real: the same, solved at few sites. A defect is placed where it alone, errors of its change aside, is likelier than any
    other effect alone; else the problem stays as it is.
    """
    start = screened(problem.residual, problem.covariance, problem.candidates)[0]
    if not _is_strong_defect(problem, start):
        return problem, ""
    stage(f"place of the {start.name.replace('_', ' ')}")
    try:
        fit = refitted(real.with_linear_history(), start, np.ones(len(problem.labels), bool))
        change = problem.observations.flat(forces_of(real, fit) - problem.base)
    except (NotConverged, ConfigError) as failure:
        return problem, f"{start.name.replace('_', ' ')} could not be placed: {failure}"
    ((part,), (theta,)) = fit.parts, fit.theta
    if part.moved_from is None or not np.any(theta):
        return problem, ""
    there_tried, (value,) = problem.tried(part), theta
    there = replace(part, columns=change[:, None] / value, prior_sd=there_tried.prior_sd)
    return replace(
        problem, candidates=[there if one is there_tried else one for one in problem.candidates]
    ), ""


def _is_strong_defect(problem: Problem, one: Screened) -> bool:
    """Return whether a single effect has a place, is solved, and is seen clearly."""
    (part,) = one.parts
    return part.located and problem.solves(part) and one.snr > STRONG_SNR
