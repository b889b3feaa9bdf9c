"""One position of a plan, with its depths or its path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from gelforge.indentation.paths.places import POSITION_MATCH_MM


@final  # a path to be solved is a planned site or a trajectory, never both
@dataclass(frozen=True)
class PlannedCell:
    """One position [mm] in the sensor's frame with its depths [mm]: increasing, or a path of several phases.

    A path may also shear, tilt and twist the indenter: then every depth has its displacement along x and y from the position
    and its turns about the sensor's x, y and z axes.
    """

    name: str
    x_mm: float
    y_mm: float
    depths_mm: tuple[float, ...]
    source: str | None = None  # the site that this one mirrors
    symmetry: str | None = None  # the element of D4 that carries the source here
    phases: tuple[str, ...] = ()  # one of PHASES per depth; none: all "load"
    shears_mm: tuple[tuple[float, float], ...] = ()
    tilts_deg: tuple[tuple[float, float], ...] = ()
    twists_deg: tuple[float, ...] = ()
    # Digest of what decides the label of a site that is not solved, as lattice.lattice_digest
    between: str = ""
    # Recorded positions within this are at the site, see planning.tolerance
    within_mm: float = POSITION_MATCH_MM

    @property
    def solved(self) -> bool:
        """Whether the site is a finite-element solution of its own."""
        return self.source is None and not self.between

    @property
    def deepest_mm(self) -> float:
        return max(self.depths_mm)

    @property
    def follows_a_path(self) -> bool:
        return bool(self.phases)
