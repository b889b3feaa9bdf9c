"""What no known effect explains, modelled without a name: its posterior mean, where it holds, and how sure it is.

A manner of `unknown.py` is a random function; learnt from the training readings it predicts those held out, or it is no
model of what is missing. What does is learnt once more from all readings. As a function of depth and place it corrects
simulated forces too: a numeric correction with a range of validity, not a cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pandas as pd
from scipy.special import logsumexp

from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.screen import SCALES, evidence
from gelforge.mismatch.result.verdict import SURE
from gelforge.mismatch.terms.holdout import Blocks, Gain, gain, predictive_scores
from gelforge.mismatch.terms.modules import Module
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.terms.refit import Refitted
from gelforge.mismatch.terms.unknown import FROM_PLACE_TO_PLACE, WITH_DEPTH, Manner, Span, manners

FARTHEST_MM = 6.0  # from the nearest site that it was learnt from, beyond which a change from place to place is not known


@dataclass(frozen=True, eq=False)
class Modelled:
    """A smooth change of unknown cause, beside the fitted effects or alone."""

    manner: str  # in words
    scale: float  # of its plausible size
    mean: np.ndarray  # (q,) posterior mean of its coefficients, by all readings
    covariance: np.ndarray  # (q, q)
    change: np.ndarray  # (n,) [N] of the readings at the mean
    left: np.ndarray  # (n,) [N] measured less the prediction by the training readings
    gain: Gain  # on what was held out, over the fitted effects alone
    scores: Mapping[str, pd.DataFrame]  # "before" and "after"
    span: Span
    sites: np.ndarray  # (S, 2) [mm] that it was learnt from
    beside: bool  # of fitted effects; else alone
    module: Module | None = None  # the cause, where it is physics with a free form
    probability: float = 0.0  # of that cause, by all readings
    spread: np.ndarray | None = None  # (n,) [N] standard deviation of the change

    @property
    def sure(self) -> bool:
        """Return whether it is a cause, as probable as a claim has to be."""
        return self.module is not None and self.module.tells and self.probability >= SURE

    @property
    def of_place(self) -> bool:
        """Return whether the change is a function of depth and place, which corrects labels."""
        if self.module is not None:
            return self.module.of_labels
        return self.manner.endswith((WITH_DEPTH, FROM_PLACE_TO_PLACE))

    def map(self) -> pd.DataFrame | None:
        """Return the rows of module.csv; None where it is no cause."""
        return None if self.module is None else self.module.values(self.scale, self.mean, self.covariance)

    def at(self, x_mm: np.ndarray, y_mm: np.ndarray, depth_mm: np.ndarray, force: np.ndarray) -> tuple:
        """Return the change (m, 3) [N] of forces (m, 3) [N] at places and depths (m,), its deviation, where it holds.

        The last (m,) bool: inside the depths, and near the sites, that it was learnt from; the others are nan elsewhere.
        """
        m = len(depth_mm)
        rows = pd.DataFrame(
            {
                "x_mm": np.repeat(x_mm, 3),
                "y_mm": np.repeat(y_mm, 3),
                "depth_mm": np.repeat(depth_mm, 3),
                "axis": np.tile(range(3), m),
                "press": 0,
                "session": "",
                "order": 0,
                "phase": "load",
                "press_time_s": 0.0,
            }
        )
        pressing = np.repeat(np.abs(force[:, 2]), 3)
        own = next(
            one
            for one in manners(rows, force.ravel(), pressing, self.span, np.zeros(3 * m, int))
            if one.words == self.manner
        )
        D = self.scale * own.directions
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
    tried: Sequence[Manner],
    blocks: Blocks,
    fit: Refitted | None = None,
    left: np.ndarray | None = None,
    chances: Mapping[str, float] = MappingProxyType({}),
) -> Modelled:
    """Return the manner that the training readings find likeliest beside a fit, or alone, learnt from these and from all.

    left (n,) [N]: what the fit leaves of all readings; chances: of manners, by all readings. What each indentation has of
    its own predicts no other and is not tried. Whether the readings held out confirm it is for the caller to ask (`gain`).
    """
    base = _Beside.of(problem, fit, left)
    train = blocks.train
    evidence = {
        (k, scale): base.evidence(scale * manner.directions, train)
        for k, manner in enumerate(tried)
        if manner.each is None
        for scale in SCALES
    }
    by_manner = {k: logsumexp([v for (j, _), v in evidence.items() if j == k]) for k, _ in evidence}
    k = max(by_manner, key=by_manner.__getitem__)
    scale = max(SCALES, key=lambda s: evidence[k, s])
    D = scale * tried[k].directions
    before, spread_before = base.learnt(np.zeros((len(D), 0)), train)
    after, spread = base.learnt(D, train)
    change = before - after
    columns = np.column_stack([base.columns, D])
    scores = {
        "before": predictive_scores(
            before, base.covariance, blocks, problem.labels, base.columns, spread_before, change
        ),
        "after": predictive_scores(after, base.covariance, blocks, problem.labels, columns, spread),
    }
    mean, covariance = base.posterior(D, np.ones(len(train), bool))
    p = base.columns.shape[1]
    own = covariance[p:, p:]
    table = problem.observations.table
    best = tried[k]
    return Modelled(
        manner=best.words,
        scale=scale,
        mean=mean[p:],
        covariance=own,
        change=D @ mean[p:],
        left=after,
        gain=gain(scores["before"], scores["after"]),
        scores=scores,
        span=Span.of(problem.labels),
        sites=table[["x_mm", "y_mm"]].drop_duplicates().to_numpy(float),
        beside=fit is not None,
        module=best if isinstance(best, Module) else None,
        probability=min(chances.get(best.words, 0.0), 1.0),
        spread=np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", D, own, D), 0.0)),
    )


@dataclass(frozen=True, eq=False)
class _Beside:
    """Fitted effects, linear about their fit, beside which a smooth change is learnt."""

    left: np.ndarray  # (n,) [N] what the fit leaves
    covariance: Covariance
    columns: np.ndarray  # (n, p) of the fit, in units of what all readings leave open of the values' priors

    @classmethod
    def of(cls, problem: Problem, fit: Refitted | None, left: np.ndarray | None) -> _Beside:
        if fit is None or left is None:
            return cls(problem.residual, problem.covariance, np.zeros((len(problem.labels), 0)))
        believed = problem.believing(fit.parts, np.concatenate(fit.amounts)).covariance
        p = sum(len(a) for a in fit.amounts)
        on = np.concatenate([np.full(len(a), part.switch) for part, a in zip(fit.parts, fit.amounts)])
        widths = np.concatenate(
            [np.broadcast_to(part.widths, len(a)) for part, a in zip(fit.parts, fit.amounts)]
        )
        return cls(left, believed, (fit.columns[:, :p] * widths)[:, ~on])

    def posterior(self, D: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean (p + q,) and covariance of values and coefficients, about the fit, by some entries (n,) bool."""
        return self._learnt_by(D, mask)[1:]

    def learnt(self, D: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the residual (n,) [N] of all entries by what some teach, and the covariance of what was learnt."""
        mean, spread = self.posterior(D, mask)
        return self.left - np.column_stack([self.columns, D]) @ mean, spread

    def evidence(self, D: np.ndarray, mask: np.ndarray) -> float:
        """Return the log evidence of a smooth change of directions (n, q) beside the fit, by some entries."""
        return self._learnt_by(D, mask)[0]

    def _learnt_by(self, D: np.ndarray, mask: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        columns, part = np.column_stack([self.columns, D]), self.covariance.restricted(mask)
        k = columns.shape[1]
        return evidence(part.whiten(self.left[mask]), part.whiten(columns[mask]), np.ones(k), np.zeros(k))
