"""What no known effect explains, modelled without a name: its posterior mean and how sure it is.

A kernel is a random function; learnt from the training readings it predicts those held out, or it is no model of what is
missing. What does is learnt once more from all readings. As a function of depth and place it corrects simulated forces
too, at the places and depths that were judged: a numeric correction, not a cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import pandas as pd
from scipy.special import logsumexp

from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.gaussian import evidence, normalised
from gelforge.mismatch.evidence.kernels import Kernel, Module, log_priors
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.evidence.refit import Refitted
from gelforge.mismatch.inference.holdout import Blocks, Prediction, held_out_of
from gelforge.mismatch.result.scores import HeldOut
from gelforge.mismatch.thresholds import SCALES, SURE, TEMPERING


@dataclass(frozen=True, eq=False)
class Modelled:
    """A smooth change of unknown cause, next to the fitted effects or alone."""

    kernel: Kernel
    mean: np.ndarray  # (q,) posterior mean of its coefficients by all readings, over the scales of its size
    covariance: np.ndarray  # (q, q)
    change: np.ndarray  # (n,) [N] of the readings at the mean
    spread: np.ndarray  # (n,) [N] standard deviation of the change
    left: np.ndarray  # (n,) [N] measured less the prediction by the training readings
    rest: np.ndarray  # (n,) [N] measured less what is learnt from all readings, with the fitted effects
    held: HeldOut  # what was held out, over the fitted effects alone
    # the fitted effects with their values next to this change, by all readings; None: alone
    fit: Refitted | None
    probability: float  # of its cause, by all readings

    @property
    def with_effects(self) -> bool:
        """Return whether it acts with fitted effects; else alone."""
        return self.fit is not None

    @property
    def module(self) -> Module | None:
        """Return the cause, where it is physics with a free form."""
        return self.kernel if isinstance(self.kernel, Module) else None

    @property
    def sure(self) -> bool:
        """Return whether it is a cause, as probable as a claim has to be."""
        return self.kernel.is_cause and self.probability >= SURE

    def map(self) -> pd.DataFrame | None:
        """Return the rows of module.csv; None where it is no cause."""
        return None if self.module is None else self.module.values(self.mean, self.covariance)


def modelled(
    problem: Problem,
    tried: Sequence[Kernel],
    blocks: Blocks,
    fit: Refitted | None = None,
    left: np.ndarray | None = None,
    chances: Mapping[str, float] = MappingProxyType({}),
) -> Modelled:
    """Return the kernel that is most probable next to a fit, or alone, learnt from the training readings and from all.

    left (n,) [N]: what the fit leaves of all readings; chances: of kernels. All readings choose it, as they choose effects;
    what each indentation has of its own predicts no other and is not tried. Whether the readings held out confirm it is
    for the caller to ask (`held`).
    """
    labels, priors = problem.labels, log_priors(tried)
    every, base = np.ones(len(labels), bool), _LinearFit.of(problem, fit, left)

    def weight(kernel: Kernel) -> float:
        evidence = [base.learnt_by(scale * kernel.directions, every)[0] for scale in SCALES]
        return TEMPERING * float(logsumexp(evidence)) + priors[kernel.words]

    kernel = max((one for one in tried if one.groups is None), key=weight)
    D, none = kernel.directions, kernel.directions[:, :0]
    columns, p = np.column_stack([base.columns, D]), base.columns.shape[1]
    (mean_without, without), (mean_with, spread) = (
        base.posterior(directions, blocks.train) for directions in (none, D)
    )
    before, after = base.left - base.columns @ mean_without, base.left - columns @ mean_with
    predictions = (
        Prediction(before, base.covariance, base.columns, without),
        Prediction(after, base.covariance, columns, spread),
    )
    mean, all_of = base.posterior(D, every)
    grown, of_change = all_of[:p, :p] - base.posterior(none, every)[1], all_of[p:, p:]
    return Modelled(
        kernel=kernel,
        mean=mean[p:],
        covariance=of_change,
        change=D @ mean[p:],
        spread=np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", D, of_change, D), 0.0)),
        left=after,
        rest=base.left - columns @ mean,
        held=held_out_of(problem, blocks, *predictions)[0],
        fit=None if fit is None else base.moved(fit, mean[:p], grown),
        probability=min(chances.get(kernel.words, 0.0), 1.0),
    )


@dataclass(frozen=True, eq=False)
class _LinearFit:
    """Fitted effects, linear about their fit, next to which a smooth change is learnt; or none."""

    left: np.ndarray  # (n,) [N] what the fit leaves
    covariance: Covariance
    columns: np.ndarray  # (n, p) of the fit's values that are not switched on, in units of their priors
    free: np.ndarray  # (p,) numbers of these among all values

    @classmethod
    def of(cls, problem: Problem, fit: Refitted | None, left: np.ndarray | None) -> _LinearFit:
        if fit is None or left is None:
            columns = np.zeros((len(problem.labels), 0))
            return cls(problem.residual, problem.covariance, columns, np.zeros(0, int))
        uncertain = problem.with_model_error(fit.terms).covariance
        on = np.concatenate([np.full(len(a), part.binary) for part, a in fit.terms])
        free = np.flatnonzero(~on)
        return cls(left, uncertain, fit.columns[:, free] * fit.prior_sd[free], free)

    def moved(self, fit: Refitted, step: np.ndarray, grown: np.ndarray) -> Refitted:
        """Return the fit with its values a step (p,) further and their covariance grown by (p, p), in units of priors."""
        theta, spread, prior_sd = np.concatenate(fit.theta), fit.spread.copy(), fit.prior_sd[self.free]
        theta[self.free] += prior_sd * step
        spread[np.ix_(self.free, self.free)] += prior_sd[:, None] * grown * prior_sd
        ends = np.cumsum([len(a) for a in fit.theta])[:-1]
        return replace(fit, theta=tuple(np.split(theta, ends)), spread=spread)

    def posterior(self, D: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean (p + q,) and covariance of values and coefficients, about the fit, by some entries (n,) bool.

        Averaged over the scales of a plausible size, whose evidence counts for TEMPERING as that of all rivals does.
        """
        learnt = [self.learnt_by(scale * D, mask) for scale in SCALES]
        weights = normalised({k: TEMPERING * evidence for k, (evidence, *_) in enumerate(learnt)}).values()
        units = [np.r_[np.ones(self.columns.shape[1]), np.full(D.shape[1], scale)] for scale in SCALES]
        means = [unit * moment for unit, (_, moment, _) in zip(units, learnt)]
        mean = sum(w * moment for w, moment in zip(weights, means))
        spreads = [
            np.outer(unit, unit) * moment + np.outer(m - mean, m - mean)
            for unit, m, (_, _, moment) in zip(units, means, learnt)
        ]
        return mean, sum(w * moment for w, moment in zip(weights, spreads))

    def learnt_by(self, D: np.ndarray, mask: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Return log evidence, mean and covariance of a smooth change of directions (n, q) next to the fit."""
        columns, part = np.column_stack([self.columns, D]), self.covariance.restricted(mask)
        k = columns.shape[1]
        return evidence(part.whiten(self.left[mask]), part.whiten(columns[mask]), np.ones(k), np.zeros(k))
