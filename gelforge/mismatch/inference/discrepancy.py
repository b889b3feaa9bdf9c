"""What no known effect explains, modelled without a name: its posterior mean, where it holds, and how sure it is.

A kernel of `unknown.py` is a random function; learnt from the training readings it predicts those held out, or it is no
model of what is missing. What does is learnt once more from all readings. As a function of depth and place it corrects
simulated forces too: a numeric correction with a range of validity, not a cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import pandas as pd
from scipy.special import logsumexp

from gelforge.mismatch.evidence.alternatives import normalised
from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.gaussian import evidence
from gelforge.mismatch.result.verdict import SURE
from gelforge.mismatch.terms.holdout import Blocks, Gain, gain, predictive_scores
from gelforge.mismatch.terms.module import Module
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.terms.refit import Refitted
from gelforge.mismatch.terms.unknown import FROM_PLACE_TO_PLACE, WITH_DEPTH, Kernel, Span, kernels, log_priors
from gelforge.mismatch.thresholds import FARTHEST_MM, SCALES, TEMPERING


@dataclass(frozen=True, eq=False)
class Modelled:
    """A smooth change of unknown cause, beside the fitted effects or alone."""

    kernel: str  # in words
    mean: np.ndarray  # (q,) posterior mean of its coefficients by all readings, over the scales of its size
    covariance: np.ndarray  # (q, q)
    change: np.ndarray  # (n,) [N] of the readings at the mean
    left: np.ndarray  # (n,) [N] measured less the prediction by the training readings
    rest: np.ndarray  # (n,) [N] measured less what is learnt from all readings, with the fitted effects
    gain: Gain  # on what was held out, over the fitted effects alone
    scores: Mapping[str, pd.DataFrame]  # "before" and "after"
    span: Span
    sites: np.ndarray  # (S, 2) [mm] that it was learnt from
    beside: bool  # of fitted effects; else alone
    module: Module | None = None  # the cause, where it is physics with a free form
    probability: float = 0.0  # of that cause, by all readings
    spread: np.ndarray | None = None  # (n,) [N] standard deviation of the change
    fit: Refitted | None = None  # the fitted effects with their values beside this change, by all readings

    @property
    def sure(self) -> bool:
        """Return whether it is a cause, as probable as a claim has to be."""
        return self.module is not None and self.module.named and self.probability >= SURE

    @property
    def form_of(self) -> tuple[str, ...]:
        """Return the effects that are the same cause in another form."""
        return () if self.module is None else self.module.form_of

    @property
    def of_place(self) -> bool:
        """Return whether the change is a function of depth and place, which corrects labels."""
        if self.module is not None:
            return self.module.of_labels
        return self.kernel.endswith((WITH_DEPTH, FROM_PLACE_TO_PLACE))

    def map(self) -> pd.DataFrame | None:
        """Return the rows of module.csv; None where it is no cause."""
        return None if self.module is None else self.module.values(self.mean, self.covariance)

    def at(self, x_mm: np.ndarray, y_mm: np.ndarray, depth_mm: np.ndarray, force: np.ndarray) -> tuple:
        """Return the change (m, 3) [N] of forces (m, 3) [N] at places and depths (m,), its deviation, where it holds.

        The last (m,) bool: inside the depths, and near the sites, that it was learnt from; the others are nan elsewhere.
        """
        m = len(depth_mm)
        rows = pd.DataFrame({"x_mm": x_mm, "y_mm": y_mm, "depth_mm": depth_mm})
        rows = rows.loc[rows.index.repeat(3)].reset_index(drop=True)
        rows = rows.assign(
            axis=np.tile(range(3), m), press=0, session="", order=0, phase="load", press_time_s=0.0
        )
        pressing = np.repeat(np.abs(force[:, 2]), 3)
        own = next(
            one
            for one in kernels(rows, force.ravel(), pressing, self.span, np.zeros(3 * m, int))
            if one.words == self.kernel
        )
        D = own.directions
        change = (D @ self.mean).reshape(m, 3)
        sd = np.sqrt(np.einsum("ij,jk,ik->i", D, self.covariance, D)).reshape(m, 3)
        holds = self._holds(np.asarray(x_mm, float), np.asarray(y_mm, float), np.asarray(depth_mm, float))
        return np.where(holds[:, None], change, np.nan), np.where(holds[:, None], sd, np.nan), holds

    def _holds(self, x: np.ndarray, y: np.ndarray, depth: np.ndarray) -> np.ndarray:
        deepest = self.span.depth_mm[1]
        away = np.hypot(x[:, None] - self.sites[:, 0], y[:, None] - self.sites[:, 1]).min(axis=1)
        return (depth <= deepest * (1 + 1e-9)) & (away <= FARTHEST_MM)


def modelled(
    problem: Problem,
    tried: Sequence[Kernel],
    blocks: Blocks,
    fit: Refitted | None = None,
    left: np.ndarray | None = None,
    chances: Mapping[str, float] = MappingProxyType({}),
) -> Modelled:
    """Return the kernel that is most probable beside a fit, or alone, learnt from the training readings and from all.

    left (n,) [N]: what the fit leaves of all readings; chances: of kernels. All readings choose it, as they choose effects;
    what each indentation has of its own predicts no other and is not tried. Whether the readings held out confirm it is
    for the caller to ask (`gain`).
    """
    base, every, priors = (
        _Beside.of(problem, fit, left),
        np.ones(len(problem.labels), bool),
        log_priors(tried),
    )

    def weight(kernel: Kernel) -> float:
        evidence = [base.learnt_by(scale * kernel.directions, every)[0] for scale in SCALES]
        return TEMPERING * float(logsumexp(evidence)) + priors[kernel.words]

    kernel = max((one for one in tried if one.groups is None), key=weight)
    D, train = kernel.directions, blocks.train
    before, spread_before = base.left_by(D[:, :0], train)
    after, spread = base.left_by(D, train)
    columns, p = np.column_stack([base.columns, D]), base.columns.shape[1]
    labels, table = problem.labels, problem.observations.table
    scores = {
        "before": predictive_scores(
            before, base.covariance, blocks, labels, base.columns, spread_before, before - after
        ),
        "after": predictive_scores(after, base.covariance, blocks, labels, columns, spread),
    }
    mean, covariance = base.posterior(D, every)
    grown = covariance[:p, :p] - base.posterior(D[:, :0], every)[1]
    own = covariance[p:, p:]
    return Modelled(
        kernel=kernel.words,
        mean=mean[p:],
        covariance=own,
        change=D @ mean[p:],
        left=after,
        rest=base.left - columns @ mean,
        gain=gain(scores["before"], scores["after"]),
        scores=scores,
        span=Span.of(labels),
        sites=table[["x_mm", "y_mm"]].drop_duplicates().to_numpy(float),
        beside=fit is not None,
        module=kernel if isinstance(kernel, Module) else None,
        probability=min(chances.get(kernel.words, 0.0), 1.0),
        spread=np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", D, own, D), 0.0)),
        fit=None if fit is None else base.moved(fit, mean[:p], grown),
    )


@dataclass(frozen=True, eq=False)
class _Beside:
    """Fitted effects, linear about their fit, beside which a smooth change is learnt; or none."""

    left: np.ndarray  # (n,) [N] what the fit leaves
    covariance: Covariance
    columns: np.ndarray  # (n, p) of the fit's amounts that are not switched on, in units of their priors
    free: np.ndarray  # (p,) numbers of these among all amounts
    prior_sd: np.ndarray  # (p,) of the priors

    @classmethod
    def of(cls, problem: Problem, fit: Refitted | None, left: np.ndarray | None) -> _Beside:
        none = np.zeros(0)
        if fit is None or left is None:
            columns = np.zeros((len(problem.labels), 0))
            return cls(problem.residual, problem.covariance, columns, none.astype(int), none)
        uncertain = problem.with_model_error(fit.parts, np.concatenate(fit.amounts)).covariance
        each = [(part, len(a)) for part, a in zip(fit.parts, fit.amounts)]
        free = np.flatnonzero(np.concatenate([np.full(p, not part.binary) for part, p in each]))
        prior_sd = np.concatenate([np.broadcast_to(part.prior_sd, p) for part, p in each])[free]
        return cls(left, uncertain, fit.columns[:, free] * prior_sd, free, prior_sd)

    def moved(self, fit: Refitted, step: np.ndarray, grown: np.ndarray) -> Refitted:
        """Return the fit with its amounts a step (p,) further and their covariance grown by (p, p), in units of priors."""
        amounts, spread = np.concatenate(fit.amounts), fit.spread.copy()
        amounts[self.free] += self.prior_sd * step
        spread[np.ix_(self.free, self.free)] += self.prior_sd[:, None] * grown * self.prior_sd
        ends = np.cumsum([len(a) for a in fit.amounts])[:-1]
        return replace(fit, amounts=tuple(np.split(amounts, ends)), spread=spread)

    def posterior(self, D: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean (p + q,) and covariance of values and coefficients, about the fit, by some entries (n,) bool.

        Averaged over the scales of a plausible size, whose evidence counts for TEMPERING as that of all rivals does.
        """
        learnt = [self.learnt_by(scale * D, mask) for scale in SCALES]
        weights = normalised({k: TEMPERING * evidence for k, (evidence, *_) in enumerate(learnt)}).values()
        units = [np.r_[np.ones(self.columns.shape[1]), np.full(D.shape[1], scale)] for scale in SCALES]
        means = [unit * own for unit, (_, own, _) in zip(units, learnt)]
        mean = sum(w * own for w, own in zip(weights, means))
        spreads = [
            np.outer(unit, unit) * own + np.outer(m - mean, m - mean)
            for unit, m, (_, _, own) in zip(units, means, learnt)
        ]
        return mean, sum(w * own for w, own in zip(weights, spreads))

    def left_by(self, D: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the residual (n,) [N] of all entries by what some teach, and the covariance of what was learnt."""
        mean, spread = self.posterior(D, mask)
        return self.left - np.column_stack([self.columns, D]) @ mean, spread

    def learnt_by(self, D: np.ndarray, mask: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Return log evidence, mean and covariance of a smooth change of directions (n, q) beside the fit."""
        columns, part = np.column_stack([self.columns, D]), self.covariance.restricted(mask)
        k = columns.shape[1]
        return evidence(part.whiten(self.left[mask]), part.whiten(columns[mask]), np.ones(k), np.zeros(k))
