"""The answer of a posterior: its most probable set, fitted, in classes that these readings can distinguish."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gelforge.config import ConfigError
from gelforge.config.parts.mismatch import Mismatch
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.evidence.alternatives import UNKNOWN
from gelforge.mismatch.evidence.identifiability import cosines
from gelforge.mismatch.evidence.screen import Screened
from gelforge.mismatch.goodness.residual_tests import ResidualTests, residual_tests
from gelforge.mismatch.inference.few_sites import at_few_sites
from gelforge.mismatch.inference.fits import by_columns, fitted, forces_of, through_solutions
from gelforge.mismatch.inference.placing import placed
from gelforge.mismatch.inference.posterior import Effects, Posterior, posterior_of
from gelforge.mismatch.inference.proof import Proof, folds_of, having_paid, proof_of
from gelforge.mismatch.result.verdict import SURE
from gelforge.mismatch.terms.holdout import Blocks
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.terms.refit import Refitted, refitted
from gelforge.mismatch.terms.unknown import Manner
from gelforge.progress import stage

NEGLIGIBLE = 0.02  # probability of an effect below which it is not mentioned beside others
MOST_ALTERNATIVES = 3  # classes that one of the answer's effects may stand for


@dataclass(frozen=True)
class Group:
    """One effect of the answer, what these readings cannot distinguish from it, and what may stand in its place."""

    members: tuple[str, ...]  # the fitted effect first; all leave one pattern
    or_else: tuple[str, ...]  # effects of other patterns, where the members alone are not sure
    probability: float  # that one of all these is there
    odds: float  # of the first member over the other members; inf where it is alone
    cosines: Mapping[str, float]  # of the members' changes with the first one's


@dataclass(frozen=True, eq=False)
class Answer:
    """Effects that were put into the base, and what speaks for them."""

    posterior: Posterior
    winner: Screened  # the most probable set by its linear change
    fit: Refitted  # the same to all readings, its values with their plausible widths
    refits: Mapping[Effects, Refitted]
    groups: tuple[Group, ...]  # one per effect of the fit
    after: np.ndarray  # (R, 3) [N] forces with the effects
    adequacy: ResidualTests  # of all readings
    proof: Proof | None  # on held-out readings; None where there are none
    folds: Mapping[str, Proof]  # of few sites, each held out in turn

    @property
    def sure(self) -> tuple[Group, ...]:
        """Return the groups that are claimed."""
        return tuple(group for group in self.groups if group.probability >= SURE)

    @property
    def discrepancy_words(self) -> str:
        """Return the manner that a discrepancy would most probably have, in words."""
        unknown, probability = self.posterior.unknown, self.posterior.probability
        return unknown[max(unknown, key=lambda effects: probability[effects | {UNKNOWN}])].manner


def explained(
    problem: Problem,
    posterior: Posterior,
    manners: Sequence[Manner],
    blocks: Blocks,
    settings: Mismatch,
    rng: np.random.Generator,
) -> tuple[Answer | None, list[str]]:
    """Return the answer to a mismatch, None where no effect could be fitted, and what went wrong on the way."""
    if posterior.holding([UNKNOWN]) >= SURE:
        # Softening explains nothing by itself then: to follow all indentations in order takes minutes and decides nothing.
        problem = problem.drafted()
    seated, note = placed(problem, at_few_sites(problem))
    if seated is not problem:
        problem, posterior = seated, posterior_of(seated, manners)
    real = at_few_sites(problem)
    found = fitted(real, posterior, lambda seated: posterior_of(seated, manners))
    notes, mode = [*found.notes, *([note] if note else [])], found.mode
    if mode is None:
        return None, notes
    problem, posterior = found.problem, found.posterior
    stage("amounts of the answer at their plausible widths")
    fit, note = _at_plausible_widths(real, problem, posterior.sets[mode], found.fits[mode])
    notes += [note] if note else []
    every = np.ones(len(problem.labels), bool)
    after = forces_of(problem, fit)
    left = problem.observations.flat(problem.observations.force - after)
    believed = problem.believing(fit.parts, np.concatenate(fit.amounts))
    stage("the answer on held-out readings, and what it leaves")
    proof = proof_of(problem, fit, left, blocks) if blocks.held_out.any() else None
    if proof is not None:
        proof = having_paid(proof, problem, posterior)
    return (
        Answer(
            posterior=posterior,
            winner=posterior.sets[mode],
            fit=averaged(posterior, mode, fit),
            refits=found.fits,
            groups=groups_of(problem, posterior, fit),
            after=after,
            adequacy=residual_tests(believed, left, every, settings, rng, fit.columns),
            proof=proof,
            folds=folds_of(problem, fit, left),
        ),
        notes,
    )


def _at_plausible_widths(
    problem: Problem, seated: Problem, start: Screened, fit: Refitted
) -> tuple[Refitted, str]:
    """Return a fit once more with the priors' own widths, and why that could not be had.

    A fit has the scale of plausible values that had most evidence; once its effects are known that scale has no say. What
    has a place goes on to where the real model fits best, unless it was placed before (placing.py): between places that were
    tried its columns are but interpolated.
    """
    parts = tuple(replace(part, widths=seated.own(part).widths) for part in fit.parts)
    again = replace(start, parts=parts, amounts=np.concatenate(fit.amounts))
    try:
        if any(part.moved_from is not None and seated.own(part).moved_from is None for part in parts):
            every = np.ones(len(problem.labels), bool)
            return refitted(
                replace(seated, forces_with=problem.drafted().forces_with), again, every, placing=True
            ), ""
        if problem.in_order(parts):
            return by_columns(seated, again), ""
        return through_solutions(problem, seated, again)[0], ""
    except (NotConverged, ConfigError) as failure:
        return (
            fit,
            f"parameter values have the prior scale of most evidence: with plausible standard deviations {failure}",
        )


def averaged(posterior: Posterior, mode: Effects, fit: Refitted) -> Refitted:
    """Return a fit whose covariance holds what other sets with the same effects say of their values.

    The values stay those of the fit, which the study takes over. Where a place was fitted nothing is added.
    """
    spread, at = fit.spread.copy(), 0
    own = posterior.sets[mode]
    for part, amounts in zip(fit.parts, fit.amounts):
        p, rows = len(amounts), slice(at, at + len(amounts))
        at += p
        if part.switch or part.moved_from is not None:
            continue
        here = _amounts_in(own, part.name)
        away, weight = np.zeros((p, p)), 0.0
        for effects, other in posterior.sets.items():
            if part.name in effects:
                chance = posterior.probability[effects]
                step = _amounts_in(other, part.name) - here
                away += chance * np.outer(step, step)
                weight += chance
        spread[rows, rows] += away / max(weight, np.finfo(float).tiny)
    return replace(fit, spread=spread)


def _amounts_in(judged: Screened, name: str) -> np.ndarray:
    at = 0
    for part in judged.parts:
        p = part.columns.shape[1]
        if part.name == name:
            return judged.amounts[at : at + p]
        at += p
    raise KeyError(name)


def groups_of(problem: Problem, posterior: Posterior, fit: Refitted) -> tuple[Group, ...]:
    """Return for each fitted effect its class: what these readings cannot distinguish it from.

    Where the class is not sure its alternatives are added, as they are probable, until one of them is; an effect of another
    class of the same answer is none.
    """
    names = [part.name for part in fit.parts]
    changes = {part.name: part.columns @ np.asarray(amounts) for part, amounts in zip(fit.parts, fit.amounts)}
    found = []
    for name in names:
        twins = _twins_beside(posterior, name, names)
        others = [other for other in names if other not in twins]
        members = [*twins]
        rivals: list[str] = []
        rest = sorted(
            posterior.singles.keys() - set(members) - set(others), key=lambda n: -posterior.holding([n])
        )
        for rival in rest[: MOST_ALTERNATIVES - 1]:
            if posterior.holding([*members, *rivals]) >= SURE or posterior.holding([rival]) < NEGLIGIBLE:
                break
            rivals.append(rival)
        own = posterior.holding([name])
        odds = own / max(sum(posterior.holding([m]) for m in twins if m != name), 1e-12)
        white = problem.covariance.whiten(
            np.column_stack([changes[name], *(posterior.singles[t].change for t in twins[1:])])
        )
        cos = cosines(white)[0]
        found.append(
            Group(
                members=tuple(twins),
                or_else=tuple(rivals),
                probability=posterior.holding([*twins, *rivals]),
                odds=float(odds) if len(twins) > 1 else np.inf,
                cosines={twin: float(c) for twin, c in zip(twins, cos)},
            )
        )
    return tuple(found)


def _twins_beside(posterior: Posterior, name: str, names: Sequence[str]) -> list[str]:
    """Return an effect of an answer and its twins that are not in the answer themselves, the most probable first."""
    others = posterior.twins.get(name, frozenset({name})) - set(names)
    likely = [other for other in others if posterior.holding([other]) > NEGLIGIBLE]
    return [name, *sorted(likely, key=lambda other: -posterior.holding([other]))]
