"""The posterior over sets of effects: nothing, every one, every pair, triples by beam, and a discrepancy beside some.

All readings are used and nothing is solved: sets are judged by the stored linear changes of their effects. A set's evidence
is averaged over the shapes of its effects and over scales of their plausible values. Of the sets within reach of the best
the errors of their own changes (form, mesh, place) are then allowed for, each at its best shapes and scales.

At most one effect of a set has a place: two or three defects on a coarse grid of places imitate one that lies between them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from gelforge.mismatch.evidence.alternatives import NOTHING, UNKNOWN, log_prior, normalised
from gelforge.mismatch.evidence.identifiability import indistinguishable
from gelforge.mismatch.evidence.screen import Screened, judged_under
from gelforge.mismatch.inference.linear import Linear, scales_of
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.terms.unknown import Kernel, Weighed, weighed_unknown
from gelforge.mismatch.terms.weighing import observable_ones, weighed, with_form_errors
from gelforge.mismatch.thresholds import (
    BEAM,
    BESIDE,
    CREDIBLE,
    MOST_WITH_ERROR,
    OBSERVABLE_SNR,
    REACH,
    TEMPERING,
)
from gelforge.progress import Progress

Effects = frozenset[str]


@dataclass(frozen=True)
class CredibleSet:
    """The smallest set of effects that holds CREDIBLE of the probability of one acting effect."""

    members: tuple[str, ...]  # the effect, then those of its line: the same sensitivities
    alternatives: tuple[str, ...]  # other effects, the most probable first
    probability: float  # that a member is there
    set_probability: float  # that an effect of the set is there
    shares: Mapping[str, float]  # of each effect in the set; they add up to 1
    differs_snr: float = (
        0.0  # largest difference between the readings that its effects predict, signal over noise
    )
    differs_N: float = 0.0  # the same, root mean square over readings [N]

    @property
    def names(self) -> tuple[str, ...]:
        """Return the whole set."""
        return (*self.members, *self.alternatives)


@dataclass(frozen=True, eq=False)
class Posterior:
    """How probable sets of effects are."""

    sets: Mapping[Effects, Screened]  # known sets, at their best shapes and scales; parts have all entries
    singles: Mapping[str, Screened]  # every effect that the readings can show, alone
    evidence: Mapping[Effects, float]  # log, against nothing; with UNKNOWN beside some
    unknown: Mapping[Effects, Weighed]  # beside what
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
        own = sum(p for effects, p in self.probability.items() if effects & wanted)
        free = sum(
            self.probability[effects | {UNKNOWN}] * one.share_of(wanted)
            for effects, one in self.unknown.items()
            if not effects & wanted
        )
        return float(min(own + free, 1.0))

    @cached_property
    def kernels(self) -> dict[str, float]:
        """Return the probability of each kernel of a discrepancy, in words: they add up to that of a discrepancy."""
        found: dict[str, float] = {}
        for effects, one in self.unknown.items():
            for words, share in one.shares.items():
                found[words] = found.get(words, 0.0) + share * self.probability[effects | {UNKNOWN}]
        return found

    @cached_property
    def causes(self) -> dict[str, float]:
        """Return the probability of each kernel, in words, or of its cause in the catalogue's form and nothing unknown."""
        forms = self.unknown[NOTHING].forms
        known = [effects for effects in self.probability if UNKNOWN not in effects]
        return {
            words: min(p + sum(self.probability[e] for e in known if e & set(forms[words])), 1.0)
            for words, p in self.kernels.items()
        }

    def lines_of(self, effects: Effects) -> frozenset[Effects]:
        """Return the lines of a set's effects."""
        return frozenset(self.lines.get(name, frozenset({name})) for name in effects)

    def credible_sets(self, effects: Effects) -> list[CredibleSet]:
        """Return the credible set of each effect of a set, the most probable first.

        An effect of another one's set acts beside this one, and not in its place.
        """
        found: list[CredibleSet] = []
        for name in sorted(effects, key=lambda one: (-self.holding([one]), one)):
            elsewhere = (effects - {name}).union(*(one.names for one in found))
            found.append(self._credible_set(name, elsewhere))
        return found

    def _credible_set(self, name: str, elsewhere: Effects) -> CredibleSet:
        """Return the smallest set of effects, `name` first, that holds CREDIBLE of its probability.

        Effects are added one by one, always the one that adds most.
        """
        rest = [one for one in self.singles if one != name and one not in elsewhere]
        wanted, found = CREDIBLE * self.holding([name, *rest]), [name]
        while rest and self.holding(found) < wanted:
            found.append(max(rest, key=lambda one: self.holding([*found, one])))
            rest.remove(found[-1])
        chance = {one: self.holding([one]) for one in found}
        others = sorted(found[1:], key=lambda one: -chance[one])
        line = self.lines.get(name, frozenset({name}))
        total = max(sum(chance.values()), np.finfo(float).tiny)
        return CredibleSet(
            members=(name, *(one for one in others if one in line)),
            alternatives=tuple(one for one in others if one not in line),
            probability=self.holding(line & set(found)),
            set_probability=self.holding(found),
            shares={one: own / total for one, own in chance.items()},
        )


