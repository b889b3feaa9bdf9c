"""A sensor cut through its middle, with its dimensions: what is modelled, at a glance."""

from __future__ import annotations

from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from gelforge.config import Sensor, Study
from gelforge.indentation.sensor.indenter_shapes import shape_of
from gelforge.indentation.sensor.sensor_mesh import sensor_solids
from gelforge.laws_of_study import known_laws
from gelforge.mechanics.indenters.closed_surface import ClosedSurface
from gelforge.mechanics.indenters.shapes import DOWN
from gelforge.meshing.solids import Solids
from gelforge.report.figures.simulation.silhouette import draw_indenter
from gelforge.report.figures.style import INK, SURROUND, Style, new_figure, region_colours, styled

# Height of the drawn base and room of a dimension line, over the larger width (no result depends on it).
BASE, ROOM = 0.06, 0.16


@styled
def cross_section(study: Study, title: str) -> Figure:
    """Return the section across x, and that across y unless they are the same, with dimensions in mm and the indenter.

    Parameters
    ----------
    study : Study
        Sensor, indenter and plan.
    title : str
        Of the figure.

    Returns
    -------
    Figure
        One or two sections [mm].
    """
    sensor = study.sensor
    cuts = [0] if study.sensor_has_symmetry_of_square else [0, 1]
    widths = [(sensor.width_x_mm, sensor.width_y_mm)[axis] for axis in cuts]
    figure, axes = new_figure(4.5 * len(cuts) + 1.5, 4.2, ncols=len(cuts), width_ratios=widths)
    solids = sensor_solids(sensor)
    for ax, axis in zip(axes[0], cuts):
        draw_cut(ax, study, solids, axis)
    figure.suptitle(title, fontweight="bold")
    add_layer_key(figure, study, "outside lower center")
    return figure


def add_layer_key(
    figure: Figure, study: Study, place: Literal["outside lower center", "outside lower right"]
) -> None:
    """Add a key that has each layer in words below a figure with a cut."""
    colours = region_colours([layer.name for layer in study.sensor.layers])
    keys = [Rectangle((0, 0), 1, 1, fc=colour, ec=INK, lw=0.7) for colour in colours]
    figure.legend(keys, _layer_words(study), loc=place)


def _layer_words(study: Study) -> list[str]:
    """Return each layer in words, from the base up: its thickness at the highest point, material and stiffness."""
    laws, words = known_laws(study, []), []
    for layer in study.sensor.layers:
        law = laws[layer.material].law if layer.material in laws else None
        stiffness = f"shear modulus {1e3 * law.shear_modulus:.4g} kPa" if law else "fitted to tests"
        words.append(f"{layer.name}: {layer.thickness_mm:g} mm of {layer.material}, {stiffness}")
    return words


def draw_cut(ax: Axes, study: Study, solids: Solids, axis: int) -> None:
    """Draw the cut along x (axis 0, at the middle of y) or along y (axis 1)."""
    sensor = study.sensor
    widths = np.array([sensor.width_x_mm, sensor.width_y_mm])
    width, height, unit = widths[axis], sensor.height_mm, widths.max()
    colours = region_colours(list(solids.names))
    for surface, colour in reversed(list(zip(solids.surfaces, colours))):
        for loop in section_loops(surface, 1 - axis, widths[1 - axis] / 2):
            ax.add_patch(Polygon(loop[:, [axis, 2]], fc=colour, ec=INK, lw=0.8))
    rim = sensor.flange.width_mm if sensor.flange else 0.0
    corner, size = (-rim, -height - BASE * unit), (width + 2 * rim, BASE * unit)
    ax.add_patch(Rectangle(corner, *size, fc=SURROUND["base"], ec=INK, hatch="///", lw=0.6))
    if sensor.flange:
        for start in (-rim, width):
            size = rim, sensor.flange.height_mm
            ax.add_patch(Rectangle((start, -height), *size, fc=SURROUND["flange"], ec=INK, lw=0.7))
    top = _draw_pressing(ax, study, width)
    _dimensions(ax, sensor, width, rim, unit)
    ax.set_xlim(-rim - 0.08 * unit, width + rim + ROOM * unit * (len(sensor.layers) + 0.6))
    ax.set_ylim(-height - (BASE + ROOM) * unit, top + 0.1 * unit)
    ax.set_aspect("equal")
    ax.axis("off")
    ax.set_title(f"cut along {'xy'[axis]} at the middle of {'yx'[axis]}")


