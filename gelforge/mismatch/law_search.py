"""A law for a mismatch that no known effect explains: at most two dimensionless terms. A law, not a cause."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
import pandas as pd

from gelforge.mismatch.covariance import Covariance
from gelforge.mismatch.holdout import conditional_gram

LABEL = "a law, not a cause"
POWERS = (0.5, 1.0, 2.0, 3.0)
WIDTH = (
    0.3  # standard deviation of a coefficient: terms are at most 1, and 30 % of the force is a large mismatch
)
FOLDS = 5


@dataclass(frozen=True, eq=False)
class Terms:
    """Dimensionless terms times a force: m patterns over the n entries."""

    names: tuple[str, ...]
    values: np.ndarray  # (n, m) [N]


@dataclass(frozen=True)
class Law:
    """residual = the sum of coefficient * term, dimensionless coefficients; gain over no law on sites held out."""

    terms: tuple[str, ...]
    coefficients: tuple[float, ...]
    standard_deviations: tuple[float, ...]
    gain: float  # log score over all folds
    standard_error: float
    label: str = LABEL

    @property
    def text(self) -> str:
        """Return the law as one line."""
        sums = " + ".join(
            f"({c:.3g} +- {s:.1g}) {term}"
            for c, s, term in zip(self.coefficients, self.standard_deviations, self.terms)
        )
        return f"residual = {sums or '0'} ({self.label})"


def terms(
    labels: pd.DataFrame, base: np.ndarray, radius_mm: float, height_mm: float, widths_mm: tuple[float, float]
) -> Terms:
    """Return powers of depth, position and time over the lengths and times of the experiment, times a force.

    labels (n rows), base (n,) [N]: terms multiply the base force, or per axis its largest magnitude over all axes. Each
    ratio is divided by its largest magnitude on these readings where that is above 1, so that coefficients compare.
    """
    axis = labels["axis"].to_numpy()
    largest = float(np.abs(base).max(initial=0))
    forces = {"F_base": base}
    forces |= {f"F_max e_{name}": largest * (axis == k) for k, name in enumerate("xyz") if np.any(axis == k)}
    names, columns = [], []
    for ratio, values in _ratios(labels, radius_mm, height_mm, widths_mm):
        for name, force in forces.items():
            if np.any(force * values):
                names.append(f"{ratio} {name}" if ratio != "1" else name)
                columns.append(force * values)
    return Terms(tuple(names), np.column_stack(columns))


def _ratios(
    labels: pd.DataFrame, radius: float, height: float, widths: tuple[float, float]
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield dimensionless ratios (n,) by name, of magnitude 1 at most."""
    column = {name: labels[name].to_numpy(float) for name in ("depth_mm", "x_mm", "y_mm", "press_time_s")}
    depth = np.maximum(column["depth_mm"], 0)
    x, y = (2 * column[name] / width - 1 for name, width in zip(("x_mm", "y_mm"), widths))
    positive: dict[str, np.ndarray] = {
        "(depth/radius)": depth / radius,
        "(depth/height)": depth / height,
        "(distance from centre/half width)": np.hypot(x, y),
        "(press time/longest press)": _share(column["press_time_s"]),
        "(order/last)": _share(labels["order"].to_numpy(float)),
    }
    yield "1", np.ones(len(labels))
    for name, values in positive.items():
        if np.ptp(values) > 0:
            scaled = values / max(1.0, values.max())
            for power in POWERS:
                yield f"{name}^{power:g}", scaled**power
    for name, values in {"x": x, "y": y, "x y": x * y}.items():
        if np.ptp(values) > 0:
            yield f"({name}/half width)", values / max(1.0, np.abs(values).max())
    unloading = (labels["phase"] == "unload").to_numpy(float)
    if 0 < unloading.sum() < len(unloading):
        yield "[unloading]", unloading


def _share(values: np.ndarray) -> np.ndarray:
    largest = values.max(initial=0)
    return np.maximum(values, 0) / largest if largest > 0 else np.zeros(len(values))


