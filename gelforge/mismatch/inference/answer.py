"""The answer of a posterior: its most probable set, fitted, and the credible set of each of its effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gelforge.config import ConfigError
from gelforge.config.parts.mismatch import Mismatch
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.evidence.alternatives import UNKNOWN
from gelforge.mismatch.evidence.screen import Screened
from gelforge.mismatch.goodness.residual_tests import ResidualTests, residual_tests
from gelforge.mismatch.inference.few_sites import at_few_sites
from gelforge.mismatch.inference.fits import by_columns, fitted, forces_of, through_solutions
from gelforge.mismatch.inference.placing import placed
from gelforge.mismatch.inference.posterior import CredibleSet, Effects, Posterior, posterior_of
from gelforge.mismatch.inference.proof import Proof, after_penalty, folds_of, proof_of
from gelforge.mismatch.result.verdict import SURE
from gelforge.mismatch.terms.holdout import Blocks
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.terms.refit import Refitted, refitted
from gelforge.mismatch.terms.unknown import Kernel
from gelforge.mismatch.thresholds import WORTH_SOLVING
from gelforge.progress import stage

Group = CredibleSet  # of an effect of an answer


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
        """Return the kernel that a discrepancy would most probably have, in words."""
        unknown, probability = self.posterior.unknown, self.posterior.probability
        shares = unknown[max(unknown, key=lambda effects: probability[effects | {UNKNOWN}])].shares
        return max(shares, key=shares.__getitem__)


def explained(
    problem: Problem,
    posterior: Posterior,
    kernels: Sequence[Kernel],
    blocks: Blocks,
    settings: Mismatch,
    rng: np.random.Generator,
) -> tuple[Answer | None, list[str]]:
    """Return the answer to a mismatch, None where no effect could be fitted, and what went wrong on the way."""
    if max((posterior.holding([name]) for name in posterior.singles), default=0.0) < WORTH_SOLVING:
        problem = problem.linearised()
    elif posterior.holding([UNKNOWN]) >= SURE:
        # Softening explains nothing by itself then: to follow all indentations in order takes minutes and decides nothing.
        problem = problem.with_linear_history()
    relinearised, note = placed(problem, at_few_sites(problem))
    if relinearised is not problem:
        problem, posterior = relinearised, posterior_of(relinearised, kernels)
    real = at_few_sites(problem)
    found = fitted(real, posterior, lambda relinearised: posterior_of(relinearised, kernels))
    notes, mode = [*found.notes, *([note] if note else [])], found.mode
    if mode is None:
        return None, notes
    problem, posterior = found.problem, found.posterior
    stage("amounts of the answer at their plausible widths")
    fit, note = _at_prior_sd(real, problem, posterior.sets[mode], found.fits[mode])
    notes += [note] if note else []
    every = np.ones(len(problem.labels), bool)
    after = forces_of(problem, fit)
    left = problem.observations.flat(problem.observations.force - after)
    uncertain = problem.with_model_error(fit.parts, np.concatenate(fit.amounts))
    stage("the answer on held-out readings, and what it leaves")
    proof = proof_of(problem, fit, left, blocks) if blocks.held_out.any() else None
    if proof is not None:
        proof = after_penalty(proof, problem, posterior)
    return (
        Answer(
            posterior=posterior,
            winner=posterior.sets[mode],
            fit=averaged(posterior, mode, fit),
            refits=found.fits,
            groups=groups_of(problem, posterior, fit),
            after=after,
            adequacy=residual_tests(uncertain, left, every, settings, rng, fit.columns),
            proof=proof,
            folds=folds_of(problem, fit, left),
        ),
        notes,
    )


def _at_prior_sd(
    problem: Problem, relinearised: Problem, start: Screened, fit: Refitted
) -> tuple[Refitted, str]:
    """Return a fit once more with the priors' own widths, and why that could not be had.

    A fit has the scale of plausible values that had most evidence; once its effects are known that scale has no say. What
    has a place goes on to where the real model fits best, unless it was placed before (placing.py): between places that were
    tried its columns are but interpolated.
    """
    parts = tuple(replace(part, prior_sd=relinearised.tried(part).prior_sd) for part in fit.parts)
    again = replace(start, parts=parts, amounts=np.concatenate(fit.amounts))
    try:
        if any(part.moved_from is not None and relinearised.tried(part).moved_from is None for part in parts):
            every = np.ones(len(problem.labels), bool)
            return refitted(
                replace(relinearised, forces_with=problem.with_linear_history().forces_with),
                again,
                every,
                placing=True,
            ), ""
        if problem.path_dependent(parts):
            return by_columns(relinearised, again), ""
        return through_solutions(problem, relinearised, again)[0], ""
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
    values = {effects: one.by_name for effects, one in posterior.sets.items()}
    for part, amounts in zip(fit.parts, fit.amounts):
        rows = slice(at, at + len(amounts))
        at += len(amounts)
        if not (part.binary or part.moved_from is not None):
            others = [effects for effects in posterior.sets if part.name in effects]
            chance = np.array([posterior.probability[effects] for effects in others])[:, None]
            steps = np.array([values[one][part.name] - values[mode][part.name] for one in others])
            spread[rows, rows] += steps.T @ (chance * steps) / max(chance.sum(), np.finfo(float).tiny)
    return replace(fit, spread=spread)


def groups_of(problem: Problem, posterior: Posterior, fit: Refitted) -> tuple[Group, ...]:
    """Return the credible set of each fitted effect, the most probable first."""
    effects, groups = frozenset(part.name for part in fit.parts), []
    for one in posterior.credible_sets(effects):
        first, *others = one.names
        differs = [_difference(problem, posterior, effects, first, other) for other in others]
        snr, size = np.max([(0.0, 0.0), *differs], axis=0)
        groups.append(replace(one, differs_snr=float(snr), differs_N=float(size)))
    return tuple(groups)


def _difference(
    problem: Problem, posterior: Posterior, effects: Effects, name: str, other: str
) -> tuple[float, float]:
    """Return by how much readings differ between an answer and the same with another effect in place of one of it.

    Signal over noise, and root mean square [N], by linear changes. Sets that were not weighed are compared alone.
    """
    own, instead = posterior.sets.get(effects), posterior.sets.get(effects - {name} | {other})
    if own is None or instead is None:
        own, instead = posterior.singles[name], posterior.singles[other]
    difference = own.change - instead.change
    return (
        float(np.linalg.norm(problem.covariance.whiten(difference))),
        float(np.sqrt(np.mean(difference[problem.of_force] ** 2))),
    )
