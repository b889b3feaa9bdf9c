"""The posterior over sets of effects: nothing, every one, every pair, triples by beam, and a discrepancy next to some.

All readings are used and nothing is solved: sets are judged by the stored linear changes of their effects. A set's evidence
is averaged over hyperparameters of its effects and scales of their plausible values. Of the sets within reach of the best
the errors of their own changes (form, mesh, place) are then allowed for, each at its best hyperparameters and scales.

At most one effect of a set has a place: two or three defects on a coarse grid of places imitate one that lies between them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from gelforge.mismatch.evidence.gaussian import NOTHING, UNKNOWN, log_prior, normalised
from gelforge.mismatch.evidence.identifiability import indistinguishable
from gelforge.mismatch.evidence.kernels import Kernel, Weighed, weighed_unknown
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.evidence.screen import Screened, chance_of, judged_under, screened, terms_of
from gelforge.mismatch.inference.linear import Linear
from gelforge.mismatch.result.verdict import Group
from gelforge.mismatch.thresholds import (
    BEAM,
    CREDIBLE,
    FORM_ERRORS,
    MOST_WITH_ERROR,
    NOTICED,
    OBSERVABLE_SNR,
    REACH,
    SETS_WITH_DISCREPANCY,
    TEMPERING,
)
from gelforge.progress import Progress

Effects = frozenset[str]


@dataclass(frozen=True, eq=False)
class Posterior:
    """How probable sets of effects are."""

    sets: Mapping[
        Effects, Screened
    ]  # known sets, at their best hyperparameters and scales; parts have all entries
    singles: Mapping[str, Screened]  # every effect that the readings can show, alone
    evidence: Mapping[Effects, float]  # log, against nothing; with UNKNOWN next to some
    unknown: Mapping[Effects, Weighed]  # next to what
    known: int  # effects that the readings can show
    lines: Mapping[str, Effects]  # by effect: those with the same sensitivities, itself included

    @cached_property
    def probability(self) -> dict[Effects, float]:
        """Return the probability of nothing and of each set; they add up to 1.

        Evidence counts for TEMPERING of itself, that of a discrepancy too: each set has a form that is not quite the
        truth's.
        """
        weights = {effects: self.weight(effects) for effects in self.evidence}
        return normalised({NOTHING: log_prior(0, self.known)} | weights)

    def weight(self, effects: Effects) -> float:
        """Return the log of prior times tempered evidence, but for a common constant."""
        count = len(effects)
        return TEMPERING * self.evidence.get(effects, 0.0) + log_prior(count, max(self.known, count))

    def ranked(self) -> list[Effects]:
        """Return the known sets, the most probable first."""
        return sorted(self.sets, key=lambda effects: -self.weight(effects))

    def holding(self, names: Iterable[str]) -> float:
        """Return the probability that one of some effects at least is part of what is missing, in its form or a free one."""
        wanted = set(names)
        named = sum(p for effects, p in self.probability.items() if effects & wanted)
        free = sum(
            self.probability[effects | {UNKNOWN}] * one.share_of(wanted)
            for effects, one in self.unknown.items()
            if not effects & wanted
        )
        return float(min(named + free, 1.0))

    @cached_property
    def kernels(self) -> dict[str, float]:
        """Return the probability of each kernel of a discrepancy, in words: they add up to that of a discrepancy."""
        by_kernel: dict[str, float] = {}
        for effects, one in self.unknown.items():
            for words, share in one.shares.items():
                by_kernel[words] = by_kernel.get(words, 0.0) + share * self.probability[effects | {UNKNOWN}]
        return by_kernel

    @property
    def discrepancy_words(self) -> str:
        """Return the kernel that a discrepancy would most probably have, in words."""
        shares = self.unknown[max(self.unknown, key=lambda one: self.probability[one | {UNKNOWN}])].shares
        return max(shares, key=shares.__getitem__)

    @cached_property
    def causes(self) -> dict[str, float]:
        """Return the probability of each kernel, in words, or of its cause in the catalogue's form and nothing unknown."""
        forms = {kernel.words: kernel.form_of for kernel in self.unknown[NOTHING].kernels}
        known = [effects for effects in self.probability if UNKNOWN not in effects]
        return {
            words: min(p + sum(self.probability[e] for e in known if e & set(forms[words])), 1.0)
            for words, p in self.kernels.items()
        }

    def lines_of(self, effects: Effects) -> frozenset[Effects]:
        """Return the lines of a set's effects."""
        return frozenset(self.lines.get(name, frozenset({name})) for name in effects)

    def credible_sets(self, effects: Effects) -> list[Group]:
        """Return the credible set of each effect of a set, the most probable first.

        An effect of another one's set acts next to this one, and not in its place.
        """
        groups: list[Group] = []
        for name in sorted(effects, key=lambda one: (-self.holding([one]), one)):
            elsewhere = (effects - {name}).union(*(one.names for one in groups))
            groups.append(self._credible_set(name, elsewhere))
        return groups

    def _credible_set(self, name: str, elsewhere: Effects) -> Group:
        """Return the smallest set of effects, `name` first, that holds CREDIBLE of its probability.

        Effects are added one by one, always the one that adds most.
        """
        rest = [one for one in self.singles if one != name and one not in elsewhere]
        wanted, members = CREDIBLE * self.holding([name, *rest]), [name]
        while rest and self.holding(members) < wanted:
            members.append(max(rest, key=lambda one: self.holding([*members, one])))
            rest.remove(members[-1])
        chance = {one: self.holding([one]) for one in members}
        others = sorted(members[1:], key=lambda one: -chance[one])
        line = self.lines.get(name, frozenset({name}))
        total = max(sum(chance.values()), np.finfo(float).tiny)
        return Group(
            members=[name, *(one for one in others if one in line)],
            alternatives=[one for one in others if one not in line],
            probability=self.holding(line & set(members)),
            set_probability=self.holding(members),
            shares={one: p / total for one, p in chance.items()},
        )


