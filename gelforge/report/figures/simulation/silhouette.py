"""Indenters drawn from the side, whatever their shape."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull

from gelforge.config import Indenter
from gelforge.indentation.sensor.indenter_shapes import shape_of
from gelforge.mechanics.indenters.shapes import Indenter as Shape
from gelforge.mechanics.indenters.shapes import Several, rotation_of
from gelforge.report.figures.style import INK


def silhouettes(shape: Shape, tilt_deg=(0.0, 0.0)) -> list[np.ndarray]:
    """Return the outline (m, 2) = (x, z) [mm] about the centre of each of its shapes seen along y.

    tilt_deg: turns about x and y, and about z if given.
    Shapes are drawn as wide as they are at any y; dents of a closed surface are filled.
    """
    turn = rotation_of(np.radians([*tilt_deg, 0.0][:3]))
    placed = zip(shape.shapes, shape.offsets) if isinstance(shape, Several) else [(shape, np.zeros(3))]
    seen = [((part.outline + offset) @ turn.T)[:, [0, 2]] for part, offset in placed]
    return [points[ConvexHull(points).vertices] for points in seen]


def draw_indenter(
    ax: Axes, indenter: Indenter, x_mm: float, z_mm: float, tilt_deg=(0.0, 0.0), **look
) -> float:
    """Draw the indenter with its centre at (x, z); return the height of its top [mm]."""
    outlines = [points + [x_mm, z_mm] for points in silhouettes(shape_of(indenter), tilt_deg)]
    for points in outlines:
        ax.add_patch(
            Polygon(points, closed=True, **({"fc": "#D9D9D9", "ec": INK, "lw": 1, "zorder": 5} | look))
        )
    return max(points[:, 1].max() for points in outlines)


def touched_radius_mm(indenter: Indenter, depth_mm: float) -> float:
    """Return how far from the position the undeformed surface is cut by the indenter at a depth [mm], 0 untouched."""
    if depth_mm <= 0:
        return 0.0
    discs = shape_of(indenter).section(depth_mm)
    return float((np.hypot(discs[:, 0], discs[:, 1]) + discs[:, 2]).max())
