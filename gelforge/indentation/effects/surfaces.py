"""Where the base, the layers' faces and the top lie when the layers are not as thick as drawn. Loads no kernels."""

from __future__ import annotations

import numpy as np

from gelforge.config import Effects, Sensor


def layer_heights(sensor: Sensor) -> np.ndarray:
    """Return the z (L + 1,) [mm] of the base and of each layer's top, as drawn."""
    heights = np.cumsum([0.0] + [layer.thickness_mm for layer in sensor.layers]) - sensor.height_mm
    heights[-1] = 0.0
    return heights


def surface_rises(sensor: Sensor, effects: Effects, places: np.ndarray) -> np.ndarray:
    """Return how far (..., L + 1) [mm] the base and each layer's top lie above where they are drawn, at (x, y) (..., 2)."""
    away = places - [sensor.width_x_mm / 2, sensor.width_y_mm / 2]
    rises = [np.zeros(places.shape[:-1])]
    for layer in sensor.layers:
        real = effects.geometry.thickness.get(layer.name)
        more = 0.0 if real is None else real.change_mm + away @ np.array(real.gradient)
        rises.append(rises[-1] + more)
    return np.stack(rises, axis=-1) - sum(real.change_mm for real in effects.geometry.thickness.values())


def top_slope(effects: Effects) -> np.ndarray:
    """Return the slope of the top surface: those of all layers add.

    Parameters
    ----------
    effects : Effects
        Their `geometry.thickness`.

    Returns
    -------
    numpy.ndarray
        (2,), along x and y [mm/mm].
    """
    return np.sum([[0.0, 0.0], *(real.gradient for real in effects.geometry.thickness.values())], axis=0)
