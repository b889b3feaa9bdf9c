"""What no catalogue has."""

from __future__ import annotations

import numpy as np


def screw(world, size, drawn):
    """The stage's lead screw: a depth error that repeats with its pitch."""
    wave = lambda z: np.sin(2 * np.pi * z / 0.7 + drawn["phase"])  # noqa: E731
    world.depths.append(lambda rows, xy: 0.05 * size * wave(rows["depth_mm"].to_numpy()))


def alternate(world, size, drawn):
    """Two amplifiers take turns, press by press, with gains apart."""
    world.sensor.append(
        lambda rows, force: force * (1 + 0.04 * size * np.where(rows["order"] % 2, 1.0, -1.0))[:, None]
    )


def stripes(world, size, drawn):
    """Knit lines of the mould: stiffness waves across the sensor."""

    def wave(xy):
        return np.cos(2 * np.pi * (xy[:, 0] * drawn["x"] + xy[:, 1] * drawn["y"]) / 8.0 + drawn["phase"])

    world.changes.append(lambda xy, depth: (0.05 * size * wave(xy), np.zeros((len(xy), 2))))


def cycle(world, size, drawn):
    """The room's air conditioning: the load cell's gain swings with its period."""
    world.sensor.append(
        lambda rows, force: (
            force
            * (
                1
                + 0.04
                * size
                * np.sin(2 * np.pi * rows["time_s"].to_numpy() / drawn["period_s"] + drawn["phase"])
            )[:, None]
        )
    )


def shaft(world, size, drawn):
    """The indenter's shaft meets a clamp next to the sensor: on one side, beyond a depth, a stop pushes back."""

    def remember(world, rows, xy, depth, force):
        side = xy @ np.array([drawn["x"], drawn["y"]]) > 4.5
        push = 0.4 * size * np.maximum(depth - 1.0, 0.0) * side
        return force - push[:, None] * np.array([0.3 * drawn["x"], 0.3 * drawn["y"], 1.0])

    world.history.append(remember)


def unrecovered(world, size, drawn):
    """The surface comes back slowly: a place pressed a short while ago is still lower, and is met later."""

    def deeper(rows, xy):
        press = rows.groupby(["session", "order"], sort=False).ngroup().to_numpy()
        first = rows.groupby(press).first()
        time = first["session"].to_numpy() * 1e6 + first["time_s"].to_numpy()
        at, deepest = first[["x_mm", "y_mm"]].to_numpy(), first["deepest_mm"].to_numpy()
        left = np.zeros(len(first))
        for p in range(1, len(first)):
            away = np.linalg.norm(at[:p] - at[p], axis=1)
            left[p] = (
                deepest[:p] * np.exp(-((away / 4.0) ** 2)) * np.exp(-(time[p] - time[:p]) / 60.0)
            ).sum()
        return -0.05 * size * left[press]

    world.depths.append(deeper)


def chatter(world, size, drawn):
    """Presses of one depth were driven by another programme that overshoots and comes back: only these are off."""
    depth = world.plan.depths[drawn["depth"]]
    world.depths.append(lambda rows, xy: 0.06 * size * np.isclose(rows["deepest_mm"], depth).astype(float))
