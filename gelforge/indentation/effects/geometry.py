"""Where the nodes of the mesh are when the layers are not as thick as drawn, and the indenter as it really is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gelforge.config import ConfigError, Effects, Sensor
from gelforge.indentation.effects.material import by_region
from gelforge.mechanics.indenters import Indenter as Shape
from gelforge.mechanics.indenters import Sphere
from gelforge.mechanics.meshes import Mesh

LEAST_THICKNESS = (
    0.2  # share of its nominal thickness that a layer keeps everywhere: thinner elements are not solved well
)


def moved_mesh(mesh: Mesh, sensor: Sensor, effects: Effects) -> Mesh:
    """Return the mesh with its nodes moved up or down to the layers' real thickness; the mesh itself where it is nominal.

    Within a layer the move is linear in z, and it is linear in x and y: hanging nodes stay on their edges and faces.
    Surface.area stays that of the drawn top: it only scales the contact's unknowns.
    """
    if not any(t.change_mm or any(t.gradient) for t in effects.geometry.thickness.values()):
        return mesh
    heights = layer_heights(sensor)  # (L + 1,)
    rise = surface_rises(sensor, effects, mesh.X[:, :2])  # (N, L + 1)
    _check_thickness(sensor, heights, rise)
    z = mesh.X[:, 2]
    layer = np.clip(np.searchsorted(heights, z, side="right") - 1, 0, len(heights) - 2)
    up = np.clip(
        (z - heights[layer]) / np.diff(heights)[layer], 0, 1
    )  # below the layers all moves as their base
    node = np.arange(len(z))
    X = mesh.X.copy()
    X[:, 2] = z + (1 - up) * rise[node, layer] + up * rise[node, layer + 1]
    return replace(mesh, X=X)


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
    """Return the slope (2,) [mm/mm] of the top surface: those of all layers add."""
    return np.sum([[0.0, 0.0], *(real.gradient for real in effects.geometry.thickness.values())], axis=0)


def _check_thickness(sensor: Sensor, heights: np.ndarray, rise: np.ndarray) -> None:
    share = (1 + np.diff(rise, axis=1) / np.diff(heights)).min(axis=0)
    worst = int(np.argmin(share))
    if share[worst] < LEAST_THICKNESS:
        raise ConfigError(
            f"mechanics.effects.geometry.thickness leaves {sensor.layers[worst].name} {share[worst]:.2g} of its nominal"
            f" thickness (limit {LEAST_THICKNESS}); make the change or the gradient smaller"
        )


def region_prestretch(sensor: Sensor, effects: Effects, regions: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Return the residual deformation gradient (3, 3) of each region that has one; its volume is that without stress."""
    chosen = by_region(effects.geometry.prestretch, regions, sensor.layers[-1].name, [1.0, 1.0])
    return {name: np.diag([x, y, 1 / (x * y)]) for name, (x, y) in chosen.items() if (x, y) != (1.0, 1.0)}


def real_indenter(shape: Shape, effects: Effects) -> Shape:
    """Return the indenter as it really is; the mesh is made for the one that is described."""
    change = effects.geometry.indenter_radius_change_mm
    if not change:
        return shape
    if not isinstance(shape, Sphere):
        raise ConfigError(
            f"mechanics.effects.geometry.indenter_radius_change_mm is for a ball, found a {type(shape).__name__.lower()};"
            " change the indenter's own sizes instead"
        )
    if shape.radius + change <= 0:
        raise ConfigError(
            f"mechanics.effects.geometry.indenter_radius_change_mm {change:g} leaves no ball of radius"
            f" {shape.radius:g} mm; make it smaller"
        )
    return Sphere(shape.radius + change)
