"""An indentation seen from the side (deformed section) and from above (contact pressure)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.tri import Triangulation

from gelforge.config import Indenter
from gelforge.report.figures.simulation.silhouette import draw_indenter
from gelforge.report.figures.style import (
    FAINT,
    INK,
    MAGNITUDE,
    PREDICTED,
    new_figure,
    region_colours,
    styled,
)


def contact_pressure_kPa(node_normal_N: np.ndarray, node_area_mm2: np.ndarray) -> np.ndarray:
    """Return |normal force| (S, 3) over area (S) in kPa; a node without area carries none."""
    force = np.linalg.norm(node_normal_N, axis=-1)
    area = np.where(node_area_mm2 > 0, node_area_mm2, np.inf)
    return 1000.0 * force / area  # N/mm2 = MPa


def boundary_edges(xz: np.ndarray, quads: np.ndarray, regions: np.ndarray) -> np.ndarray:
    """Return the edges (M, 2) of a plane of quads (Q, 4) that lie on its outline or between two regions.

    xz (P, 2) are undeformed nodes: there the quads of hexahedra are upright rectangles. Where one meets two smaller ones
    they share no edge; such an edge is no boundary if just beyond it lies the same region.
    """
    sides = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)  # (4Q, 2)
    edges, index, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    owner = np.repeat(regions, 4).astype(float)
    lowest, highest = np.full(len(edges), np.inf), np.full(len(edges), -np.inf)
    np.minimum.at(lowest, index.ravel(), owner)
    np.maximum.at(highest, index.ravel(), owner)
    kept = (count == 1) | (lowest != highest)
    if not _upright(xz, quads):  # cut through tetrahedra: neighbours share whole edges
        return edges[kept]
    single = np.flatnonzero(count == 1)
    quad = np.empty(len(edges), int)
    quad[index.ravel()] = np.repeat(np.arange(len(quads)), 4)
    beyond = _region_beyond(xz, edges[single], quads, quad[single], regions)
    kept[single] = beyond != lowest[single]
    return edges[kept]


def _upright(xz, quads) -> bool:
    """Return whether all quads (Q, 4) are rectangles along the axes."""
    corners = xz[quads]
    ends = corners.min(axis=1, keepdims=True), corners.max(axis=1, keepdims=True)
    return bool(np.minimum(*(np.abs(corners - end) for end in ends)).max(initial=0.0) < 1e-9)


def _region_beyond(xz, edges, quads, quad, regions) -> np.ndarray:
    """Return for each edge (M, 2) of its quad (M) the region just beyond it, -1 where there is none."""
    low, high = xz[quads].min(axis=1), xz[quads].max(axis=1)  # (Q, 2)
    # off the middle, where the corner of two smaller quads may be; a hundredth is inside any of them
    on_edge = 0.6 * xz[edges[:, 0]] + 0.4 * xz[edges[:, 1]]
    point = on_edge + 0.01 * (on_edge - 0.5 * (low + high)[quad])
    inside = ((point[:, None] > low) & (point[:, None] < high)).all(axis=2)  # (M, Q)
    return np.where(inside.any(axis=1), np.asarray(regions)[inside.argmax(axis=1)], -1)


def draw_section(ax: Axes, node_mm, displacement_mm, quads, regions, names: list[str]) -> list[Patch]:
    """Draw the deformed faces by region and the undeformed outline in x and z; returns legend entries.

    node_mm and displacement_mm (P, 3), quads (Q, 4) rows of node_mm, regions (Q) indices into names.
    """
    quads = np.asarray(quads, int)
    start = np.asarray(node_mm)[:, [0, 2]]
    moved = start + np.asarray(displacement_mm)[:, [0, 2]]
    colours = region_colours(names)
    faces = [colours[r] for r in regions]
    ax.add_collection(PolyCollection(moved[quads], facecolors=faces, edgecolors="#8E8E8E", linewidths=0.25))
    edges = boundary_edges(start, quads, np.asarray(regions))
    ax.add_collection(LineCollection(moved[edges], colors=INK, linewidths=0.9))
    ax.add_collection(LineCollection(start[edges], colors=PREDICTED, linewidths=0.8, linestyles=(0, (3, 2))))
    used = sorted(set(int(r) for r in regions))
    patches = [Patch(fc=colours[r], ec="#8E8E8E", label=names[r]) for r in used]
    patches.append(Patch(fc="none", ec=PREDICTED, ls="--", label="before the indentation"))
    ax.set(aspect="equal", xlabel="x [mm]", ylabel="z [mm]")
    return patches


def draw_pressure(ax: Axes, node_xy_mm, displacement_mm, pressure_kPa, centre_mm, half_width_mm: float):
    """Draw the contact pressure (S) at the deformed surface nodes from above; returns the coloured artist."""
    xy = np.asarray(node_xy_mm)
    triangles = Triangulation(xy[:, 0], xy[:, 1]).triangles  # of the undeformed surface, which has no folds
    moved = xy + np.asarray(displacement_mm)[:, :2]
    image = ax.tripcolor(
        moved[:, 0],
        moved[:, 1],
        np.asarray(pressure_kPa),
        triangles=triangles,
        shading="gouraud",
        cmap=MAGNITUDE,
        vmin=0,
        vmax=max(float(pressure_kPa.max(initial=0.0)), 1e-6),
        rasterized=True,
    )
    ax.plot(*moved.T, ".", ms=1.2, color=FAINT, rasterized=True)
    (x, y), half = centre_mm, half_width_mm
    ax.set(
        aspect="equal", xlabel="x [mm]", ylabel="y [mm]", xlim=(x - half, x + half), ylim=(y - half, y + half)
    )
    return image


@styled
def section_figure(arrays: dict, row: int, names: list[str], position_mm, indenter: Indenter) -> Figure:
    """Return the deformed section next to the contact pressure from above, for a depth (row) of a site."""
    depth = float(arrays["depth_mm"][row])
    figure, axes = new_figure(9.6, 3.8, nrows=1, ncols=2, width_ratios=[2.1, 1])
    side, top = axes[0]
    nodes = np.asarray(arrays["section_node_mm"])
    moved = arrays["section_displacement_mm"][row]
    entries = draw_section(side, nodes, moved, arrays["section_quad"], arrays["section_region"], names)
    # Below the drawing: above it the indenter may stand anywhere.
    figure.legend(handles=entries, loc="outside lower left", ncols=len(entries))
    x, _, z = arrays["indenter_mm"][row]
    turned = np.append(arrays["tilt_deg"][row], arrays["twist_deg"][row] if "twist_deg" in arrays else 0.0)
    top_mm = draw_indenter(side, indenter, x, z, turned)
    side.set(
        xlim=(nodes[:, 0].min() - 0.7, nodes[:, 0].max() + 0.7),
        ylim=(nodes[:, 2].min() - 0.4, top_mm + 0.5),
        title=f"cut at y = {nodes[:, 1].mean():.2f} mm, indenter {depth:g} mm deep, true scale",
    )

    carries = np.asarray(arrays["node_area_mm2"]) > 0  # corners of quadratic tetrahedra stand for no area
    node_xy = np.asarray(arrays["node_xy_mm"])[carries]
    area = np.asarray(arrays["node_area_mm2"])[carries]
    pressure = contact_pressure_kPa(arrays["node_normal_N"][row][carries], area)
    reach = np.linalg.norm(node_xy[pressure > 0] - np.asarray(position_mm), axis=1)
    half = 1.35 * float(reach.max(initial=1.0))
    moved = arrays["node_displacement_mm"][row][carries]
    shown = draw_pressure(top, node_xy, moved, pressure, position_mm, half)
    figure.colorbar(shown, ax=top, label="contact pressure [kPa]", shrink=0.85)
    top.set_title(f"from above, largest {pressure.max(initial=0.0):.1f} kPa")
    return figure
