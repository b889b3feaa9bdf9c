"""What an effect may look at: the base study, the readings, and the base forces as curves over depth at every site."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator, PPoly

from gelforge.config import Study
from gelforge.mismatch.readings.observations import Observations


@dataclass(frozen=True)
class Curves:
    """A quantity (3,) of the base over depth, loading, at every site: 0 at depth 0, monotone cubic between solved depths."""

    depths: tuple[np.ndarray, ...]  # per site, (D,) increasing [mm]
    values: tuple[np.ndarray, ...]  # per site, (D, 3)

    def at(self, site: int, depth: np.ndarray, slope: bool = False) -> np.ndarray:
        """Return the quantity (..., 3) at depths [mm], 0 above the surface, or its slope per mm."""
        depth = np.asarray(depth, dtype=float)
        found = self._curve(site, slope)(np.maximum(depth, 0.0))
        return np.where((depth > 0)[..., None], found, 0.0)

    def _curve(self, site: int, slope: bool) -> PPoly:
        """Return the polynomials of a site, built once: that takes ten times as long as reading them."""
        if (site, slope) not in self._built:
            knots = np.concatenate([[0.0], self.depths[site]])
            values = np.vstack([np.zeros(3), self.values[site]])
            curve = PchipInterpolator(knots, values, axis=0, extrapolate=True)
            self._built[site, slope] = curve.derivative() if slope else curve
        return self._built[site, slope]

    @cached_property
    def _built(self) -> dict[tuple[int, bool], PPoly]:
        return {}


@dataclass(frozen=True)
class Context:
    """The base beside the readings.

    derivatives: by "effect" or "effect.parameter", d force / d amount (N per unit) of effects that the solver knows.
    """

    study: Study
    observations: Observations
    force: np.ndarray  # (R, 3) [N] base forces at the readings
    curves: Curves  # base forces
    derivatives: Mapping[str, Curves]  # during loading
    at_readings: Mapping[str, np.ndarray] = field(default_factory=dict)  # (R, 3) the same, unloading included

    @classmethod
    def before_readings(cls, study: Study) -> Context:
        """Return the context of a study in which nothing is recorded yet."""
        return cls(study, Observations.none(), np.zeros((0, 3)), Curves((), ()), {})

    def derivative(self, name: str) -> np.ndarray:
        """Return d force / d amount (R, 3) at the readings; as during loading where the unloading is not known."""
        if name in self.at_readings:
            return self.at_readings[name]
        return self.on_readings(self.derivatives[name])

    def with_derivative(self, name: str) -> Context:
        """Return the context in which all derivatives but one are zero."""
        curves = {
            key: one if key == name else replace(one, values=tuple(0.0 * v for v in one.values))
            for key, one in self.derivatives.items()
        }
        at_readings = {key: v if key == name else 0.0 * v for key, v in self.at_readings.items()}
        return replace(self, derivatives=curves, at_readings=at_readings)

    def chosen(self, rows: np.ndarray) -> Context:
        """Return the context of some readings (R,) bool."""
        known = {name: values[rows] for name, values in self.at_readings.items()}
        part = self.observations.chosen(rows)
        return replace(self, observations=part, force=self.force[rows], at_readings=known)

    def slope(self) -> np.ndarray:
        """Return d force / d depth (R, 3) [N/mm] at the readings, as during loading curve."""
        return self.on_readings(self.curves, slope=True)

    def on_readings(self, curves: Curves, slope: bool = False) -> np.ndarray:
        """Return curves (R, 3) at the site and depth of each reading."""
        table = self.observations.table
        found = np.zeros((len(table), 3))
        for site, rows in table.groupby("site").indices.items():
            found[rows] = curves.at(site, table["depth_mm"].to_numpy()[rows], slope)
        return found
