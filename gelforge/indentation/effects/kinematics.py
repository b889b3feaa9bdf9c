"""Where the indenter really goes, and how much machine and base yield."""

from __future__ import annotations

import numpy as np

from gelforge.config import Effects, Sensor
from gelforge.indentation.effects.surfaces import top_slope
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.mechanics.indenters.shapes import DOWN, Sphere, Turned, rotation_about_axes
from gelforge.mechanics.indenters.shapes import Indenter as Shape


def real_place(sensor: Sensor, effects: Effects, x: float, y: float) -> tuple[float, float]:
    """Return where the indenter really is: scaled and turned about the sensor's middle, then shifted.

    Parameters
    ----------
    sensor : Sensor
        Its widths.
    effects : Effects
        Their `kinematics`: grid scale [-], yaw [deg] and misregistration [mm].
    x, y : float
        Where it was sent [mm].

    Returns
    -------
    tuple of float
        x and y [mm].
    """
    k = effects.kinematics
    if not (k.grid_scale or k.yaw_deg or any(k.misregistration_mm)):
        return x, y
    middle = np.array([sensor.width_x_mm, sensor.width_y_mm]) / 2
    turned = rotation_about_axes([0.0, 0.0, k.yaw_deg])[:2, :2] @ (np.array([x, y]) - middle)
    place = middle + (1 + k.grid_scale) * turned + k.misregistration_mm
    return float(place[0]), float(place[1])


def machine_frame(effects: Effects) -> np.ndarray:
    """Return the rotation from the machine's axes to the sensor's, which stands tilted in the machine.

    Parameters
    ----------
    effects : Effects
        Their `kinematics.tilt_deg`.

    Returns
    -------
    numpy.ndarray
        (3, 3).
    """
    return rotation_about_axes([*effects.kinematics.tilt_deg, 0.0]).T


def plane_touch(
    sensor: Sensor, effects: Effects, shape: Shape, x: float, y: float
) -> tuple[np.ndarray, float]:
    """Return the centre (3,) [mm] at which the indenter first touches the flat top, and how much deeper it goes from there.

    The sensor stands tilted about its top's middle and its top may slope with the layers' thickness. The depth counts from
    the touch of this indentation, or (`zero_by: session`) from that at the middle of the sensor: where the top is farther
    away than there, the indenter then goes less deep than commanded [mm].
    """
    middle = np.array([sensor.width_x_mm / 2, sensor.width_y_mm / 2, 0.0])
    frame, slope = machine_frame(effects), top_slope(effects)
    up = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1 + slope @ slope)
    along = frame @ DOWN
    away = frame @ (np.array([x, y, 0.0]) - middle)
    turned = shape if np.array_equal(frame, np.eye(3)) else Turned(shape, frame)
    # The centre is at middle + away + t along; it touches where its distance from the top is the support towards it.
    reach = turned.support(-up)
    t_touch, t_middle = ((a @ up - reach) / -(along @ up) for a in (away, np.zeros(3)))
    start = middle + away + t_touch * along
    lead = t_middle - t_touch if effects.kinematics.zero_by == "session" else 0.0
    return start, lead


def path_over_flat_top(
    sensor: Sensor, effects: Effects, shape: Shape, trajectory: Trajectory
) -> tuple[np.ndarray, np.ndarray, Shape]:
    """Return the indenter's centre (3,) [mm] at the first touch of a block's top, its path, its shape in the sensor's frame.

    The indenter comes down. The path is Trajectory.centres, deeper than commanded by what the effects say.
    """
    place = real_place(sensor, effects, trajectory.x_mm, trajectory.y_mm)
    frame, along, lead = None, DOWN, 0.0
    if touches_a_slope(effects):
        start, lead = plane_touch(sensor, effects, shape, *place)
    else:
        start = shape.start(*place)
    if any(effects.kinematics.tilt_deg):
        frame = machine_frame(effects)
        along, shape = frame @ DOWN, in_machine(shape, frame)
    lead += effects.kinematics.contact_zero_mm
    return start, trajectory.centres(start, along, lead, frame), shape


def in_machine(shape: Shape, frame: np.ndarray) -> Shape:
    """Return an indenter that stands upright in the machine, seen from the sensor."""
    return shape if isinstance(shape, Sphere) else Turned(shape, frame)


def yielding(sensor: Sensor, effects: Effects, x: float, y: float) -> np.ndarray | None:
    """Return what frame and base plate yield (3,) [mm/N], along the path, at (x, y) [mm]; None where nothing does.

    The plate is held at its edges: its first mode sin sin, driven and read at the place of the force.
    """
    k = effects.kinematics
    mode = np.sin(np.pi * x / sensor.width_x_mm) * np.sin(np.pi * y / sensor.width_y_mm)
    c = k.frame_compliance_mm_per_N + k.base_bending_mm_per_N * mode**2
    return c * (machine_frame(effects) @ DOWN) if c else None


def touches_a_slope(effects: Effects) -> bool:
    """Whether a flat top stands at an angle to the indenter's path: it is tilted, or its layers' thickness is graded."""
    return bool(any(effects.kinematics.tilt_deg) or top_slope(effects).any())
