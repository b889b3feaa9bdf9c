"""Positions of a stage or robot in the sensor's frame, and what positions outside the sensor look like."""

from __future__ import annotations

import numpy as np

from gelforge.config import StageToSensor

# Nobody presses nearer to the very corner; 32 mm in metres are 0.032 mm from it (tests/indentation/test_recorded_plan.py).
CORNER_MM = 0.1


def stage_to_sensor(xy: np.ndarray, stage: StageToSensor) -> np.ndarray:
    """Return positions of the stage in the sensor frame: R(rotation) H x + origin, where H flips y of a left-handed stage.

    Parameters
    ----------
    xy : numpy.ndarray
        (N, 2) [mm] in the frame of the stage.
    stage : StageToSensor
        Origin [mm], rotation [deg] and handedness.

    Returns
    -------
    numpy.ndarray
        (N, 2) [mm] in the sensor frame.
    """
    return xy @ axes_of_stage(stage).T + stage.origin_mm


def axes_of_stage(stage: StageToSensor) -> np.ndarray:
    """Return the directions of the stage's axes in the sensor frame.

    Parameters
    ----------
    stage : StageToSensor
        Its rotation and handedness.

    Returns
    -------
    numpy.ndarray
        (2, 2), one unit vector per column.
    """
    c, s = np.cos(np.deg2rad(stage.rotation_deg)), np.sin(np.deg2rad(stage.rotation_deg))
    H = np.diag([1.0, -1.0 if stage.handedness == "left" else 1.0])
    return np.array([[c, -s], [s, c]]) @ H


def first_outside(xy: np.ndarray, width_mm: tuple[float, float]) -> tuple[int, str] | None:
    """Return the first position that cannot be right, and why.

    Parameters
    ----------
    xy : numpy.ndarray
        (N, 2) [mm] of a session in the sensor frame.
    width_mm : (float, float)
        Of the sensor along x and y.

    Returns
    -------
    (int, str) or None
        Row and words: outside the sensor, or all in its very corner. None where all may be right.
    """
    width = np.array(width_mm)
    outside = ((xy < 0) | (xy > width)).any(axis=1)
    corner = (xy < CORNER_MM).all(axis=1)
    wrong = outside if outside.any() else corner
    if not wrong.any():
        return None
    row = int(wrong.argmax())
    x, y = xy[row]
    stated = f"position ({x:.6g}, {y:.6g}) mm in the sensor frame, the sensor is {width[0]} x {width[1]} mm;"
    if not outside.any():
        return row, f"{stated} correct x_mm, y_mm or stage_to_sensor, is it in metres?"
    span, sides = np.sort(np.ptp(xy, axis=0)), np.sort(width)
    if outside.all() and (span <= sides).all() and not _would_fit(xy / 1e3, width):
        return row, (
            f"{stated} all positions lie outside, but would fit: are they in the robot's frame? Read the robot's position"
            " over the sensor's corner and set stage_to_sensor: origin_mm, rotation_deg and handedness (of session.yaml, or"
            " under `session` of an import's mapping; docs/importing.md has the formula)"
        )
    return row, f"{stated} correct x_mm, y_mm or stage_to_sensor, is it in micrometres?"


def _would_fit(xy: np.ndarray, width: np.ndarray) -> bool:
    """Return whether positions lie on the sensor and not all within a millimetre of its corner."""
    return bool(((xy >= 0) & (xy <= width)).all() and (xy > 1.0).any())
