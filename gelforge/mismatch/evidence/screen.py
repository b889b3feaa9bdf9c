"""Every effect against none: evidence by the linear change of the readings, priors and signs included; and places."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.gaussian import evidence
from gelforge.mismatch.model.effect import Hyperparameters
from gelforge.mismatch.model.places import AXES, RADIUS, point
from gelforge.mismatch.thresholds import FORM_ERRORS, SCALES


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect at one point of its grid: the change of the n entries per unit of each of its p values."""

    name: str
    hyperparameters: Hyperparameters
    columns: np.ndarray  # (n, p) [N per unit]
    prior_sd: np.ndarray  # (p,) standard deviations of the priors
    signs: np.ndarray  # (p,) 1, -1: the only physical sign; 0: both
    binary: bool = False  # the value is 1 or 0
    moved_from: Hyperparameters | None = None  # those that were tried, where a refit has moved its place
    form_error: float = FORM_ERRORS[1]  # where readings have judged it that of most evidence

    @property
    def tried(self) -> Hyperparameters:
        """Return the hyperparameters that were tried: a point of the effect's grid."""
        return dict(self.hyperparameters if self.moved_from is None else self.moved_from)

    @property
    def located(self) -> bool:
        """Return whether it has a place."""
        return "x_mm" in self.hyperparameters


@dataclass(frozen=True, eq=False)
class Screened:
    """One effect, or several at once, judged against none."""

    parts: tuple[Candidate, ...]  # at their best hyperparameters and scales
    log_bayes_factor: float  # against none, averaged over hyperparameters and scales
    best_log_bayes_factor: float  # at the best ones
    theta: np.ndarray  # (p,) posterior means, the parts' values in turn
    covariance: np.ndarray  # (p, p) of the values
    change: np.ndarray  # (n,) [N] of the readings at these values
    snr: float  # of this change: sqrt(d' C^-1 d)
    plausible_snr: float  # the same of the last part alone, root mean square over its prior

    @property
    def name(self) -> str:
        """Return the effect's name, several joined by " + "."""
        return " + ".join(part.name for part in self.parts)

    @property
    def effects(self) -> frozenset[str]:
        """Return the names of its effects, whatever their order."""
        return frozenset(part.name for part in self.parts)

    @property
    def terms(self) -> list[Term]:
        """Return each part with its values."""
        return terms_of(self.parts, self.theta)

    @property
    def by_name(self) -> dict[str, np.ndarray]:
        """Return the values of each part."""
        return {part.name: a for part, a in self.terms}


Term = tuple[Candidate, np.ndarray]  # an effect and its values


def terms_of(parts: Sequence[Candidate], theta: np.ndarray) -> list[Term]:
    """Return parts with their share of all values.

    Parameters
    ----------
    parts : sequence of Candidate
        The effects.
    theta : numpy.ndarray
        (p, ...), the parts' values in turn.

    Returns
    -------
    list of (Candidate, numpy.ndarray)
        In the order of the parts.
    """
    return list(zip(parts, split(parts, theta)))


def split(parts: Sequence[Candidate], theta: np.ndarray) -> list[np.ndarray]:
    """Return values (p,) of several parts by part."""
    return np.split(np.asarray(theta), np.cumsum([part.columns.shape[1] for part in parts])[:-1])


def screened(
    residual: np.ndarray,
    covariance: Covariance,
    candidates: Sequence[Candidate],
    scales: Sequence[float] = SCALES,
) -> list[Screened]:
    """Return every effect judged against none by residual (n,) = measured - base, best first.

    Hyperparameters of an effect, and scales of its plausible values, have equal prior weight: Bayes factors are averaged.
    """
    r = covariance.whiten(residual)
    by_name = defaultdict(list)
    for candidate, white in zip(candidates, whitened(covariance, candidates)):
        for scale in (1.0,) if candidate.binary else scales:
            part = replace(candidate, prior_sd=scale * np.asarray(candidate.prior_sd))
            observable = float(np.linalg.norm(white * (1.0 if candidate.binary else candidate.prior_sd)))
            by_name[candidate.name].append(replace(judged_by(r, (part,), [white]), plausible_snr=observable))
    judged_effects = []
    for choices in by_name.values():
        factors = [judged.log_bayes_factor for judged in choices]
        best = choices[int(np.argmax(factors))]
        average = float(logsumexp(factors) - np.log(len(factors)))
        judged_effects.append(replace(best, log_bayes_factor=average))
    return sorted(judged_effects, key=lambda judged: -judged.log_bayes_factor)


def chance_of(log_bayes_factor: float) -> float:
    """Return the bound on the probability that noise alone gives as much evidence (Markov's inequality)."""
    return float(np.exp(-max(log_bayes_factor, 0.0)))


def whitened(covariance: Covariance, candidates: Sequence[Candidate]) -> list[np.ndarray]:
    """Return the whitened columns (n, p) of each candidate."""
    ends = np.cumsum([0, *(candidate.columns.shape[1] for candidate in candidates)])
    if not len(candidates):
        return []
    W = covariance.whiten(np.column_stack([candidate.columns for candidate in candidates]))
    return [W[:, a:b] for a, b in zip(ends, ends[1:])]