def search(
    residual: np.ndarray, covariance: Covariance, candidates: Terms, labels: pd.DataFrame, seed: int = 0
) -> Law:
    """Return the law of no, one or two terms that predicts sites held out best; every subset is tried.

    residual (n,) [N] = measured - the best known model. Sites are held out in turn in at most FOLDS folds; coefficients
    have priors N(0, WIDTH^2), and laws of one size share their prior weight, so each pays the logarithm of their number
    for having been looked for. The simplest law within one standard error of the best is returned. Its gain is the best of
    thousands and so too good: judge it on blocks that were set aside before.
    """
    site = labels["site"].to_numpy()
    V = np.column_stack([residual, WIDTH * candidates.values])
    m = candidates.values.shape[1]
    subsets = [(), *((i,) for i in range(m)), *combinations(range(m), 2)]
    white = covariance.whiten(V)
    gains = np.array(
        [_gains(*_grams(V, covariance, np.isin(site, fold)), subsets) for fold in _folds(site, seed)]
    )  # (folds, subsets)
    chosen = _simplest(gains, [len(subset) for subset in subsets], m)
    a, S = _posterior(white.T @ white, np.array(subsets[chosen], dtype=int))
    total, error = _total(gains[:, chosen])
    return Law(
        terms=tuple(candidates.names[i] for i in subsets[chosen]),
        coefficients=tuple(float(v) for v in WIDTH * a),
        standard_deviations=tuple(float(v) for v in WIDTH * np.sqrt(np.diag(S))),
        gain=total,
        standard_error=error,
    )


def _folds(site: np.ndarray, seed: int) -> list[np.ndarray]:
    sites = np.random.default_rng(seed).permutation(np.unique(site))
    if len(sites) < 2:
        raise ValueError("readings at one site only; a law needs two sites at least, one to be held out")
    return np.array_split(sites, min(FOLDS, len(sites)))


def _grams(V: np.ndarray, covariance: Covariance, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the products of V's columns on the training entries, and on those held out given the former."""
    train = covariance.restricted(~held).whiten(V[~held])
    return train.T @ train, conditional_gram(V, covariance, ~held, held)[0]


def _posterior(G: np.ndarray, subset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and covariance of the coefficients in units of WIDTH, from the products of residual and terms."""
    S = np.linalg.inv(np.eye(len(subset)) + G[np.ix_(subset + 1, subset + 1)])
    return S @ G[subset + 1, 0], S


def _gains(train: np.ndarray, held: np.ndarray, subsets: list[tuple[int, ...]]) -> np.ndarray:
    """Return the gain in predictive log score on the held-out entries of every subset."""
    found = np.zeros(len(subsets))
    for size in (1, 2):
        here = [k for k, subset in enumerate(subsets) if len(subset) == size]
        if not here:
            continue
        A = np.array([subsets[k] for k in here]) + 1  # (s, size) columns of the products
        block = (A[:, :, None], A[:, None, :])
        S = np.linalg.inv(np.eye(size) + train[block])
        a = np.einsum("sij,sj->si", S, train[A, 0])
        H, h = held[block], held[A, 0]
        g = h - np.einsum("sij,sj->si", H, a)  # of the held residual less the prediction
        square = held[0, 0] - 2 * np.einsum("si,si->s", a, h) + np.einsum("si,sij,sj->s", a, H, a)
        B = np.linalg.inv(S) + H
        square -= np.einsum("si,si->s", g, np.linalg.solve(B, g[:, :, None])[:, :, 0])
        log_det = np.linalg.slogdet(B)[1] + np.linalg.slogdet(S)[1]
        found[here] = 0.5 * (held[0, 0] - square - log_det)
    return found


def _total(gains: np.ndarray) -> tuple[float, float]:
    """Return sum and standard error of the gains (folds,)."""
    return float(gains.sum()), float(np.sqrt(len(gains)) * gains.std(ddof=1))


def _simplest(gains: np.ndarray, sizes: list[int], m: int) -> int:
    """Return the number of the law, by gains (folds, laws): of the smallest size within one standard error of the best."""
    weighted = gains.sum(axis=0) - np.log([comb(m, size) for size in sizes])
    best = int(np.argmax(weighted))
    for size in range(sizes[best]):
        k = max((k for k, other in enumerate(sizes) if other == size), key=lambda k: weighted[k])
        error = _total(gains[:, best] - gains[:, k])[1]
        if weighted[best] - weighted[k] < error:
            return k
    return best
