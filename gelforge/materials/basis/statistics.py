"""Statistics that the analyses of material tests share: means over samples, the noise of rows, resampled residuals."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy import stats

from gelforge.robust import SIGMA_OF_MEDIAN

T = TypeVar("T")


@dataclass(frozen=True)
class Mean:
    """A mean with its 95 % interval (Student's t) and the scatter of single values."""

    value: float
    interval: tuple[float, float]
    deviation: float
    count: int

    @property
    def standard_error(self) -> float:
        """Return the standard error of the mean."""
        return self.deviation / np.sqrt(self.count)


def mean_of(values) -> Mean:
    """Return the mean of at least two values with its interval."""
    values = np.asarray(values, dtype=float)
    deviation = float(values.std(ddof=1))
    half = stats.t.ppf(0.5 + CONFIDENCE / 2, len(values) - 1) * deviation / np.sqrt(len(values))
    mean = float(values.mean())
    return Mean(mean, (float(mean - half), float(mean + half)), deviation, len(values))


CONFIDENCE = 0.95  # of every interval of a material: the level that a coverage factor of 2 stands for (GUM 2008, 6.3.3)
# Whose scatter gives an interval that says something: Student's t (1908) of two is 12.7 at 95 %, of three 4.3.
LEAST_SAMPLES = 3
# Below which there is no curve: one more than the 4 parameters of a model of two terms (Ogden 1972).
ROWS_OF_CURVE = 5
# Of a loading, to know the scatter of a row: of 8 it is known to 1 / sqrt(14) = 27 % (GUM 2008, E.4.3).
ROWS_OF_SCATTER = 8


def row_noise(values: np.ndarray, least: int = 5) -> float:
    """Return the standard deviation of one row about the line through its neighbours, by a robust scatter.

    The deviation of a row from its neighbours' mean has 3/2 of the variance of a row.

    Parameters
    ----------
    values : numpy.ndarray
        (n,) evenly spaced.
    least : int
        Fewer rows give 0.

    Returns
    -------
    float
        In the unit of the values.
    """
    if len(values) < least:
        return 0.0
    off = values[1:-1] - (values[:-2] + values[2:]) / 2
    return float(SIGMA_OF_MEDIAN * np.median(np.abs(off)) / np.sqrt(1.5))


def channel_step(values: np.ndarray) -> float:
    """Return the smallest change from row to row of a channel so coarse that rows repeat, 0 where none does."""
    changes = np.abs(np.diff(values))
    return float(changes[changes > 0].min(initial=np.inf)) if 0 < (changes == 0).sum() < len(changes) else 0.0


def resampled(model: np.ndarray, residual: np.ndarray, draws: int, rng) -> Iterator[np.ndarray]:
    """Yield a model with resampled blocks of its residuals; neighbours stay together.

    Blocks are n^(1/3) rows long (Kuensch 1989, doi 10.1214/aos/1176347265) and run over the end into the beginning.

    Parameters
    ----------
    model : numpy.ndarray
        (n,).
    residual : numpy.ndarray
        (n,), in the unit of the model.
    draws : int
        Number of resampled models.
    rng : numpy.random.Generator
        Draws the blocks.

    Yields
    ------
    numpy.ndarray
        (n,).
    """
    n = len(model)
    block = max(1, round(n ** (1 / 3)))
    for _ in range(draws):
        starts = rng.integers(0, n, size=-(-n // block))
        drawn = np.concatenate([np.arange(start, start + block) % n for start in starts])[:n]
        yield model + residual[drawn]


def grouped(pairs: Iterable[tuple[Hashable, T]]) -> dict[Hashable, list[T]]:
    """Return the values of each key, in the order of their first appearance.

    Parameters
    ----------
    pairs : iterable of tuple
        Key and value.

    Returns
    -------
    dict
        List of values by key.
    """
    by_key: dict[Hashable, list[T]] = {}
    for key, value in pairs:
        by_key.setdefault(key, []).append(value)
    return by_key


def percentile_interval(values) -> tuple[float, float]:
    """Return the ends of the central 95 % of draws; what is NaN does not count."""
    low, high = np.nanquantile(values, [0.025, 0.975])  # CONFIDENCE in the middle
    return float(low), float(high)
