"""Which sites are solved: level by level, until every label of the plan is within the tolerance.

After each level the sites of the plan whose label is not within it ask for the next level's places around them; where
these would be no fewer than such sites, or no level is left, the sites are solved themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gelforge.config import Interpolation
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.lattice import LAST, Index, Lattice, index_of, name_of
from gelforge.interpolation.solved_sites import OWN, SolvedSites


@dataclass(frozen=True)
class Decision:
    """What is known after a level; every name is that of a file among the solved sites."""

    level: int
    solved: tuple[str, ...]  # of this level and those before
    more: tuple[str, ...]  # of the next level; none: every label is within the tolerance or solved itself
    themselves: tuple[str, ...]  # sites of the plan that are solved themselves
    labels: int  # of the plan, a site's depths counted apart, images not
    beyond: int  # of them: beyond the tolerance, those that are solved themselves among them
    largest: float  # interpolation error of a label over the tolerance, before any is solved itself
    where: str  # of the largest

    @property
    def done(self) -> bool:
        return not self.more

    @property
    def words(self) -> str:
        """What a log says."""
        text = f"level {self.level}: {len(self.solved)} solved sites, "
        text += f"{self.beyond} of {self.labels} labels beyond the tolerance"
        text += f", the largest {self.largest:.2f} of it ({self.where})" if self.labels else ""
        if self.more:
            return f"{text}; {len(self.more)} more sites are solved"
        if self.themselves:
            return f"{text}; {len(self.themselves)} sites of the plan, which interpolation does not reach, are solved"
        return f"{text}; done"


def first_level(lattice: Lattice) -> list[str]:
    """Return the names of the sites of the first level of a lattice.

    Parameters
    ----------
    lattice : Lattice
        As `lattice_of` returns it.

    Returns
    -------
    list of str
        As of `name_of`; of mirror images one.
    """
    return [name_of(at) for at in lattice.representatives(lattice.level(0))]


def decide(
    solved: SolvedSites, level: int, planned: Sequence[PlannedCell], tolerance: Interpolation
) -> Decision:
    """Return what is to be solved after a level of the lattice.

    Parameters
    ----------
    solved : SolvedSites
        What is solved so far.
    level : int
        The last level that was solved.
    planned : sequence of PlannedCell
        The plan's sites to be interpolated, of images one.
    tolerance : Interpolation
        Largest error bars of interpolated labels.

    Returns
    -------
    Decision
        Sites of the next level, sites of the plan that are solved themselves, and how many labels are beyond the tolerance.
    """
    lattice, have = solved.lattice, set(solved.sites)
    beyond: list[PlannedCell] = []
    labels, count, largest, where = 0, 0, 0.0, ""
    for cell in planned:
        position = np.array([cell.x_mm, cell.y_mm])
        labels += len(cell.depths_mm)
        if solved.failed_near(position):
            continue  # more sites do not mend it
        ratio = label_ratios(solved.bars_at(position, cell.depths_mm), tolerance)
        count += int((ratio > 1).sum())
        if ratio.max() > 1:
            beyond.append(cell)
        if ratio.max() > largest:
            largest, deepest = float(ratio.max()), cell.depths_mm[int(ratio.argmax())]
            where = f"({cell.x_mm:g}, {cell.y_mm:g}) mm, {deepest:g} mm deep"
    asked = {at for cell in beyond for at in _asked(lattice, have, np.array([cell.x_mm, cell.y_mm]))}
    more = [at for at in lattice.representatives(asked) if at not in have]
    names = tuple(name_of(at) for at in solved.cells)
    if not more or len(more) >= len(beyond):
        return Decision(level, names, (), tuple(cell.name for cell in beyond), labels, count, largest, where)
    return Decision(level, names, tuple(map(name_of, more)), (), labels, count, largest, where)


def _asked(lattice: Lattice, have: set[Index], position: np.ndarray) -> list[Index]:
    """Return the places around a position of the first level that is not all there; none after the last."""
    for number in range(LAST):
        around = lattice.around(position, number)
        if any(at not in have for at in around):
            return around
    return []


def label_ratios(bars: Mapping[str, np.ndarray], tolerance: Interpolation) -> np.ndarray:
    """Return how large (D,) the interpolation error of a site's labels is over the tolerance: that of bins or of the total.

    A share is one of the label's own error bar: root mean squares over components, of bins over those that carry force.
    In newtons it is the root mean square error of a bin; that of the total may be as large as theirs if independent.
    """
    bins, total = bars["bin_interpolation"], bars["total_interpolation"]
    size = np.linalg.norm(bins, axis=-1)
    loaded = size > 0.01 * size.max(axis=1, keepdims=True)
    carries = np.maximum(loaded.sum(axis=1), 1)
    if tolerance.tolerance is not None:
        label_bar, total_bar = (
            np.sqrt(sum(bars[f"{quantity}_{part}"] ** 2 for part in OWN if f"{quantity}_{part}" in bars))
            for quantity in ("bin", "total")
        )
        loaded = np.linalg.norm(label_bar, axis=-1) > 0
        ratios = [
            _rms(bins, loaded) / np.maximum(_rms(label_bar, loaded), 1e-300),
            np.linalg.norm(total, axis=-1) / np.maximum(np.linalg.norm(total_bar, axis=-1), 1e-300),
        ]
        return np.max(ratios, axis=0) / tolerance.tolerance
    of_bins = _rms(bins, loaded)
    of_total = np.linalg.norm(total, axis=-1) / np.sqrt(3 * carries)
    return np.maximum(of_bins, of_total) / tolerance.tolerance_N


def _rms(values: np.ndarray, loaded: np.ndarray) -> np.ndarray:
    """Return the root mean square (D,) of values (D, B, 3) over components and the bins (D, B) that carry force."""
    square = (values**2).mean(axis=-1) * loaded
    return np.sqrt(square.sum(axis=1) / np.maximum(loaded.sum(axis=1), 1))


def known_places(names: Sequence[str]) -> list[Index]:
    """Return the places of the names of solved sites that lie on the lattice."""
    return [at for name in names if (at := index_of(name)) is not None]
