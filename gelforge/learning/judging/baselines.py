"""Baselines next to the network: ridge, kernel ridge and nearest neighbours of scikit-learn, and inverse elasticity."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.linalg import LinAlgWarning
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.kernel_ridge import KernelRidge
from sklearn.linear_model import Ridge
from sklearn.neighbors import KNeighborsRegressor

from gelforge.dataset.shard import ShardDataset
from gelforge.learning.basis.data import FEATURE, LABEL, at_most, one_of_each_press
from gelforge.learning.basis.scaling import Scaling
from gelforge.learning.elasticity.inverse import Inverse
from gelforge.learning.models.reliability import Zero, find_zero
from gelforge.progress import tracked

MOST_ROWS = 4000  # that a baseline learns from: a kernel matrix of them is 128 MB
MOST_WATCHED = 2000  # validation rows that choose its settings

RIDGE = [Ridge(alpha=alpha) for alpha in (1.0, 10.0, 100.0, 1000.0)]
NEIGHBOURS = [KNeighborsRegressor(count, weights="distance") for count in (1, 3, 5, 10, 20)]


def _choices(inputs: int) -> dict[str, list[RegressorMixin]]:
    """Return the settings among which the validation rows choose, by baseline; inputs: their number, each of unit size."""
    kernels = [
        KernelRidge(kernel="rbf", gamma=width / inputs, alpha=alpha)
        for width, alpha in product((0.03, 0.1, 0.3, 1.0), (1e-3, 1e-2))
    ]
    return {"ridge": RIDGE, "kernel ridge": kernels, "nearest neighbours": NEIGHBOURS}


@dataclass(frozen=True)
class Baseline:
    """A fitted baseline that says newtons, with exact zeros found as the network's are."""

    name: str
    estimator: BaseEstimator
    scaling: Scaling
    zero: Zero

    @property
    def settings(self) -> str:
        """What the validation rows chose."""
        return f"{self.estimator!r}".replace("\n", " ")

    def predict(self, feature: np.ndarray) -> np.ndarray:
        """Return force distributions (n, B, 3) [N] of features (n, F)."""
        return self.zero.applied(self.predict_raw(feature))

    def predict_raw(self, feature: np.ndarray) -> np.ndarray:
        """Return the same without zeros."""
        return self.scaling.newtons(self.estimator.predict(self.scaling.inputs(feature)))


@dataclass(frozen=True)
class InverseBaseline:
    """The forces of inverse elasticity times one gain, with exact zeros found as the network's are."""

    inverse: Inverse
    gain: float
    zero: Zero
    name: str = "inverse elasticity"

    @property
    def settings(self) -> str:
        """What the validation rows gave it; nothing is trained."""
        return f"gain {self.gain:.4g} of all forces, friction {self.inverse.friction:g}"

    def predict(self, feature: np.ndarray) -> np.ndarray:
        """Return force distributions (n, B, 3) [N] of features (n, F)."""
        return self.zero.applied(self.predict_raw(feature))

    def predict_raw(self, feature: np.ndarray) -> np.ndarray:
        """Return the same without zeros."""
        return self.gain * self.inverse.forces(feature)


def fit_inverse(
    rows: ShardDataset, validation: np.ndarray, inverse: Inverse, grid: tuple, seed: int
) -> InverseBaseline:
    """Return inverse elasticity with its gain: least squares on total Fz of rows validation (m,), 1 without any."""
    index = at_most(validation, MOST_WATCHED, seed)
    if not len(index):
        return InverseBaseline(inverse, 1.0, Zero())
    block = rows.read(index, (FEATURE, LABEL, "untouched"))
    predicted, true = inverse.forces(block[FEATURE]), block[LABEL].astype(float)
    gain = total_gain(predicted, true)
    return InverseBaseline(inverse, gain, find_zero(gain * predicted, true, block["untouched"], grid))


def total_gain(predicted: np.ndarray, true: np.ndarray) -> float:
    """Return the factor on distributions (n, B, 3) [N] that brings their total Fz nearest to the true ones'; 1: no force."""
    push, wanted = (force[..., 2].sum(axis=1, dtype=float) for force in (predicted, true))
    return float(push @ wanted / (push @ push)) if push.any() else 1.0


def fit_baselines(
    rows: ShardDataset, training: np.ndarray, validation: np.ndarray, scaling: Scaling, grid: tuple, seed: int
) -> Iterator[Baseline]:
    """Yield each baseline, fitted to one image of each indentation of rows training (n,), chosen by those of validation
    (m,).

    Inputs and targets are the network's. At most MOST_ROWS indentations are taken, drawn by seed: kernel ridge keeps them
    all. The choice is that of the least mean squared error; zeros are found as `find_zero` does. grid: bins nx, ny, widths
    [mm].
    """
    learnt = at_most(one_of_each_press(rows, training), MOST_ROWS, seed)
    inputs, targets, _ = _read(rows, learnt, scaling)
    watched, wanted, untouched = _read(rows, at_most(validation, MOST_WATCHED, seed), scaling)
    for name, choices in tracked(_choices(inputs.shape[1]).items(), "baselines fitted"):
        fitted = [_fitted(choice, inputs, targets) for choice in choices]
        if not len(wanted):  # nothing to choose by
            yield Baseline(name, fitted[0], scaling, Zero())
            continue
        said = [estimator.predict(watched) for estimator in fitted]
        best = int(np.argmin([np.mean((predicted - wanted) ** 2) for predicted in said]))
        zero = find_zero(scaling.newtons(said[best]), scaling.newtons(wanted), untouched, grid)
        yield Baseline(name, fitted[best], scaling, zero)


def _fitted(estimator: RegressorMixin, inputs: np.ndarray, targets: np.ndarray) -> RegressorMixin:
    if isinstance(estimator, KNeighborsRegressor) and estimator.n_neighbors > len(inputs):
        estimator = KNeighborsRegressor(len(inputs), weights=estimator.weights)
    with warnings.catch_warnings():  # little regularisation is one of the choices; validation decides
        warnings.simplefilter("ignore", LinAlgWarning)
        return estimator.fit(inputs, targets)


def _read(
    rows: ShardDataset, index: np.ndarray, scaling: Scaling
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return inputs (n, F), targets (n, 3 B) and which rows are untouched (n,)."""
    if not len(index):
        bins = len(scaling.output_mean)
        return np.empty((0, len(scaling.input_mean))), np.empty((0, 3 * bins)), np.empty(0, bool)
    block = rows.read(index, (FEATURE, LABEL, "untouched"))
    return scaling.inputs(block[FEATURE]), scaling.targets(block[LABEL]), block["untouched"]
