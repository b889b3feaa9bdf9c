"""Friction on a tilted plane, thickness from sections, the gain between two load cells: means over trials."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gelforge.csv_table import TableError, read_csv
from gelforge.materials.basis.common_form import ForcePair
from gelforge.materials.basis.statistics import LEAST_SAMPLES, Mean, grouped, mean_of

FRICTION, THICKNESS = "friction.csv", "thickness.csv"  # files of a folder
# Radians end at pi / 2 = 1.571, and 0.7 is refused (tests/materials/test_small_tests.py); a friction of 0.028 is no
# elastomer's.
TILT_DEG = (1.6, 80.0)
# A sheet of 20 um in um, and one of 15 mm in m, fall out; 500 and 0.0005 are refused (test_reading_material_tests.py).
THICKNESS_MM = (0.02, 15.0)
LEAST_RISE = 0.5  # of the largest force of an indentation


def static_friction(path: str | Path) -> Mean:
    """Return mu0 = tan(tilt at the onset of sliding), averaged over the trials of a friction.csv (trial, tilt_deg)."""
    path = Path(path)
    table = read_csv(path, texts=("trial",), numbers=("tilt_deg",))
    _once(path, table, ["trial"])
    _within(path, table["tilt_deg"], TILT_DEG, "the angle to the horizontal in degrees is expected")
    _enough(path, len(table), "trials")
    return mean_of(np.tan(np.radians(table["tilt_deg"])))


def sheet_thickness(path: str | Path) -> dict[str, Mean]:
    """Return each sample's thickness h0 [mm] from a thickness.csv (sample, section, thickness_mm).

    A stress F / (w0 h0) has the relative error of this mean, common to all rows of the sample.
    """
    path = Path(path)
    table = read_csv(path, texts=("sample", "section"), numbers=("thickness_mm",))
    _once(path, table, ["sample", "section"])
    _within(path, table["thickness_mm"], THICKNESS_MM, "check the unit")
    for sample, rows in table.groupby("sample", sort=False):
        _enough(path, len(rows), f"sections of sample {sample}")
    return {sample: mean_of(rows["thickness_mm"]) for sample, rows in table.groupby("sample", sort=False)}


@dataclass(frozen=True)
class PressedPair:
    """One press between two load cells: force_2 = (1 + gain) force_1 + offset while it lasts."""

    place: str
    gain: float
    offset_N: float  # 0 at rest: what is left comes with the load (friction, a force that bypasses)
    ratio: float  # force_2 / force_1 - 1 at the largest force: gain and offset together
    largest_N: float


def gain_mismatch(pair: ForcePair) -> Mean:
    """Return the gain of the second of two load cells that carry the same force, less 1, with its interval.

    Indentations at one place share how the force splits there and are no independent readings: where places are named,
    each counts once. All indentations in one regression would weigh places by their rows, and the line of one force over
    the other would differ from the converse, as the scatter is that between places and in both.
    """
    gains = grouped((press.place, press.gain) for press in pressed_pairs(pair))
    if len(gains) < LEAST_SAMPLES:
        raise ValueError(
            f"{pair.source}: {sum(map(len, gains.values()))} indentations at {len(gains)} places; {LEAST_SAMPLES}"
            " independent ones at least give the scatter of the gain"
        )
    return mean_of([np.mean(at_place) for at_place in gains.values()])


def pressed_pairs(pair: ForcePair, loaded_share: float = 0.05) -> list[PressedPair]:
    """Return the indentations of a pair; where no places are named each is a place of its own.

    An indentation is the rows above loaded_share of the largest force; its line is that of total least squares, both forces
    being measured. The line is not forced through the origin: an offset that comes with the load is no gain.
    """
    one, two = from_rest(pair)
    presses = []
    for place, rows in pressed_rows(pair, loaded_share):
        x, y, mean = one[rows], two[rows], (one[rows] + two[rows]) / 2
        slope, top = _slope(x - x.mean(), y - y.mean()), int(np.argmax(mean))
        offset, largest = float(y.mean() - slope * x.mean()), float(mean.max())
        presses.append(PressedPair(place, slope - 1, offset, float(y[top] / x[top] - 1), largest))
    return presses


def pressed_rows(pair: ForcePair, loaded_share: float = 0.05) -> list[tuple[str, slice]]:
    """Return place and rows of each indentation of a pair.

    Those that hardly rise are left out: their slope is noise.

    Parameters
    ----------
    pair : ForcePair
        Forces [N] at n instants.
    loaded_share : float
        Rows above this share of the largest force belong to an indentation [-].

    Returns
    -------
    list of (str, slice)
        In their order in time. The place is the position's name, without names the first row.
    """
    (one, two), presses = from_rest(pair), []
    mean = (one + two) / 2
    edges = np.flatnonzero(np.diff(np.r_[False, mean > loaded_share * np.max(mean), False].astype(int)))
    for a, b in zip(edges[::2].tolist(), edges[1::2].tolist()):
        if b - a >= 5 and np.ptp(mean[a:b]) >= LEAST_RISE * mean[a:b].max():
            presses.append((str(a if pair.position is None else pair.position[a]), slice(a, b)))
    return presses


def from_rest(pair: ForcePair) -> tuple[np.ndarray, np.ndarray]:
    """Return both forces (n,) less their readings without load.

    Parameters
    ----------
    pair : ForcePair
        n instants.

    Returns
    -------
    tuple of numpy.ndarray
        (n,) each [N].
    """
    return pair.force_1_N - _rest(pair.force_1_N), pair.force_2_N - _rest(pair.force_2_N)


def _rest(force) -> float:
    """Return the reading without load: the median of the lowest tenth."""
    return float(np.median(np.sort(force)[: max(len(force) // 10, 1)]))


def _slope(x, y) -> float:
    """Return the slope of the line with the least squared distance to the points (n,) about their mean."""
    xx, yy, xy = x @ x, y @ y, x @ y
    return float((yy - xx + np.sqrt((yy - xx) ** 2 + 4 * xy**2)) / (2 * xy))


def _once(path: Path, table, names: list[str]) -> None:
    """Refuse rows that stand twice: each would count as a measurement of its own."""
    again = table.duplicated(names)
    if again.any():
        line = table.index[int(np.argmax(again))]
        said = ", ".join(f"{name} {table.at[line, name]}" for name in names)
        raise TableError(
            f"{path}, row {line}: {said} stands twice; give each its own number or remove the row"
        )


def _within(path: Path, column, limits, remedy: str) -> None:
    wrong = (column < limits[0]) | (column > limits[1])
    if wrong.any():
        line = column.index[wrong][0]
        raise TableError(
            f"{path}, row {line}: {column.name} is {column[line]:g}; between {limits[0]:g} and {limits[1]:g} is expected,"
            f" {remedy}"
        )


def _enough(path: Path, count: int, what: str) -> None:
    if count < LEAST_SAMPLES:
        raise TableError(
            f"{path}: {count} {what}; {LEAST_SAMPLES} at least are needed for an uncertainty, add some"
        )
