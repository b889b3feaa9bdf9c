"""Whether an image is like those that a network has learnt from: the two statistics of principal components."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

COMPONENTS = 48
CLASSES = 6  # of the flow's size, each with a limit of its own
LEAST_IN_CLASS = 40
QUANTILE = 0.995  # of held-out rows that are to be within the limits
LEAST_ROWS = 60
FOLDS = 5


@dataclass(frozen=True)
class Familiar:
    """The flow fields that images of a training set span, and how far those that are held out lie from them.

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
        """Return the inputs' length, that of their rest, and T^2 (n, 3).

        The rest is a vector before its length is taken: |away|^2 - |along|^2 cancels where images resemble the training set.
        """
        away = inputs - self.mean
        along = away @ self.components.T  # (n, K)
        rest = away - along @ self.components
        squared = ((along / self.deviation) ** 2).sum(axis=1)
        return np.stack([_length(inputs), _length(rest), squared], axis=1)


def _length(rows: np.ndarray) -> np.ndarray:
    """Return the lengths of rows (n, F); in double precision, as the order of a sum depends on how rows lie in memory."""
    return np.linalg.norm(rows.astype(float), axis=1)


def unlike(
    statistics: np.ndarray, edges: np.ndarray, rest_limit: np.ndarray, squared_limit: float
) -> np.ndarray:
    """Return how unlike the training images those of statistics (n, 3) are (n,); the rest is as in Familiar."""
    size, rest, squared = statistics.T
    limit = rest_limit[np.searchsorted(edges, size, side="right")]
    return np.maximum(rest / limit, np.sqrt(squared / squared_limit))


def find_familiar(inputs: np.ndarray, groups: np.ndarray) -> Familiar | None:
    """Return what inputs (n, F) span, with limits for images of groups (n,) that it was not learnt from.

    Limits are what fold by fold the components of the other groups leave of a fold's: a group is all that goes together, as
    the images of an orbit do. None where rows or groups are few.
    """
    names = np.unique(groups)
    if len(inputs) < LEAST_ROWS or len(names) < FOLDS:
        return None
    fold = np.random.default_rng(0).permutation(len(names))[np.searchsorted(names, groups)] % FOLDS
    statistics = np.empty((len(inputs), 3))
    for k in range(FOLDS):
        statistics[fold == k] = _spanned(inputs[fold != k]).statistics(inputs[fold == k])
    return _limited(_spanned(inputs), statistics)


def _spanned(inputs: np.ndarray) -> Familiar:
    """Return the principal components of inputs (n, F), with limits of one."""
    from sklearn.decomposition import PCA  # takes seconds, and predict and live never fit

    count = min(COMPONENTS, len(inputs) // 3, inputs.shape[1])
    found = PCA(count, svd_solver="randomized", random_state=0).fit(inputs)
    kept = found.explained_variance_ > 1e-9 * found.explained_variance_[0]
    parts = found.mean_, found.components_[kept], np.sqrt(found.explained_variance_[kept])
    mean, components, deviation = (np.asarray(values, np.float32) for values in parts)
    return Familiar(mean, components, deviation, np.empty(0), np.ones(1), 1.0)


def _limited(spanned: Familiar, statistics: np.ndarray) -> Familiar:
    """Return components with the limits that hold all but 1 - QUANTILE of statistics (n, 3), by class of size."""
    size, rest, squared = statistics.T
    classes = int(np.clip(len(size) // LEAST_IN_CLASS, 1, CLASSES))
    edges = np.unique(np.quantile(size, np.arange(1, classes) / classes))
    which = np.searchsorted(edges, size, side="right")
    limits = [rest[which == k] if (which == k).any() else rest for k in range(len(edges) + 1)]
    return replace(
        spanned,
        edges=edges,
        rest_limit=np.array([np.quantile(own, QUANTILE) for own in limits]),
        squared_limit=float(np.quantile(squared, QUANTILE)),
    )
