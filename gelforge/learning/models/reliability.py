"""Exact zeros where nothing touches, and intervals of forces: both found on rows that the network did not learn from."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

# Intervals hold nine in ten of other rows, and light touches stay (tests/learning/test_reliability.py):
QUIET_SHARE = 0.999  # of the untouched validation rows that are to be exactly zero
MARGIN = 1.5  # times the largest force there: other sessions are noisier than those at hand
LADDER = np.array([0.5, 1, 2, 4, 8, 16])  # of the bins' threshold over the images'
# Of the largest bin: a light touch keeps the bins that carry it, however much the others smear
# (tests/learning/test_reliability.py).
LIGHT_SHARE = 0.3
COVER = 0.9  # share of errors that an interval holds: 90 %, as every interval of forces (docs/learning.md)
WIDTH = round(
    NormalDist().inv_cdf((1 + COVER) / 2), 3
)  # 1.645 standard deviations of a normal error on each side
# Of predicted force, each with an interval of its own: they hold nine in ten at every size
# (tests/learning/test_reliability.py).
CLASSES = 8
# The share that an interval from 100 rows holds has a standard deviation of sqrt(0.9 x 0.1 / 100) = 3 % (Vovk 2012).
LEAST_IN_CLASS = 100
# Below which there is no interval: the share that one from 30 rows holds has a standard deviation of 5.5 % (Vovk 2012).
LEAST_ROWS = 30


@dataclass(frozen=True)
class Zero:
    """Forces below which nothing touches."""

    contact_N: float = 0.0  # an image touches where a bin's force is at least this long
    bin_N: float = 0.0  # and in it the bins whose force is at least this long, and the one of the largest

    def applied(self, force: np.ndarray) -> np.ndarray:
        """Return distributions (n, B, 3) [N] with what does not touch set to zero."""
        size = np.linalg.norm(force, axis=-1)  # (n, B)
        largest = size.max(axis=1, keepdims=True)
        touched = (size >= np.minimum(self.bin_N, LIGHT_SHARE * largest)) & (largest >= self.contact_N)
        return np.where((touched & (size > 0))[..., None], force, 0.0)


def find_zero(force: np.ndarray, true: np.ndarray, untouched: np.ndarray, grid: tuple) -> Zero:
    """Return the thresholds of predicted distributions (n, B, 3) [N] next to the true ones of validation rows (n,).

    An image touches from a little above the largest force that untouched images show on. A bin of a touched image does from
    the threshold under which the centre of pressure errs least: many bins far away that show a little draw it to the middle
    of the sensor. grid: bins nx, ny and widths [mm].
    """
    size = np.linalg.norm(force, axis=-1)
    if not untouched.any() or untouched.all():
        return Zero()
    contact = MARGIN * float(np.quantile(size[untouched].max(axis=1), QUIET_SHARE))
    known = centre_of_pressure(true[~untouched], *grid)
    best, least = Zero(contact, contact), np.inf
    for threshold in (contact * LADDER).tolist():
        zero = Zero(contact, threshold)
        off = np.hypot(*(centre_of_pressure(zero.applied(force[~untouched]), *grid) - known).T)
        error = float(np.quantile(np.nan_to_num(off, nan=np.inf), 0.9, method="higher"))
        best, least = (zero, error) if error < least else (best, least)
    return best


def centre_of_pressure(force: np.ndarray, nx: int, ny: int, width_mm: np.ndarray) -> np.ndarray:
    """Return the centre of pressure of force distributions: moment of the vertical forces over their sum.

    Parameters
    ----------
    force : numpy.ndarray
        (n, B, 3) [N], bin k = nx iy + ix.
    nx, ny : int
        Bins along x and y.
    width_mm : numpy.ndarray
        (2,) of the rectangle of the bins.

    Returns
    -------
    numpy.ndarray
        (n, 2) [mm]; NaN where the sum of vertical forces is not negative.
    """
    x = (np.arange(nx * ny) % nx + 0.5) * width_mm[0] / nx
    y = (np.arange(nx * ny) // nx + 0.5) * width_mm[1] / ny
    total = force[..., 2].sum(axis=1)
    total = np.where(total < 0, total, np.nan)
    return np.stack([force[..., 2] @ x, force[..., 2] @ y], axis=-1) / total[:, None]


@dataclass(frozen=True)
class Intervals:
    """Half widths of 90 % intervals by the size of the predicted force: split conformal prediction within classes of it.

    Valid for sites and images like the validation rows' (Vovk, Gammerman & Shafer 2005; Lei et al. 2018). Those of `of_bins`
    and `of_totals` hold the label; those of the true force are wider by the label's own standard deviation, as the root of
    the squares' sum.
    """

    bin_edges_N: np.ndarray  # (C - 1,) lengths of a bin's force between classes
    bin_half_N: np.ndarray  # (C, 3)
    bin_sigma_N: np.ndarray  # (C, 3) rms standard deviation of the labels; 0 where labels have none
    total_edges_N: np.ndarray  # (T - 1,)
    total_half_N: np.ndarray  # (T, 3)
    total_sigma_N: np.ndarray  # (T, 3)

    def of_bins(self, force: np.ndarray) -> np.ndarray:
        """Return half widths (n, B, 3) [N] of predicted distributions (n, B, 3)."""
        return self.bin_half_N[_class(self.bin_edges_N, force)]

    def of_totals(self, force: np.ndarray) -> np.ndarray:
        """Return half widths (n, 3) [N] of the totals of predicted distributions (n, B, 3)."""
        return self.total_half_N[_class(self.total_edges_N, force.sum(axis=1))]

    def of_true_bins(self, force: np.ndarray) -> np.ndarray:
        """Return the same as of_bins for the true force: with the labels' own uncertainty."""
        half = np.hypot(self.bin_half_N, WIDTH * self.bin_sigma_N)  # (C, 3)
        return half[_class(self.bin_edges_N, force)]

    def of_true_totals(self, force: np.ndarray) -> np.ndarray:
        """Return the same as of_totals for the true force: with the labels' own uncertainty."""
        half = np.hypot(self.total_half_N, WIDTH * self.total_sigma_N)  # (C, 3)
        return half[_class(self.total_edges_N, force.sum(axis=1))]


