"""One state of a press of a simulated sensor, wherever it comes from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gelforge.config import Sensor
from gelforge.interpolation.nodal_forces import NodalForces

Motion = Callable[[np.ndarray], np.ndarray]  # particles (P, 3) [mm] -> displacement (P, 3) [mm]


@dataclass(frozen=True)
class DrawnPress:
    """Where a sensor is pressed, the forces at its surface nodes, and how its particles move."""

    place: np.ndarray  # (2,) [mm]
    depth_mm: float
    phase: str
    forces: NodalForces  # of one state, about the place
    moved: Motion

    @property
    def total_N(self) -> np.ndarray:
        """Return the total force (3,)."""
        both = self.forces.force_N[0].sum(axis=0)
        return both[:3] + both[3:]

    def bins(self, sensor: Sensor) -> np.ndarray:
        """Return the force of each bin (B, 3) [N]."""
        forces = self.forces.binned(self.place, sensor)[0].reshape(-1, 6)
        return forces[:, :3] + forces[:, 3:]


def merged(parts: Sequence[tuple[float, NodalForces]]) -> NodalForces:
    """Return the sum of nodal forces of one state each, times factors; nodes without force are left out."""
    loaded = [(factor, forces, forces.force_N[0].any(axis=1)) for factor, forces in parts]
    return NodalForces(
        np.concatenate([forces.offset_mm[on] for _, forces, on in loaded]),
        np.concatenate([forces.half_mm[on] for _, forces, on in loaded]),
        np.concatenate([factor * forces.force_N[0, on] for factor, forces, on in loaded])[None],
    )
