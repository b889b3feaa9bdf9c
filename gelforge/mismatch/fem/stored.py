"""Derivatives of a site's forces in a file of their own: solved next to the sites, so that a verdict finds them.

Of each place that stands for its mirror images there is one file: base forces and derivatives on the coarser mesh
(mismatch.coarser) at the depths of the plan, in all that the finite elements can be differentiated along: effects of the
catalogue at all points of their grids, uncertain directions of the laws, boxes of the body map.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from gelforge.files import FileError, digest, source_digest
from gelforge.hdf5 import opened
from gelforge.indentation.paths.places import ROUNDING_MM
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.inputs import inputs_digest
from gelforge.indentation.solving.sensitivities import Variation
from gelforge.mechanics.laws.law import PrincipalLaw

FORMAT = "gelforge-sensitivities-1"
REMEDY = "solve it again (`gelforge sensitivities`, or snakemake -R on the file)"


@dataclass(frozen=True)
class Stored:
    """What a file holds. Derivatives are named by the digest of what decides them."""

    depths_mm: np.ndarray  # (D,)
    total: np.ndarray  # (D, 3) [N] base forces
    slopes: Mapping[str, np.ndarray]  # (D, 3) [N/unit]
    reasons: Mapping[str, str]  # of those that could not be had

    def base_at(self, depths: np.ndarray) -> np.ndarray | None:
        """Return base forces (n, 3) at depths (n,) [mm] if they are all of those solved."""
        if not len(self.depths_mm):
            return None
        away = np.abs(self.depths_mm[:, None] - depths)
        return self.total[away.argmin(axis=0)] if (away.min(axis=0) < ROUNDING_MM).all() else None

    def slopes_at(self, names: Iterable[str], depths: np.ndarray) -> dict[str, np.ndarray]:
        """Return derivatives (n, 3) at depths (n,) [mm], monotone cubic between those solved; those that it holds."""
        held = [name for name in names if name in self.slopes]
        if not held or depths.max() > self.depths_mm[-1] + ROUNDING_MM:
            return {}
        knots = np.concatenate([[0.0], self.depths_mm])
        values = np.stack([np.vstack([np.zeros(3), self.slopes[name]]) for name in held], axis=1)
        values_at = PchipInterpolator(knots, values, axis=0)(np.clip(depths, 0.0, knots[-1]))
        return dict(zip(held, np.moveaxis(values_at, 1, 0)))


def place_digest(study, laws: Mapping[str, PrincipalLaw], x_mm: float, y_mm: float) -> str:
    """Return the digest of all that decides what a coarser study says of a place, its depths aside."""
    anywhere = PlannedCell("", x_mm, y_mm, (1.0,))
    return digest([inputs_digest(study, dict(laws), anywhere), source_digest("mismatch/fem/solutions.py")])


def slope_digest(place: str, variation: Variation) -> str:
    """Return the digest of all that decides a derivative at a place."""
    return digest(["along", place, variation.inputs])


def read_stored(path: Path, place: str) -> Stored | None:
    """Return what a file holds of a place; None where it is missing, damaged or of other inputs: they cost time only."""
    try:
        with opened(path, FORMAT, REMEDY) as file:
            if file.attrs["place"] != place:
                return None
            depths, total, slopes = (file[n][()] for n in ("depth_mm", "total_force_N", "slope_total"))
            known, missing = (json.loads(file[n].asstr()[()]) for n in ("parameters", "missing"))
    except FileError:
        return None
    slopes = dict(zip([one["digest"] for one in known], slopes))
    return Stored(depths, total, slopes, {one["digest"]: one["reason"] for one in missing})