def section_loops(surface: ClosedSurface, axis: int, at: float) -> list[np.ndarray]:
    """Return the loops (n, 3) [mm] in which a closed surface meets the plane where a coordinate is `at`."""
    vertices, triangles = surface.vertices, surface.triangles
    beyond = vertices[:, axis] > at
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=-1)  # (triangles, 3, 2)
    crossed = beyond[edges[..., 0]] != beyond[edges[..., 1]]  # two of a triangle's three edges, or none
    met = crossed.any(axis=1)
    ends = edges[met][crossed[met]].reshape(-1, 2, 2).tolist()  # of each triangle that is met, its two edges
    neighbours: dict[tuple, list[tuple]] = {}
    for a, b in (map(tuple, pair) for pair in ends):
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    loops: list[np.ndarray] = []
    while neighbours:
        edge: tuple | None = next(iter(neighbours))
        loop: list[tuple] = []
        while edge is not None:
            loop.append(edge)
            edge = next((other for other in neighbours.pop(edge) if other in neighbours), None)
        a, b = vertices[np.array(loop).T]
        share = (at - a[:, axis]) / (b - a)[:, axis]
        loops.append(a + share[:, None] * (b - a))
    return loops


def _draw_pressing(ax: Axes, study: Study, width: float) -> float:
    """Draw the indenter in touch above the middle; return the z [mm] up to which it is drawn."""
    shape = shape_of(study.indenter)
    top = draw_indenter(ax, study.indenter, width / 2, shape.support(DOWN), fc="#FFFFFFCC", lw=1.2, zorder=1)
    deepest = study.plan.depths_mm
    text = study.indenter.words + (f",\npressed {deepest[0]:g} to {deepest[-1]:g} mm" if deepest else "")
    ax.text(width / 2 + 1.1 * shape.support(np.eye(3)[0]), 0.6 * top, text, va="center", fontsize=8.5)
    return top


def _dimensions(ax: Axes, sensor: Sensor, width: float, rim: float, unit: float) -> None:
    """Write width, height, wall and each layer's thickness along dimension lines."""
    low = -sensor.height_mm
    _dimension(ax, (0, low - (BASE + 0.05) * unit), (width, low - (BASE + 0.05) * unit), f"{width:g} mm")
    bottom = low
    for number, layer in enumerate(sensor.layers):
        x = width + rim + ROOM * unit * (0.4 + number)
        _dimension(ax, (x, bottom), (x, bottom + layer.thickness_mm), f"{layer.thickness_mm:g}")
        bottom += layer.thickness_mm
    if sensor.shape.kind == "block" and sensor.wall_mm and len(sensor.layers) > 1:
        place: Style = {"textcoords": "offset points", "fontsize": 8.5, "ha": "left", "va": "bottom"}
        arrow = {"arrowstyle": "-", "color": INK, "lw": 0.6}
        ax.annotate(
            f"wall {sensor.wall_mm:g} mm", (sensor.wall_mm / 2, low / 2), (-4, 42), arrowprops=arrow, **place
        )


def _dimension(ax: Axes, start: tuple[float, float], end: tuple[float, float], text: str) -> None:
    """Draw a line with an arrow at each end, and its text below or at its side."""
    arrow = {"arrowstyle": "<|-|>", "color": INK, "lw": 0.8, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7}
    ax.annotate("", end, start, arrowprops=arrow)
    middle = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    place: Style = {"textcoords": "offset points", "fontsize": 8.5}
    if start[0] == end[0]:
        ax.annotate(text, middle, (5, 0), ha="left", va="center", **place)
    else:
        ax.annotate(text, middle, (0, -4), ha="center", va="top", **place)
