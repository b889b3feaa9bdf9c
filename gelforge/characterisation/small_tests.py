"""Small tests: friction on a tilted plane, thickness from sections, the gain between two load cells."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from gelforge.characterisation.common_form import ForcePair
from gelforge.csv_table import TableError, read_csv

TILT_DEG = (0.5, 80.0)
THICKNESS_MM = (0.02, 15.0)
LEAST_TRIALS = 3
LEAST_ROWS_OF_PRESS = 5


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
    half = stats.t.ppf(0.975, len(values) - 1) * deviation / np.sqrt(len(values))
    mean = float(values.mean())
    return Mean(mean, (float(mean - half), float(mean + half)), deviation, len(values))


def static_friction(path: str | Path) -> Mean:
    """Return mu0 = tan(tilt at the onset of sliding), averaged over the trials of a friction.csv (trial, tilt_deg)."""
    path = Path(path)
    table = read_csv(path, texts=("trial",), numbers=("tilt_deg",))
    _within(path, table["tilt_deg"], TILT_DEG, "the angle to the horizontal in degrees is expected")
    _enough(path, len(table), "trials")
    return mean_of(np.tan(np.radians(table["tilt_deg"])))


def sheet_thickness(path: str | Path) -> dict[str, Mean]:
    """Return each sample's thickness h0 [mm] from a thickness.csv (sample, section, thickness_mm).

    A stress F / (w0 h0) has the relative error of this mean, common to all rows of the sample.
    """
    path = Path(path)
    table = read_csv(path, texts=("sample", "section"), numbers=("thickness_mm",))
    _within(path, table["thickness_mm"], THICKNESS_MM, "check the unit")
    for sample, rows in table.groupby("sample", sort=False):
        _enough(path, len(rows), f"sections of sample {sample}")
    return {sample: mean_of(rows["thickness_mm"]) for sample, rows in table.groupby("sample", sort=False)}


def gain_mismatch(pair: ForcePair) -> Mean:
    """Return force_2 / force_1 - 1 of two load cells that carry the same force, with its interval.

    Presses at one place share how the force splits there and are no independent readings: where places are named,
    each counts once.
    """
    gains = gain_by_place(pair)
    if len(gains) < LEAST_TRIALS:
        raise ValueError(
            f"{pair.source}: {sum(map(len, gains.values()))} presses at {len(gains)} places; {LEAST_TRIALS} independent"
            " ones at least give the scatter of the gain"
        )
    return mean_of([np.mean(at_place) for at_place in gains.values()])


def gain_by_place(pair: ForcePair, loaded_share: float = 0.05) -> dict[str, list[float]]:
    """Return force_2 / force_1 - 1 of each press by place; where no places are named each press is its own.

    A press is the rows above loaded_share of the largest force; its gain is the slope of the total least squares
    line through the origin, both forces being measured.
    """
    one, two = pair.force_1_N - _rest(pair.force_1_N), pair.force_2_N - _rest(pair.force_2_N)
    mean = (one + two) / 2
    loaded = mean > loaded_share * np.max(mean)
    edges = np.flatnonzero(np.diff(np.r_[False, loaded, False].astype(int)))
    gains: dict[str, list[float]] = {}
    for a, b in zip(edges[::2], edges[1::2]):
        if b - a >= LEAST_ROWS_OF_PRESS:
            place = str(a) if pair.position is None else str(pair.position[a])
            gains.setdefault(place, []).append(_slope(one[a:b], two[a:b]) - 1)
    return gains


def _rest(force) -> float:
    """Return the reading without load: the median of the lowest tenth."""
    return float(np.median(np.sort(force)[: max(len(force) // 10, 1)]))


def _slope(x, y) -> float:
    """Return the slope of the line through the origin with the least squared distance to the points."""
    xx, yy, xy = x @ x, y @ y, x @ y
    return float((yy - xx + np.sqrt((yy - xx) ** 2 + 4 * xy**2)) / (2 * xy))


def _within(path: Path, column, limits, remedy: str) -> None:
    wrong = (column < limits[0]) | (column > limits[1])
    if wrong.any():
        line = column.index[wrong][0]
        raise TableError(
            f"{path}, row {line}: {column.name} is {column[line]:g}; between {limits[0]:g} and {limits[1]:g} is expected,"
            f" {remedy}"
        )


def _enough(path: Path, count: int, what: str) -> None:
    if count < LEAST_TRIALS:
        raise TableError(
            f"{path}: {count} {what}; {LEAST_TRIALS} at least are needed for an uncertainty, add some"
        )