def _class(edges: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return the class (...) of the lengths of forces (..., 3)."""
    return np.searchsorted(edges, np.linalg.norm(force, axis=-1), side="right")


@dataclass(frozen=True)
class Labels:
    """What validation rows say of their forces [N], and how sure they are of it."""

    bins: np.ndarray  # (n, B, 3)
    bin_sigma: np.ndarray  # (n, B, 3); NaN: no error bars
    total_sigma: np.ndarray  # (n, 3)


def find_intervals(force: np.ndarray, labels: Labels, groups: np.ndarray) -> Intervals | None:
    """Return the intervals that hold the labels of validation rows about predicted distributions (n, B, 3) [N].

    Of touched rows alone, and of bins that carry force: the many that carry none would make the intervals narrow. Errors of
    a group (n,), as the rows of an orbit, go together, and groups are few: the widths are those of all rows, times what
    makes those of the other groups hold nine in ten of each group's.
    """
    touched = np.abs(labels.bins).max(axis=(1, 2)) > 0
    if touched.sum() < LEAST_ROWS:
        return None
    force, true, group = force[touched], labels.bins[touched], groups[touched]
    bins = np.abs(true).max(axis=-1) > 0
    of_each_bin = np.broadcast_to(group[:, None], bins.shape)[bins]
    of_bins = _by_class(force[bins], true[bins], labels.bin_sigma[touched][bins], of_each_bin)
    of_totals = _by_class(force.sum(axis=1), true.sum(axis=1), labels.total_sigma[touched], group)
    return Intervals(*of_bins, *of_totals)


def _by_class(
    force: np.ndarray, true: np.ndarray, sigma: np.ndarray, group: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return edges (C - 1,) of classes of |force| (m, 3) with as many rows in each, half widths and rms sigma (C, 3)."""
    size = np.linalg.norm(force, axis=-1)
    classes = int(np.clip(len(size) // LEAST_IN_CLASS, 1, CLASSES))
    edges = np.unique(np.quantile(size, np.arange(1, classes) / classes))
    which, error = _class(edges, force), np.abs(force - true)
    half = _half_widths(error, which, len(edges) + 1)
    names = np.unique(group)
    if len(names) > 1:
        ratio = np.empty_like(error)  # of each error to the width that the other groups give
        for name in names:
            of_group = group == name
            others = _half_widths(error[~of_group], which[~of_group], len(edges) + 1)
            # no errors at all are no division by zero
            ratio[of_group] = error[of_group] / np.maximum(others[which[of_group]], 1e-9)
        half = half * _conformal(ratio)
    rms = [_root_mean(sigma[which == k] ** 2) for k in range(len(edges) + 1)]
    return edges, half, np.array(rms)


def _half_widths(error: np.ndarray, which: np.ndarray, classes: int) -> np.ndarray:
    """Return the half width (C, 3) of each class of errors (m, 3), that of all errors where a class has none."""
    members = [which == k for k in range(classes)]
    return np.array([_conformal(error[member] if member.any() else error) for member in members])


def _root_mean(variance: np.ndarray) -> np.ndarray:
    """Return the root of the mean (3,) of variances (m, 3) that are known, 0 where none is."""
    known = np.isfinite(variance)
    total = np.where(known, variance, 0.0).sum(axis=0)
    return np.sqrt(total / np.maximum(known.sum(axis=0), 1))


def _conformal(error: np.ndarray) -> np.ndarray:
    """Return the ceil((m + 1) 0.9)th smallest of errors (m, 3), the largest where there are too few."""
    rank = min(int(np.ceil((len(error) + 1) * COVER)), len(error)) - 1
    return np.sort(error, axis=0)[rank]
