"""Hidden effects of the machine: where it presses, how it yields, and what its force sensor shows."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

# --- kinematics -----------------------------------------------------------------------------------------------------------


def zero(world, size, drawn):
    world.depths.append(lambda rows, xy: 0.1 * size * drawn["sign"] * np.ones(len(rows)))


def tilt(world, size, drawn):
    """The sensor's body is turned; the ball comes down along the machine's axis and meets it elsewhere and at another depth.

    Forces are read in the tilted sensor's axes. Turns about x and y [deg]: drawn x, y.
    """
    angle = np.deg2rad(size) * np.array([drawn["x"], drawn["y"]])
    turn = expm(
        np.array([[0, 0, angle[1]], [0, 0, -angle[0]], [-angle[1], angle[0], 0]])
    )  # sensor to machine
    ball = world.library.sensor.plain.radius_mm

    def centre(rows, xy):
        """Return the ball's centre (R, 3) in the sensor's axes; depth 0 is where it touches the middle."""
        down = np.maximum(rows["depth_mm"].to_numpy(), 0.0)
        return np.column_stack([xy, ball / turn[2, 2] - down]) @ turn

    world.places.append(lambda rows, xy: centre(rows, xy)[:, :2] - ball * turn[2, :2] / turn[2, 2])
    sent = lambda rows: rows[["x_mm", "y_mm"]].to_numpy()  # noqa: E731
    world.depths.append(
        lambda rows, xy: ball - centre(rows, sent(rows))[:, 2] - np.maximum(rows["depth_mm"], 0.0)
    )


def wedge(world, size, drawn):
    """The gel grows thicker across the sensor: each place presses its own thickness, and its sloping top is nearer.

    To first order in the slope: the solved changes of an even layer, at the local thickness.
    """
    slope = 0.02 * size * np.array([drawn["x"], drawn["y"]])
    library = world.library

    def change(xy, depth):
        at = np.log1p(xy @ slope / library.sensor.plain.gel_mm)
        (r1, h1), (r2, h2) = (library.changes[n].at(xy, depth) for n in ("thicker", "thinner"))
        one, other = np.log(1.1), np.log(0.9)
        a = at * (at - other) / (one * (one - other))
        b = at * (at - one) / (other * (other - one))
        return a * r1 + b * r2, (
            a[:, None] * h1 + b[:, None] * h2
        ) - slope  # a frictionless ball pushes along the normal

    world.changes.append(change)
    world.depths.append(lambda rows, xy: xy @ slope)


def shift(world, size, drawn):
    world.places.append(lambda rows, xy: xy + 0.5 * size * np.array([drawn["x"], drawn["y"]]))


def yaw(world, size, drawn):
    c, s = np.cos(np.deg2rad(2 * size * drawn["sign"])), np.sin(np.deg2rad(2 * size * drawn["sign"]))
    world.places.append(lambda rows, xy: xy @ np.array([[c, s], [-s, c]]))


def grid(world, size, drawn):
    world.places.append(lambda rows, xy: xy * (1 + 0.01 * size * drawn["sign"]))


def frame(world, size, drawn):
    world.yielding.append(lambda xy, z: -0.05 * size * z)


def plate(world, size, drawn):
    """The base plate sags by the static shape of a clamped square, not by its first mode of sines."""
    half = world.library.sensor.plain.width_mm / 2
    shape = lambda xy: ((1 - (xy / half) ** 2) ** 2).prod(axis=1)  # noqa: E731
    world.yielding.append(lambda xy, z: -0.05 * size * shape(xy) ** 2 * z)


def late(world, size, drawn):
    """Force is stamped late: the stage is read where it was before."""

    def read(rows):
        at = rows["at_s"].to_numpy()
        depth = world.plan.commanded_depth(at - 0.05 * size * drawn["sign"], rows["deepest_mm"].to_numpy())
        return np.where(rows["phase"] == "zero", rows["depth_mm"], np.maximum(depth, 1e-6))

    world.clock.append(read)


def backlash(world, size, drawn):
    """Play of the stage across the press: it follows the motor once this has gone through the play."""
    half = 0.2 * size * np.array([drawn["x"], drawn["y"]])

    def move(rows, xy):
        press = rows.groupby(["session", "order"], sort=False).ngroup().to_numpy()
        first = np.unique(press, return_index=True)[1]
        session, sent = rows["session"].to_numpy()[first], xy[first]
        stage = sent.copy()
        for p in range(1, len(sent)):
            if session[p] == session[p - 1]:
                stage[p] = np.clip(stage[p - 1], sent[p] - half, sent[p] + half)
        return xy + (stage - sent)[press]

    world.places.append(move)


# --- force sensor ---------------------------------------------------------------------------------------------------------


def gain(world, size, drawn):
    gain = 1 + 0.05 * size * np.array([drawn["gx"], drawn["gy"], drawn["gz"]])
    world.sensor.append(lambda rows, force: force * gain)


def offset(world, size, drawn):
    world.sensor.append(
        lambda rows, force: force + 0.02 * size * np.array([drawn["ox"], drawn["oy"], drawn["oz"]])
    )


def drift(world, size, drawn):
    """The amplifier warms up: the zero goes to its new value exponentially."""
    by = 0.05 * size * np.array([drawn["ox"], drawn["oy"], drawn["oz"]])
    world.sensor.append(
        lambda rows, force: force + by * (1 - np.exp(-rows["time_s"].to_numpy() / drawn["warm_s"]))[:, None]
    )


def slowing_drift(world, size, drawn):
    """The zero creeps with the logarithm of time, as a strain gauge's glue does: it never comes to rest."""
    by = 0.02 * size * np.array([drawn["ox"], drawn["oy"], drawn["oz"]])
    world.sensor.append(lambda rows, force: force + by * np.log1p(rows["time_s"].to_numpy() / 60.0)[:, None])


def cross(world, size, drawn):
    """The sensor sits turned on its plate: a rotation by angles, not small terms."""
    a = 0.03 * size * np.array([drawn["a"], drawn["b"], drawn["c"]])
    turn = expm(np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]]))
    world.sensor.append(lambda rows, force: force @ turn.T)


def _following(z, press, half):
    """Return what follows z (n,) within a band about it, from none at the begin of each press (n,) int."""
    shown = np.empty_like(z)
    for k in range(len(z)):
        last = 0.0 if k == 0 or press[k] != press[k - 1] else shown[k - 1]
        shown[k] = np.clip(last, z[k] - half, z[k] + half)
    return shown


def play(world, size, drawn):
    """Friction of two joints that share the force: each half follows it only outside a band about where it was.

    Bands of a half and three halves of a share of the largest force of the recording. Before the tenth set one band, a share
    of the largest force of each press: it was as wide during loading, when no sensor knows what force will come.
    """

    def read(rows, force):
        shown, z = force.copy(), force[:, 2]
        press = rows.groupby(["session", "order"], sort=False).ngroup().to_numpy()
        half = 0.02 * size * np.abs(z).max()
        shown[:, 2] = (_following(z, press, half / 2) + _following(z, press, 3 * half / 2)) / 2
        return shown

    world.sensor.append(read)
