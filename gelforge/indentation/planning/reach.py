"""How deep the indenter really goes into the soft layers, and how thick they are there. Known before anything is solved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gelforge.config import SOFT_SHARE, ConfigError, Effects, Sensor
from gelforge.indentation.effects.kinematics import path_over_flat_top
from gelforge.indentation.effects.surfaces import surface_rises
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.mechanics.indenters.shapes import DOWN, Turned, rotation_of
from gelforge.mechanics.indenters.shapes import Indenter as Shape


@dataclass(frozen=True)
class Reach:
    """The deepest pose of an indentation: its lowest point below the undeformed top over its centre, and the soft height."""

    depth_mm: float
    height_mm: float

    @property
    def share(self) -> float:
        """The depth over the soft height [-]."""
        return self.depth_mm / self.height_mm


def planned_reach(sensor: Sensor, effects: Effects, shape: Shape, trajectory: Trajectory) -> Reach:
    """Return the reach of an indentation without a mesh: of a block as it really is, of other shapes at their highest point.

    shape is the real indenter (indenter_shapes.real_indenter). What frame and base yield only makes the press less deep.
    """
    if sensor.shape.kind != "block":
        deepest = max(trajectory.depths_mm) + effects.kinematics.contact_zero_mm
        return Reach(deepest, sensor.height_mm)
    _, centres, shape = path_over_flat_top(sensor, effects, shape, trajectory)
    return reach_of(shape, centres, block_tops(sensor, effects, centres), soft_base(sensor, effects))


def reach_of(shape: Shape, centres: np.ndarray, tops: np.ndarray, base: float) -> Reach:
    """Return the reach of an indenter at centres (D, 3 or 6) over tops (D,) and the soft layers' base [mm]."""
    depths = tops - (centres[:, 2] - _supports(shape, centres))
    deepest = int(np.argmax(depths / (tops - base)))
    return Reach(float(depths[deepest]), float((tops - base)[deepest]))


def block_tops(sensor: Sensor, effects: Effects, centres: np.ndarray) -> np.ndarray:
    """Return the height (D,) [mm] of a block's undeformed top over centres (D, 3 or 6)."""
    return surface_rises(sensor, effects, centres[:, :2])[..., -1]


def soft_base(sensor: Sensor, effects: Effects) -> float:
    """Return the height [mm] of the lower face of the soft layers: thicker layers reach further down."""
    held = sensor.shape.base_mm
    if held is not None:
        return held
    return -sensor.height_mm - sum(real.change_mm for real in effects.geometry.thickness.values())


def check_reach(reach: Reach, commanded_mm: float, where: str) -> None:
    """Refuse an indentation that would pierce the layers. Raises ConfigError with the depth found and the limit."""
    if reach.share <= SOFT_SHARE - 1e-9:
        return
    commanded = remedy = ""
    if abs(reach.depth_mm - commanded_mm) > 1e-6:
        commanded = f" (commanded: {commanded_mm:g} mm)"
        remedy = ", or correct contact_zero_mm, tilt_deg or thickness of mechanics.effects"
    raise ConfigError(
        f"{where}: depth {reach.depth_mm:.4g} mm{commanded} would pierce the soft layers: it is beyond {SOFT_SHARE} of their"
        f" height {round(reach.height_mm, 3)} mm there ({SOFT_SHARE * reach.height_mm:.3g} mm); press less deep{remedy}"
    )


def _supports(shape: Shape, centres: np.ndarray) -> np.ndarray:
    """Return how far (D,) [mm] the indenter reaches below its centres, turned where they have rotation vectors."""
    if centres.shape[1] == 3:
        return np.full(len(centres), shape.support(DOWN))
    return np.array([Turned(shape, rotation_of(turn)).support(DOWN) for turn in centres[:, 3:]])
