"""Physics with a free form: maps that no single amount describes, weighed as a discrepancy is.

A module is a kernel (unknown.py) whose directions are changes by a cause, a smooth random function with the plausible width
of the catalogue's effect that it generalises. The causes are in `free_forms`, one file each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from gelforge.config import Study
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.context import Context
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.terms.unknown import MODES, Kernel, modes, product

AXES = "xyz"


@dataclass(frozen=True, eq=False, kw_only=True)
class Module(Kernel):
    """A cause with a free form: directions, and the map that its coefficients describe."""

    name: str
    says: str  # the cause, in words that follow "; "
    map: pd.DataFrame  # (G) rows of module.csv: quantity, and what it is a function of
    basis: np.ndarray  # (G, q) the map per unit coefficient
    unit: str
    of_labels: bool  # simulated forces change by it, as a function of place and depth
    where: Callable[[Mapping[str, Any]], str]  # a row of the map, in words
    to_study: Callable[[Study, np.ndarray], Study] | None = None  # with a map (G,) of it
    named: bool = (
        True  # False: another known cause changes the readings in such a way; it is modelled and never named
    )
    replaces: str = ""  # words of the kernel of unknown.py that is this cause without its name

    @property
    def is_cause(self) -> bool:
        return self.named

    def values(self, mean: np.ndarray, covariance: np.ndarray) -> pd.DataFrame:
        """Return the rows of module.csv: the map with columns mean and sigma, of coefficients (q,) and (q, q)."""
        sigma = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", self.basis, covariance, self.basis), 0.0))
        return self.map.assign(unit=self.unit, mean=self.basis @ mean, sigma=sigma)


@dataclass(frozen=True)
class FreeForm:
    """What a file of `free_forms` defines."""

    name: str  # of the file
    # The module, if readings may show it, of the changes of the readings by the derivatives that they show at all
    module: Callable[[Context, Sequence[Candidate]], Module | None]
    derivatives: tuple[Effect, ...] = ()  # solved for it alone: none of these is an answer


def near(row: Mapping[str, Any]) -> str:
    """Return the place of a map's row in words."""
    return f"near ({row['x_mm']:.4g}, {row['y_mm']:.4g}) mm"


def plane_modes(at: pd.DataFrame) -> np.ndarray:
    """Return cosines (n, q) over the plane, of mean square 1 together, at places x_mm, y_mm."""
    x, y = (modes(at[name].to_numpy(float), MODES["place"]) for name in ("x_mm", "y_mm"))
    return product(x, y)


def several_places(table: pd.DataFrame) -> bool:
    """Return whether readings were taken at more than one place."""
    return table[["x_mm", "y_mm"]].drop_duplicates().shape[0] > 1


def sites(table: pd.DataFrame) -> tuple[pd.DataFrame, np.ndarray]:
    """Return the places x_mm, y_mm of the readings, and the number of the first reading at each."""
    first = table.drop_duplicates(["x_mm", "y_mm"])
    return first[["x_mm", "y_mm"]].reset_index(drop=True), first.index.to_numpy()
