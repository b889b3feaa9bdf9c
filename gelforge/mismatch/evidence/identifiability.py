"""What this recording can and cannot distinguish, what it could detect, and which experiment would decide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.screen import Candidate, Screened
from gelforge.mismatch.result.verdict import Experiment
from gelforge.mismatch.thresholds import DETECTED_SNR, INDISTINGUISHABLE


@dataclass(frozen=True, eq=False)
class Plan:
    """An experiment: its covariance, and by effect the change of its n entries per unit of the parameter."""

    name: str
    cost: float  # minutes on the stage
    presses: int
    covariance: Covariance
    columns: Mapping[str, np.ndarray]  # (n, p) [N per unit]
    errors: Mapping[str, np.ndarray] = field(default_factory=dict)  # (n, k) [N] of each effect's own change


def indistinguishable(covariance: Covariance, singles: Mapping[str, Screened]) -> dict[str, frozenset[str]]:
    """Return the line of each effect: effects whose sensitivities cannot be distinguished, all of each other.

    Of effects with one parameter readings play no part: a plan knows their lines before any of them. The covariance holds
    the nuisance parameters. Lines are clusters of complete linkage.

    Parameters
    ----------
    covariance : Covariance
        Of n entries.
    singles : mapping of Screened
        By effect, judged alone.

    Returns
    -------
    dict of frozenset
        By effect, names.
    """
    names = [*singles]
    if len(names) < 2:
        return {name: frozenset({name}) for name in names}
    columns = [one.parts[-1].columns for one in singles.values()]
    changes = [
        one.change if sensitivity.shape[1] > 1 and np.any(one.change) else sensitivity.sum(axis=1)
        for one, sensitivity in zip(singles.values(), columns)
    ]
    correlation = correlations(
        covariance.whiten(np.column_stack(changes)),
        [covariance.whiten(sensitivity) for sensitivity in columns],
    )
    line = fcluster(
        linkage(squareform(1 - correlation, checks=False), "complete"),
        1 - INDISTINGUISHABLE,
        criterion="distance",
    )
    return {
        name: frozenset(np.array(names)[line == sensitivity].tolist())
        for name, sensitivity in zip(names, line)
    }


def correlations(changes: np.ndarray, sensitivities: Sequence[np.ndarray]) -> np.ndarray:
    """Return the correlations (k, k) of whitened changes (n, k) of effects, given their sensitivities (n, p_k).

    The share of one effect's change that the other one can follow, of both ways the smaller one: |cos| of effects with one
    parameter each.
    """
    unit = changes / np.maximum(np.linalg.norm(changes, axis=0), np.finfo(float).tiny)
    followed = np.empty((len(sensitivities), len(sensitivities)))
    for k, sensitivity in enumerate(sensitivities):
        u, size, _ = np.linalg.svd(sensitivity, full_matrices=False)
        basis = u[:, size > 1e-9 * max(size.max(initial=0.0), np.finfo(float).tiny)]
        followed[:, k] = np.linalg.norm(basis.T @ unit, axis=0)
    return np.clip(np.minimum(followed, followed.T), 0.0, 1.0)


def detection_limits(
    covariance: Covariance, candidates: Sequence[Candidate]
) -> list[tuple[Candidate, int, float]]:
    """Return for each effect and parameter the best candidate, the parameter's number, and its smallest value that is seen.

    That is the value whose change has an SNR of DETECTED_SNR; infinite where the readings do not change.
    """
    limits: dict[tuple[str, int], tuple[float, Candidate, int, float]] = {}
    for candidate in candidates:
        norms = np.linalg.norm(covariance.whiten(candidate.columns), axis=0)
        for k, norm in enumerate(norms):
            value = float(DETECTED_SNR / norm) if norm > 0 else np.inf
            share = value / (1.0 if candidate.binary else float(candidate.prior_sd[k]))
            if (key := (candidate.name, k)) not in limits or share < limits[key][0]:
                limits[key] = share, candidate, k, value
    return [(candidate, k, value) for _, candidate, k, value in limits.values()]


def expected_log_odds(plan: Plan, first: Screened, second: Screened) -> float:
    """Return the expected log Bayes factor of the right one of two effects after the plan, each right half of the time.

    Each predicts N(J a, C + J S J' + E E'), a and S the values that the readings at hand give, E the errors of its change;
    the expectation is the Kullback-Leibler divergence of one prediction from the other, and all that differs lies in the
    span of their columns.
    """
    means, spreads = [], []
    for judged in (first, second):
        J = plan.covariance.whiten(np.column_stack([plan.columns[part.name] for part in judged.parts]))
        l, E = np.linalg.eigh(judged.covariance)
        means.append(J @ judged.theta)
        errs = [plan.covariance.whiten(plan.errors[p.name]) for p in judged.parts if p.name in plan.errors]
        spreads.append(np.column_stack([J @ (E * np.sqrt(np.maximum(l, 0))), *errs]))
    Q = np.linalg.qr(np.column_stack([*means, *spreads]))[0]
    m = [Q.T @ mean for mean in means]
    S = [np.eye(Q.shape[1]) + (Q.T @ U) @ (Q.T @ U).T for U in spreads]
    return 0.5 * (_divergence(m[0], S[0], m[1], S[1]) + _divergence(m[1], S[1], m[0], S[0]))


def next_experiment(plans: Sequence[Plan], first: Screened, second: Screened) -> list[Experiment]:
    """Return the plans, the one to make first: the cheapest that is expected to decide, else the most informative one."""
    separates, ranked = [first.name, second.name], []
    for plan in plans:
        odds = expected_log_odds(plan, first, second)
        one = Experiment(
            words=plan.name,
            separates=separates,
            presses=plan.presses,
            cost_s=60 * plan.cost,
            expected_log_odds=odds,
        )
        ranked.append(((not one.decides, plan.cost if one.decides else -odds, -odds), one))
    return [one for _, one in sorted(ranked, key=lambda both: both[0])]


def _divergence(m: np.ndarray, S: np.ndarray, m0: np.ndarray, S0: np.ndarray) -> float:
    """Return the Kullback-Leibler divergence of N(m0, S0) from N(m, S)."""
    difference = m0 - m
    inverse = np.linalg.inv(S0)
    log_det = np.linalg.slogdet(S0)[1] - np.linalg.slogdet(S)[1]
    return float(0.5 * (np.trace(inverse @ S) - len(m) + difference @ inverse @ difference + log_det))
