"""Where the nodes are: layers thicker or thinner than drawn, a contact that lies elsewhere; and residual stretch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gelforge.config import ConfigError, Effects, Sensor
from gelforge.indentation.effects.material import by_region
from gelforge.indentation.effects.surfaces import layer_heights, surface_rises
from gelforge.mechanics.meshes import Mesh

LEAST_ROOM = (
    3.0  # times a move, between the contact and a wall: elements there keep two thirds of their width
)
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


def carried_mesh(mesh: Mesh, sensor: Sensor, touched: np.ndarray, by: np.ndarray) -> Mesh | None:
    """Return the mesh of a block whose touched part is moved by (2,) [mm] while walls and all outside stay.

    Between the discs touched (n, 3) = (x, y, radius) [mm] and the walls nodes follow in proportion, linearly in x and in y;
    every node keeps its height. A press that is moved with its nodes sees no other pattern of elements. None where the
    discs leave no room to the walls.
    """
    share = np.ones(len(mesh.X))
    for axis, width in ((0, sensor.width_x_mm), (1, sensor.width_y_mm)):
        low = float((touched[:, axis] - touched[:, 2]).min())
        high = float((touched[:, axis] + touched[:, 2]).max())
        inner = sensor.wall_mm, width - sensor.wall_mm
        if min(low - inner[0], inner[1] - high) < LEAST_ROOM * abs(by[axis]):
            return None
        share *= np.interp(mesh.X[:, axis], (inner[0], low, high, inner[1]), (0.0, 1.0, 1.0, 0.0))
    X = mesh.X.copy()
    X[:, :2] += (share if mesh.ties is None else mesh.ties @ share)[:, None] * by
    return replace(mesh, X=X)


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
