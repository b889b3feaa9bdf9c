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

from gelforge.config import ConfigError
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.evidence.alternatives import TEMPERING, normalised
from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.gaussian import evidence
from gelforge.mismatch.evidence.screen import SCALES
from gelforge.mismatch.inference.fits import CURVED_SNR
from gelforge.mismatch.result.verdict import SURE
from gelforge.mismatch.terms.holdout import Blocks, Gain, gain, predictive_scores
from gelforge.mismatch.terms.module import Module
from gelforge.mismatch.terms.problem import Problem, secant
from gelforge.mismatch.terms.refit import Refitted
from gelforge.mismatch.terms.unknown import FROM_PLACE_TO_PLACE, WITH_DEPTH, Kernel, Span, kernels, log_priors

MOST_SOLUTIONS = 2  # of the study with the map of a cause
FARTHEST_MM = 6.0  # from the nearest site that it was learnt from, beyond which a change from place to place is not known


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
    base, every = _Beside.of(problem, fit, left), np.ones(len(problem.labels), bool)
    evidence = {
        (k, scale): base.evidence(scale * kernel.directions, every)
        for k, kernel in enumerate(tried)
        if kernel.each is None
        for scale in SCALES
    }
    priors = log_priors(tried)
    by_kernel = {
        k: TEMPERING * logsumexp([v for (j, _), v in evidence.items() if j == k]) + priors[tried[k].words]
        for k, _ in evidence
    }
    likeliest = tried[max(by_kernel, key=by_kernel.__getitem__)]
    chance = min(chances.get(likeliest.words, 0.0), 1.0)
    return _learnt(problem, base, blocks, likeliest, likeliest.directions, chance)


def through_solutions(
    problem: Problem,
    model: Modelled,
    blocks: Blocks,
    fit: Refitted | None = None,
    left: np.ndarray | None = None,
) -> tuple[Modelled, str]:
    """Return a cause whose map a study can have learnt once more by what the finite elements make of it, and what failed.

    fit, left: as it was learnt beside. The directions are put through the solved change at the map (Broyden's secant, in
    units of the prior) until both agree within noise.
    """
    module = model.module
    if problem.with_map is None or module is None or module.to_study is None:
        return model, ""
    base = _Beside.of(problem, fit, left)
    parts, amounts = ((), ()) if fit is None else (fit.parts, fit.amounts)
    flat, D = problem.observations.flat, module.directions
    # the base, or it with the fit
    without = problem.observations.force[problem.observations.read] - base.left
    for _ in range(MOST_SOLUTIONS):
        try:
            values = module.values(model.mean, model.covariance)["mean"].to_numpy()
            forces = problem.with_map(parts, amounts, module, values)
        except (NotConverged, ConfigError) as failure:
            return model, f"{module.name.replace('_', ' ')} is known to first order: {failure}"
        missing = flat(forces) - without - D @ model.mean
        if np.linalg.norm(base.covariance.whiten(missing)) < CURVED_SNR:
            break
        D = secant(D, missing, model.mean, np.ones(D.shape[1]))
        model = _learnt(problem, base, blocks, module, D, model.probability)
    return model, ""


def _learnt(
    problem: Problem,
    base: _Beside,
    blocks: Blocks,
    kernel: Kernel,
    D: np.ndarray,
    probability: float,
) -> Modelled:
    """Return a kernel of directions D (n, q) learnt from the training readings, for its gain, and from all."""
    train = blocks.train
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
    every, p = np.ones(len(train), bool), base.columns.shape[1]
    mean, covariance = base.posterior(D, every)
    grown = covariance[:p, :p] - base.posterior(D[:, :0], every)[1]
    own = covariance[p:, p:]
    table = problem.observations.table
    return Modelled(
        kernel=kernel.words,
        mean=mean[p:],
        covariance=own,
        change=D @ mean[p:],
        left=after,
        rest=base.left - columns @ mean,
        gain=gain(scores["before"], scores["after"]),
        scores=scores,
        span=Span.of(problem.labels),
        sites=table[["x_mm", "y_mm"]].drop_duplicates().to_numpy(float),
        beside=base.fit is not None,
        module=kernel if isinstance(kernel, Module) else None,
        probability=probability,
        spread=np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", D, own, D), 0.0)),
        fit=base.moved(mean[:p], grown),
    )


@dataclass(frozen=True, eq=False)
class _Beside:
    """Fitted effects, linear about their fit, beside which a smooth change is learnt; or none."""

    left: np.ndarray  # (n,) [N] what the fit leaves
    covariance: Covariance
    columns: np.ndarray  # (n, p) of the fit's amounts that are not switched on, in units of their priors
    fit: Refitted | None = None
    free: np.ndarray | None = None  # (a,) bool, amounts that are not switched on
    prior_sd: np.ndarray | None = None  # (p,) of the priors

    @classmethod
    def of(cls, problem: Problem, fit: Refitted | None, left: np.ndarray | None) -> _Beside:
        if fit is None or left is None:
            return cls(problem.residual, problem.covariance, np.zeros((len(problem.labels), 0)))
        uncertain = problem.with_model_error(fit.parts, np.concatenate(fit.amounts)).covariance
        p = sum(len(a) for a in fit.amounts)
        on = np.concatenate([np.full(len(a), part.binary) for part, a in zip(fit.parts, fit.amounts)])
        prior_sd = np.concatenate(
            [np.broadcast_to(part.prior_sd, len(a)) for part, a in zip(fit.parts, fit.amounts)]
        )
        return cls(left, uncertain, (fit.columns[:, :p] * prior_sd)[:, ~on], fit, ~on, prior_sd[~on])

    def moved(self, step: np.ndarray, grown: np.ndarray) -> Refitted | None:
        """Return the fit with its amounts a step (p,) further and their covariance grown by (p, p), in units of priors."""
        if self.fit is None or self.free is None or self.prior_sd is None:
            return None
        amounts, spread = np.concatenate(self.fit.amounts), self.fit.spread.copy()
        own = np.flatnonzero(self.free)
        amounts[own] += self.prior_sd * step
        spread[np.ix_(own, own)] += self.prior_sd[:, None] * grown * self.prior_sd
        ends = np.cumsum([len(a) for a in self.fit.amounts])[:-1]
        return replace(self.fit, amounts=tuple(np.split(amounts, ends)), spread=spread)

    def posterior(self, D: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean (p + q,) and covariance of values and coefficients, about the fit, by some entries (n,) bool.

        Averaged over the scales of a plausible size, whose evidence counts for TEMPERING as that of all rivals does.
        """
        p, q = self.columns.shape[1], D.shape[1]
        found = [(scale, *self._learnt_by(scale * D, mask)) for scale in SCALES]
        weights = normalised({scale: TEMPERING * evidence for scale, evidence, *_ in found})
        units = {scale: np.r_[np.ones(p), np.full(q, scale)] for scale in SCALES}
        means = {scale: units[scale] * own for scale, _, own, _ in found}
        mean = sum(weights[scale] * own for scale, own in means.items())
        covariance = sum(
            weights[scale]
            * (
                np.outer(units[scale], units[scale]) * own
                + np.outer(means[scale] - mean, means[scale] - mean)
            )
            for scale, _, _, own in found
        )
        return mean, covariance

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
