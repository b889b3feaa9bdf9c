"""The poses that one indenter visits at one position."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.mechanics.indenters.shapes import DOWN


@dataclass(frozen=True)
class Trajectory:
    """The poses that one indenter visits in turn at one position: depths [mm] with their phases, shears and turns."""

    x_mm: float
    y_mm: float
    depths_mm: tuple[float, ...]
    phases: tuple[str, ...]  # of plan.PHASES
    shears_mm: tuple[tuple[float, float], ...] = ()  # none: straight down and up
    tilts_deg: tuple[tuple[float, float], ...] = ()  # about x and y, through the indenter's centre
    approach: str = "vertical"  # or "normal": along the undeformed surface's normal at the position
    times_s: tuple[float, ...] = ()  # when each pose is reached, from the first touch on; none: no matter
    twists_deg: tuple[float, ...] = ()  # about z, through the indenter's centre

    @classmethod
    def of(cls, planned: PlannedCell, approach: str = "vertical") -> Trajectory:
        phases = planned.phases or ("load",) * len(planned.depths_mm)
        poses = planned.depths_mm, phases, planned.shears_mm, planned.tilts_deg
        return cls(planned.x_mm, planned.y_mm, *poses, approach, twists_deg=planned.twists_deg)

    def changed(self, **fields) -> Trajectory:
        """Return the trajectory with other fields."""
        return replace(self, **fields)

    @property
    def is_path(self) -> bool:
        """Whether it does more than press: then it is one indentation, also where history makes each depth one itself."""
        moves = self.shears_mm or self.tilts_deg or self.twists_deg
        return bool(moves) or any(phase != "load" for phase in self.phases)

    @property
    def shears(self) -> np.ndarray:
        """Return shears (D, 2) [mm]."""
        return np.array(self.shears_mm or np.zeros((len(self.depths_mm), 2)))

    @property
    def tilts(self) -> np.ndarray:
        """Return tilts (D, 2) [deg]."""
        return np.array(self.tilts_deg or np.zeros((len(self.depths_mm), 2)))

    @property
    def twists(self) -> np.ndarray:
        """Return twists (D,) [deg]."""
        return np.array(self.twists_deg or np.zeros(len(self.depths_mm)))

    def centres(
        self, start: np.ndarray, along: np.ndarray = DOWN, lead: float = 0.0, frame: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the indenter's centres (D, 3) [mm], or (D, 6) with rotation vectors [rad], from that of the first touch.

        Depths are counted along a unit vector (3,), shears along x and y, of the machine where frame (3, 3) turns its axes
        to the sensor's. lead [mm]: deeper than commanded by this much.
        """
        shears = np.pad(self.shears, ((0, 0), (0, 1)))
        shears = shears if frame is None else shears @ frame.T
        centres = start + shears + np.outer(np.array(self.depths_mm) + lead, along)
        turns = np.column_stack([self.tilts, self.twists])
        return np.column_stack([centres, np.radians(turns)]) if turns.any() else centres