def posterior_of(problem: Problem, kernels: Sequence[Kernel]) -> Posterior:
    """Return the posterior by all readings."""
    with Progress("linear pass over sets of effects, steps", 4) as progress:
        singles = {one.name: one for one in observable_ones(weighed(problem))}
        progress.advance(note="single effects")
        linear = Linear.of(problem.residual, problem.covariance, problem.candidates)
        tables, number, scale = set_tables(linear)
        progress.advance(note="pairs and triples")
        sets = _with_error(problem, number, scale, tables, len(singles))
        progress.advance(note="errors of their changes")
        evidence = {effects: one.log_bayes_factor for effects, one in sets.items()}
        lines = indistinguishable(problem.covariance, singles)
        found = with_unknown(problem, Posterior(sets, singles, evidence, {}, len(singles), lines), kernels)
        progress.advance(note="a discrepancy beside them")
    return found


def with_unknown(problem: Problem, posterior: Posterior, kernels: Sequence[Kernel]) -> Posterior:
    """Return the posterior with a discrepancy, alone and beside the best sets, by their linear changes."""
    unknown = {NOTHING: weighed_unknown(problem, kernels)}
    for effects in posterior.ranked()[:BESIDE]:
        one = posterior.sets[effects]
        unknown[effects] = weighed_unknown(
            problem, kernels, one.parts, one.amounts, problem.residual - one.change
        )
    more = {
        effects | {UNKNOWN}: posterior.evidence.get(effects, 0.0) + found.log_bayes_factor
        for effects, found in unknown.items()
    }
    return replace(posterior, unknown=unknown, evidence={**posterior.evidence, **more})


def set_tables(linear: Linear) -> tuple[list, np.ndarray, np.ndarray]:
    """Return by set of effects (names, mean evidence, best evidence, best choice), and the choices' candidate and scale."""
    names = np.array([candidate.name for candidate in linear.candidates])
    observable = _observable(linear)
    number, scale = scales_of(linear)
    chosen = observable[number]
    number, scale = number[chosen], scale[chosen]
    own = names[number]
    if not len(own):
        return [], number, scale
    singles = linear.log_bayes_factors(number[:, None], scale[:, None])
    found = _by_effects(own[:, None], np.arange(len(own))[:, None], singles)
    i, j = np.triu_indices(len(number), 1)
    placed = np.array(["x_mm" in linear.candidates[k].shape for k in number])
    other = (own[i] != own[j]) & ~(placed[i] & placed[j])
    i, j = i[other], j[other]
    if not len(i):
        return found, number, scale
    pairs = linear.log_bayes_factors(np.stack([number[i], number[j]], 1), np.stack([scale[i], scale[j]], 1))
    two = _by_effects(np.stack([own[i], own[j]], 1), np.stack([i, j], 1), pairs)
    three: dict[Effects, tuple] = {}
    for effects, average, top, best in sorted(two, key=lambda one: -one[1])[:BEAM]:
        third = np.flatnonzero(~np.isin(own, list(effects)) & ~(placed & placed[best].any()))
        if not len(third):
            continue
        rows = np.column_stack([np.tile(best, (len(third), 1)), third])
        triples = linear.log_bayes_factors(number[rows], scale[rows])
        # The choice of the two's shapes and scales is paid for once.
        for one in _by_effects(own[rows], rows, triples + average - top):
            if one[0] not in three or three[one[0]][1] < one[1]:
                three[one[0]] = one
    return [*found, *two, *three.values()], number, scale


def _observable(linear: Linear) -> np.ndarray:
    """Return which candidates (C,) bool show a plausible value in the readings."""
    squares = np.bincount(linear.owner, np.diag(linear.gram), len(linear.candidates))
    return np.sqrt(squares) > OBSERVABLE_SNR


def _by_effects(
    own: np.ndarray, choices: np.ndarray, factors: np.ndarray
) -> list[tuple[Effects, float, float, np.ndarray]]:
    """Return by set of effects the mean evidence, that of the best choice, and that choice.

    own (m, k): names; choices (m, k): numbers of choices; factors (m,).
    """
    words, codes = np.unique(own, return_inverse=True)
    kinds, which = np.unique(np.sort(codes.reshape(own.shape), axis=1), axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    ends = np.searchsorted(which.ravel()[order], np.arange(len(kinds) + 1))
    found = []
    for k, kind in enumerate(kinds):
        rows = order[ends[k] : ends[k + 1]]
        best = rows[np.argmax(factors[rows])]
        average = float(logsumexp(factors[rows]) - np.log(len(rows)))
        effects = frozenset(str(words[code]) for code in kind)
        found.append((effects, average, float(factors[best]), choices[best]))
    return found


def _with_error(
    problem: Problem, number: np.ndarray, scale: np.ndarray, tables: list, known: int
) -> dict[Effects, Screened]:
    """Return the sets within REACH of the best, and their parts, judged with errors of their changes."""

    def weight(one) -> float:
        return one[1] + log_prior(len(one[0]), max(known, len(one[0])))

    ranked = sorted(tables, key=lambda one: -weight(one))
    near = [one for one in ranked[:MOST_WITH_ERROR] if weight(one) >= weight(ranked[0]) - REACH]
    # The largest effect of a set is fitted alone before the set is (fits.py).
    reached = {one[0] for one in near}
    near += [one for one in ranked if one[0] not in reached and any(one[0] < other for other in reached)]
    found = {}
    for effects, average, _, choice in near:
        candidates = [problem.candidates[number[k]] for k in choice]
        parts = tuple(
            c if c.binary else replace(c, prior_sd=scale[k] * np.asarray(c.prior_sd))
            for k, c in zip(choice, candidates)
        )
        judged = judged_under(problem.covariance, problem.residual, parts)
        found[effects] = with_form_errors(problem, replace(judged, log_bayes_factor=average))
    return found