def judged_under(covariance: Covariance, residual: np.ndarray, parts: Sequence[Candidate]) -> Screened:
    """Return the parts judged by a residual (n,) under a covariance."""
    return judged_by(covariance.whiten(residual), parts, whitened(covariance, parts))


def log_evidence(covariance: Covariance, residual: np.ndarray, parts: Sequence[Candidate]) -> float:
    """Return the log density of a residual (n,) with parts of unknown values, or with none."""
    gained = judged_under(covariance, residual, parts).log_bayes_factor if parts else 0.0
    return covariance.log_density(residual) + gained


def judged_by(r: np.ndarray, parts: Sequence[Candidate], columns: Sequence[np.ndarray]) -> Screened:
    """Return some effects judged by the whitened residual.

    Parameters
    ----------
    r : numpy.ndarray
        (n,), whitened residual [-].
    parts : sequence of Candidate
        The effects.
    columns : sequence of numpy.ndarray
        (n, p) of each, whitened.

    Returns
    -------
    Screened
        Posterior of the values, and the log Bayes factor against none.
    """
    J = np.column_stack(columns)
    prior_sd = np.concatenate([np.broadcast_to(part.prior_sd, c.shape[1]) for part, c in zip(parts, columns)])
    signs = np.concatenate([np.broadcast_to(part.signs, c.shape[1]) for part, c in zip(parts, columns)])
    on = np.concatenate([np.full(c.shape[1], part.binary) for part, c in zip(parts, columns)])
    d = J[:, on].sum(axis=1)  # a switch is there with value 1
    factor = float(d @ r - 0.5 * d @ d)
    theta, spread = np.ones(len(on)), np.zeros((len(on), len(on)))
    if not on.all():
        free = ~on
        log_evidence, mean, cov = evidence(r - d, J[:, free], prior_sd[free], signs[free])
        factor += log_evidence
        theta[free], spread[np.ix_(free, free)] = mean, cov
    plain = np.column_stack([part.columns for part in parts])
    return Screened(
        parts=tuple(parts),
        log_bayes_factor=factor,
        best_log_bayes_factor=factor,
        theta=theta,
        covariance=spread,
        change=plain @ theta,
        snr=float(np.linalg.norm(J @ theta)),
        plausible_snr=float(np.linalg.norm(J * np.where(on, 1.0, prior_sd))),
    )


@dataclass(frozen=True, eq=False)
class Slope:
    """How a located effect's columns change along an axis, and how far its place may lie from the one that was tried."""

    columns: np.ndarray  # (n, p) [N per unit and mm]
    half: float  # mm, half-way to the next place
    low: float  # mm, to the place before; half-way to the one after where there is none
    high: float  # the same to the other side; a radius grows no further than what was tried


def slopes(part: Candidate, others: Sequence[Candidate]) -> dict[str, Slope]:
    """Return the slopes by axis, but for axes along which no other place was tried.

    Differences of the columns at the places to either side, or to one where there is but one.
    """
    by_axis, near = {}, [(other, between(part.tried, other.tried)) for other in next_to(part, others)]
    for k, axis in enumerate(AXES):
        along = {0.0: part} | {float(way[k]): other for other, way in near if way[k]}
        before = max((d for d in along if d < 0), default=0.0)
        after = min((d for d in along if d > 0), default=0.0)
        if after > before:
            slope = (along[after].columns - along[before].columns) / (after - before)
            half = min(abs(d) for d in (before, after) if d) / 2
            beyond = 0.0 if axis == RADIUS else half
            by_axis[axis] = Slope(slope, half, before or -half, after or beyond)
    return by_axis


def displaced(part: Candidate, by: dict[str, float]) -> Candidate:
    """Return a located effect as far [mm] from the place that was tried, axis by axis; its columns stay as they are."""
    place = {axis: float(part.tried[axis]) + float(offset) for axis, offset in by.items()}
    return replace(part, hyperparameters={**part.hyperparameters, **place}, moved_from=part.tried)


def next_to(part: Candidate, others: Sequence[Candidate]) -> list[Candidate]:
    """Return those of other places that lie nearest to a part's to either side along one axis."""
    ways = np.array([between(part.tried, other.tried) for other in others]).reshape(-1, len(AXES))
    nearest = []
    for k in range(len(AXES)):
        for side in (-1, 1):
            along = (side * ways[:, k] > 0) & ~np.delete(ways, k, axis=1).any(axis=1)
            if along.any():
                nearest.append(others[int(np.argmin(np.where(along, np.abs(ways[:, k]), np.inf)))])
    return nearest


def between(one: Hyperparameters, other: Hyperparameters) -> np.ndarray:
    """Return the way (4,) [mm] from one place to another, the growth of its radius last."""
    return point(other) - point(one)
