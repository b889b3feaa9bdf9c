"""Where the nodes are: layers thicker or thinner than drawn, a contact that lies elsewhere; and residual stretch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gelforge.config import ConfigError, Effects, Sensor
from gelforge.indentation.effects.material import by_region
from gelforge.indentation.effects.surfaces import layer_heights, surface_rises
from gelforge.mechanics.meshes.mesh import Mesh

# mm, from the contact to an edge. What lies between takes up the move of a derivative, 0.005 mm (step and width of
# misregistration), by 2 % of its length. A contact at the edge takes nothing along
# (tests/indentation/test_carried_place.py).
LEAST_ROOM = 0.3
# Of the way from a contact's middle to the wall, over which what is under it stays behind: what moves and what takes the
# move up have equal room (tests/indentation/test_carried_place.py, contacts over the wall too).
LEAST_SHARE = 0.5
# Share of its nominal thickness that a layer keeps everywhere: thinner elements are not solved well. 3 mm less 2.8 mm are
# refused (tests/indentation/test_effects_entries.py).
LEAST_THICKNESS = 0.2


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
    # below the layers all moves as their base
    up = np.clip((z - heights[layer]) / np.diff(heights)[layer], 0, 1)
    node = np.arange(len(z))
    X = mesh.X.copy()
    X[:, 2] = z + (1 - up) * rise[node, layer] + up * rise[node, layer + 1]
    return replace(mesh, X=X)


def carried_mesh(mesh: Mesh, sensor: Sensor, touched: np.ndarray, by: np.ndarray) -> Mesh | None:
    """Return the mesh of a block whose touched part is moved by (2,) [mm] while its edges, wall and all outside stay.

    From the discs touched (n, 3) = (x, y, radius) [mm] nodes follow in proportion, linearly in x and in y: on the top to its
    edges, below the top layer to the wall, in between linearly in z; heights stay. An indentation that is moved with its
    nodes sees no other pattern of elements. None where the discs leave no room to the edges.
    """
    wall = sensor.wall_mm if len(sensor.layers) > 1 else 0.0
    on_top, below = np.ones(len(mesh.X)), np.ones(len(mesh.X))
    for axis, width in ((0, sensor.width_x_mm), (1, sensor.width_y_mm)):
        low = float((touched[:, axis] - touched[:, 2]).min())
        high = float((touched[:, axis] + touched[:, 2]).max())
        if min(low, width - high) < LEAST_ROOM:
            return None
        inner = wall, width - wall
        # A contact that lies over the wall takes what is under it along as far as there is room.
        room = LEAST_SHARE * (low + high - 2 * inner[0]) / 2, LEAST_SHARE * (2 * inner[1] - low - high) / 2
        under = max(low, inner[0] + room[0]), min(high, inner[1] - room[1])
        if under[0] > under[1]:
            return None
        at, shares = mesh.X[:, axis], (0.0, 1.0, 1.0, 0.0)
        on_top *= np.interp(at, (0.0, low, high, width), shares)
        below *= np.interp(at, (inner[0], *under, inner[1]), shares)
    up = np.clip(1 + mesh.X[:, 2] / sensor.layers[-1].thickness_mm, 0.0, 1.0) if wall else 0.0
    share = up * on_top + (1 - up) * below
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
