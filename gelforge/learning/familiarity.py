"""Whether an image is like those that a network has learnt from: the two statistics of principal components."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from sklearn.decomposition import PCA

COMPONENTS = 48
CLASSES = 6  # of the flow's size, each with a limit of its own
LEAST_IN_CLASS = 40
QUANTILE = 0.995  # of the validation rows that are to be within the limits
MARGIN = 1.3  # sessions differ more than the few at hand do
LEAST_ROWS = 30


@dataclass(frozen=True)
class Familiar:
    """The flow fields that training images span, and how far validation images lie from them.

    Inputs (n, F) of a network are split into the part along the training rows' principal components and the rest. Q is the
    rest's length; its limit depends on the length of the inputs, as noise and unlearnt detail grow with the flow. T^2 is the
    first part's squared length in standard deviations (Jackson & Mudholkar 1979, doi:10.1080/00401706.1979.10489779).
    """

    mean: np.ndarray  # (F,) float32
    components: np.ndarray  # (K, F) float32, orthonormal
    deviation: np.ndarray  # (K,) of the training rows along them
    edges: np.ndarray  # (C - 1,) lengths of inputs between classes
    rest_limit: np.ndarray  # (C,)
    squared_limit: float

    def unlike(self, inputs: np.ndarray) -> np.ndarray:
        """Return how unlike the training images those of inputs (n, F) are (n,): beyond 1 they are flagged."""
        return unlike(self.statistics(inputs), self.edges, self.rest_limit, self.squared_limit)

    def statistics(self, inputs: np.ndarray) -> np.ndarray:
        """Return the inputs' length, that of their rest, and T^2 (n, 3)."""
        away = inputs - self.mean
        along = away @ self.components.T  # (n, K)
        rest = np.sqrt(np.maximum((away**2).sum(axis=1) - (along**2).sum(axis=1), 0.0))
        size, squared = np.linalg.norm(inputs, axis=1), ((along / self.deviation) ** 2).sum(axis=1)
        return np.stack([size, rest, squared], axis=1)


def unlike(
    statistics: np.ndarray, edges: np.ndarray, rest_limit: np.ndarray, squared_limit: float
) -> np.ndarray:
    """Return how unlike the training images those of statistics (n, 3) are (n,); the rest is as in Familiar."""
    size, rest, squared = statistics.T
    limit = rest_limit[np.searchsorted(edges, size, side="right")]
    return np.maximum(rest / limit, np.sqrt(squared / squared_limit))


def find_familiar(training: np.ndarray, validation: np.ndarray) -> Familiar | None:
    """Return what training inputs (n, F) span, with limits of validation inputs (m, F); None where either are few."""
    if min(len(training), len(validation)) < LEAST_ROWS:
        return None
    count = min(COMPONENTS, len(training) // 3, training.shape[1])
    found = PCA(count, svd_solver="randomized", random_state=0).fit(training)
    kept = found.explained_variance_ > 1e-9 * found.explained_variance_[0]
    parts = found.mean_, found.components_[kept], np.sqrt(found.explained_variance_[kept])
    mean, components, deviation = (np.asarray(values, np.float32) for values in parts)
    open_ = Familiar(mean, components, deviation, np.empty(0), np.ones(1), 1.0)
    size, rest, squared = open_.statistics(validation).T
    classes = int(np.clip(len(size) // LEAST_IN_CLASS, 1, CLASSES))
    edges = np.unique(np.quantile(size, np.arange(1, classes) / classes))
    which = np.searchsorted(edges, size, side="right")
    limits = [rest[which == k] if (which == k).any() else rest for k in range(len(edges) + 1)]
    return Familiar(
        *(mean, components, deviation, edges),
        np.array([MARGIN * np.quantile(own, QUANTILE) for own in limits]),
        float(MARGIN**2 * np.quantile(squared, QUANTILE)),
    )