def posterior_of(problem: Problem, kernels: Sequence[Kernel]) -> Posterior:
    """Return the posterior by all readings."""
    with Progress("linear pass over sets of effects, steps", 4) as progress:
        # What the readings cannot show has evidence 0, which is none and would win over what they refute.
        singles = {one.name: one for one in weighed(problem) if one.plausible_snr > OBSERVABLE_SNR}
        progress.advance(note="single effects")
        linear = Linear.of(problem.residual, problem.covariance, problem.candidates)
        tables = set_tables(linear)
        progress.advance(note="pairs and triples")
        sets = _with_error(problem, tables, len(singles))
        progress.advance(note="errors of their changes")
        evidence = {effects: one.log_bayes_factor for effects, one in sets.items()}
        lines = indistinguishable(problem.covariance, singles)
        known = Posterior(sets, singles, evidence, {}, len(singles), lines)
        unknown = {NOTHING: weighed_unknown(problem, kernels)}
        for effects in known.ranked()[:SETS_WITH_DISCREPANCY]:
            unknown[effects] = weighed_unknown(problem, kernels, sets[effects])
        for effects, discrepancy in unknown.items():
            evidence[effects | {UNKNOWN}] = evidence.get(effects, 0.0) + discrepancy.log_bayes_factor
        progress.advance(note="a discrepancy next to them")
    return replace(known, unknown=unknown)


class Best(NamedTuple):
    """Log evidence of a set of effects, averaged over hyperparameters and scales, at the best choice, and that choice."""

    effects: Effects
    average: float
    best: float
    number: np.ndarray  # (k,) of the candidates
    scale: np.ndarray  # (k,)


def set_tables(linear: Linear) -> list[Best]:
    """Return the evidence of every effect, of every pair, and of triples that extend the best pairs."""
    number, scale = linear.choices
    if not len(number):
        return []
    one_effect = _by_effects(linear, number[:, None], scale[:, None])
    names = np.array([candidate.name for candidate in linear.candidates])[number]
    located = np.array([candidate.located for candidate in linear.candidates])
    placed, pairs = located[number], np.column_stack(np.triu_indices(len(number), 1))
    pairs = pairs[(names[pairs[:, 0]] != names[pairs[:, 1]]) & ~placed[pairs].all(axis=1)]
    if not len(pairs):
        return one_effect
    two = _by_effects(linear, number[pairs], scale[pairs])
    three: dict[Effects, Best] = {}
    for pair in sorted(two, key=lambda one: -one.average)[:BEAM]:
        third = np.flatnonzero(~np.isin(names, list(pair.effects)) & ~(placed & located[pair.number].any()))
        if not len(third):
            continue
        numbers, scales = (
            np.column_stack([np.tile(of_pair, (len(third), 1)), every[third]])
            for of_pair, every in ((pair.number, number), (pair.scale, scale))
        )
        # The choice of the two's hyperparameters and scales is paid for once.
        for one in _by_effects(linear, numbers, scales, pair.average - pair.best):
            if one.effects not in three or three[one.effects].average < one.average:
                three[one.effects] = one
    return [*one_effect, *two, *three.values()]


def _by_effects(linear: Linear, number: np.ndarray, scale: np.ndarray, more: float = 0.0) -> list[Best]:
    """Return sets of effects by choices of candidates (m, k) at scales (m, k), whose log evidence is larger by more."""
    factors = linear.log_bayes_factors(number, scale) + more
    words, codes = np.unique([candidate.name for candidate in linear.candidates], return_inverse=True)
    kinds, which = np.unique(np.sort(codes[number], axis=1), axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    ends = np.searchsorted(which.ravel()[order], np.arange(len(kinds) + 1))
    sets = []
    for k, kind in enumerate(kinds):
        rows = order[ends[k] : ends[k + 1]]
        best = rows[np.argmax(factors[rows])]
        average = float(logsumexp(factors[rows]) - np.log(len(rows)))
        effects = frozenset(str(words[code]) for code in kind)
        sets.append(Best(effects, average, float(factors[best]), number[best], scale[best]))
    return sets


def _with_error(problem: Problem, tables: Sequence[Best], known: int) -> dict[Effects, Screened]:
    """Return the sets within REACH of the best, and their parts, judged with errors of their changes."""

    def weight(one: Best) -> float:
        return one.average + log_prior(len(one.effects), max(known, len(one.effects)))

    ranked = sorted(tables, key=lambda one: -weight(one))
    near = [one for one in ranked[:MOST_WITH_ERROR] if weight(one) >= weight(ranked[0]) - REACH]
    # The largest effect of a set is fitted alone before the set is (fits.py).
    reached = {one.effects for one in near}
    near += [
        one for one in ranked if one.effects not in reached and any(one.effects < other for other in reached)
    ]
    judged_sets = {}
    for one in near:
        parts = tuple(
            c if c.binary else replace(c, prior_sd=scale * np.asarray(c.prior_sd))
            for c, scale in zip((problem.candidates[k] for k in one.number), one.scale)
        )
        judged = judged_under(problem.covariance, problem.residual, parts)
        judged_sets[one.effects] = with_form_errors(problem, replace(judged, log_bayes_factor=one.average))
    return judged_sets


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

    Its evidence is averaged over these. Judged without errors, at its best hyperparameters and scales; the others are taken
    to follow.
    """
    residual, exact = problem.residual, problem.covariance
    by_error = []
    for error in FORM_ERRORS:
        parts = tuple(replace(part, form_error=error) for part in judged.parts)
        wider = problem.with_model_error(terms_of(parts, judged.theta)).covariance
        again = judged_under(wider, residual, parts)
        more = again.log_bayes_factor - judged.best_log_bayes_factor
        more += wider.log_density(residual) - exact.log_density(residual)
        by_error.append(
            replace(
                again,
                log_bayes_factor=judged.log_bayes_factor + more,
                best_log_bayes_factor=judged.best_log_bayes_factor + more,
                snr=float(np.linalg.norm(exact.whiten(again.change))),
                plausible_snr=judged.plausible_snr,
            )
        )
    factors = [one.log_bayes_factor for one in by_error]
    best = by_error[int(np.argmax(factors))]
    return replace(best, log_bayes_factor=float(logsumexp(factors) - np.log(len(factors))))
