"""Sensor, positions, bins and camera view in one picture."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from gelforge.config import Camera, Sensor, Session, Study
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.indenter_shapes import shape_of
from gelforge.indentation.sensor.unrolled import is_unrolled, rolled
from gelforge.mechanics.indenters.shapes import DOWN
from gelforge.recording.optics.camera import CameraError, unproject
from gelforge.report.figures.simulation.silhouette import draw_indenter
from gelforge.report.figures.style import (
    INK,
    PREDICTED,
    SIMULATED,
    SURROUND,
    Style,
    frame_arrows,
    new_figure,
    region_colours,
    styled,
)

WALL_COLOUR = SURROUND["wall"]
LINE_POINTS = 60  # of the edge of a row of bins, which a dome bends
OUTSIDE = "#E9E6DC"  # of a shape seen from above: the positions' blues must stand out


def camera_footprint(camera: Camera, crop_px: list[int] | None = None, z_mm: float = 0.0) -> np.ndarray:
    """Return the corners (4, 2) [mm] of the image on the plane z_mm, clockwise from its top left.

    Pixel (0, 0) is the centre of the top left pixel, so the image spans -1/2 to width - 1/2.
    """
    left, top, width, height = crop_px or (0, 0, camera.width_px, camera.height_px)
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) + [left - 0.5, top - 0.5]
    return unproject(camera, corners, z_mm)[:, :2]


def _sees_a_frame(camera: Camera | None, crop: list[int] | None) -> bool:
    """Return whether the image's corners show the surface: a wide lens may show no ray there, and no frame is drawn."""
    try:
        return camera is not None and bool(len(camera_footprint(camera, crop)))
    except CameraError:
        return False


@styled
def sensor_figure(study: Study, cells: dict[str, PlannedCell], session: Session | None = None) -> Figure:
    """Return the sensor from above (positions, bins, camera view, frame) beside its section with the ball."""
    crop = session.crop_px if session else None
    camera = session.camera if session and _sees_a_frame(session.camera, crop) else None
    figure, axes = new_figure(10.4, 5.7, nrows=1, ncols=2, width_ratios=[1, 1])
    _draw_above(axes[0, 0], study, cells, camera, crop)
    _draw_side(axes[0, 1], study, cells, camera, crop)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _draw_above(ax: Axes, study: Study, cells: dict[str, PlannedCell], camera: Camera | None, crop) -> None:
    sensor = study.sensor
    wx, wy = sensor.width_x_mm, sensor.width_y_mm
    if sensor.flange:
        w = sensor.flange.width_mm
        ax.add_patch(
            Rectangle((-w, -w), wx + 2 * w, wy + 2 * w, fc="#F6E3EA", ec="#999999", label=f"flange {w:g} mm")
        )
    if sensor.shape.kind == "block":
        _draw_block_above(ax, sensor)
    else:
        _draw_surface_above(ax, sensor)
    along_x, along_y = np.linspace(0, wx, LINE_POINTS), np.linspace(0, wy, LINE_POINTS)
    edges = [np.stack(np.broadcast_arrays(x, along_y), -1) for x in np.linspace(0, wx, sensor.bins.nx + 1)]
    edges += [np.stack(np.broadcast_arrays(along_x, y), -1) for y in np.linspace(0, wy, sensor.bins.ny + 1)]
    for edge in edges:
        ax.plot(*rolled(sensor, edge)[:, :2].T, color="#00000022", lw=0.5)
    solved = np.array([(c.x_mm, c.y_mm) for c in cells.values() if c.solved]).reshape(-1, 2)
    mirrored = np.array([(c.x_mm, c.y_mm) for c in cells.values() if c.source]).reshape(-1, 2)
    between = np.array([(c.x_mm, c.y_mm) for c in cells.values() if c.between and not c.source]).reshape(
        -1, 2
    )
    dot = float(np.clip(40 / np.sqrt(max(len(cells), 1)), 1.2, 5))
    ax.plot(*solved.T, "o", ms=dot, color=SIMULATED, mew=0, label=f"{len(solved)} positions to simulate")
    if len(between):
        ax.plot(
            *between.T,
            "o",
            ms=dot,
            color=PREDICTED,
            mew=0,
            label=f"{len(between)} interpolated between solved",
        )
    if len(mirrored):
        ax.plot(*mirrored.T, "o", ms=dot, color="#8CC3E6", mew=0, label=f"{len(mirrored)} mirrored from them")
    if camera:
        corners = camera_footprint(camera, crop)
        view: Style = {"fill": False, "ec": PREDICTED, "lw": 1.6, "ls": (0, (5, 3))}
        ax.add_patch(Polygon(corners, label="what the camera sees at z = 0", **view))
        place: Style = {"textcoords": "offset points", "ha": "left", "va": "bottom", "fontsize": 8}
        ax.annotate("image's top left", corners[0], (0, 3), color=PREDICTED, **place)
    frame_arrows(ax, (0, 0), 0.2 * max(wx, wy), ("x", "y"), out="z")
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.margins(0.06)
    nx, ny = sensor.bins.nx, sensor.bins.ny
    of_each = "equal areas" if is_unrolled(sensor) else f"{wx / nx:.3g} x {wy / ny:.3g} mm"
    bins = f"{nx} x {ny} bins of {of_each}"
    ax.set_title(f"from above: {wx:g} x {wy:g} mm, {bins}")
    ax.set_xlabel("x [mm]")
    ax.set_ylabel("y [mm]")


def _draw_block_above(ax: Axes, sensor: Sensor) -> None:
    wx, wy, wall = sensor.width_x_mm, sensor.width_y_mm, sensor.wall_mm
    colours = region_colours([layer.name for layer in sensor.layers])
    wall_label = f"wall {wall:g} mm, below the top layer" if wall else "no wall"
    ax.add_patch(Rectangle((0, 0), wx, wy, fc=WALL_COLOUR, ec=INK, lw=1.4, label=wall_label))
    ax.add_patch(
        Rectangle(
            (wall, wall),
            wx - 2 * wall,
            wy - 2 * wall,
            fc=colours[0],
            ec="none",
            label=f"{sensor.layers[0].name} inside the wall",
        )
    )


def _draw_surface_above(ax: Axes, sensor: Sensor) -> None:
    """Draw the surfaces of a sensor that is no block, seen from above."""
    from gelforge.indentation.sensor.sensor_mesh import sensor_solids  # loads the mesher's files

    surfaces = sensor_solids(sensor).surfaces
    triangles = np.concatenate([surface.vertices[surface.triangles][:, :, :2] for surface in surfaces])
    ax.add_collection(PolyCollection(list(triangles), facecolors=OUTSIDE, edgecolors=OUTSIDE, linewidths=0.4))
    ax.add_patch(Rectangle((0, 0), 0, 0, fc=OUTSIDE, label=f"outer surface, a {sensor.shape.kind}"))


def _draw_surfaces_cut(ax: Axes, sensor: Sensor) -> None:
    """Draw the solids of a sensor that is no block, cut at the middle of y."""
    from gelforge.indentation.sensor.sensor_mesh import sensor_solids

    solids, colours = sensor_solids(sensor), region_colours([layer.name for layer in sensor.layers])
    low, high = solids.bounds
    x, z = (np.linspace(a - 0.1, b + 0.1, 241) for a, b in zip(low[[0, 2]], high[[0, 2]]))
    points = np.stack(np.meshgrid(x, [(low[1] + high[1]) / 2], z, indexing="ij"), axis=-1).reshape(-1, 3)
    for surface, colour in reversed(list(zip(solids.surfaces, colours))):
        gap = surface.distance(points)[0].reshape(len(x), len(z)).T
        ax.contourf(x, z, gap, levels=[gap.min() - 1, 0.0], colors=[colour])
        ax.contour(x, z, gap, levels=[0.0], colors=[INK], linewidths=0.7)


def _draw_layers(ax: Axes, sensor: Sensor, text_x_mm: float) -> None:
    wx, wall, height = sensor.width_x_mm, sensor.wall_mm, sensor.height_mm
    bottom = -height
    colours = region_colours([layer.name for layer in sensor.layers])
    block = sensor.shape.kind == "block"
    if not block:
        _draw_surfaces_cut(ax, sensor)
    for number, layer in enumerate(sensor.layers):
        inset = 0 if number == len(sensor.layers) - 1 else wall  # the top layer caps the wall
        if block:
            corner, width = (inset, bottom), wx - 2 * inset
            ax.add_patch(Rectangle(corner, width, layer.thickness_mm, fc=colours[number], ec=INK, lw=0.7))
        ax.annotate(
            f"{layer.name}: {layer.thickness_mm:g} mm, {layer.material}",
            (text_x_mm, bottom + layer.thickness_mm / 2),
            (10, 0),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
            annotation_clip=False,
        )
        bottom += layer.thickness_mm
    under = height - sensor.layers[-1].thickness_mm
    if block and wall and len(sensor.layers) > 1:
        for x in (0, wx - wall):
            ax.add_patch(Rectangle((x, -height), wall, under, fc=WALL_COLOUR, ec=INK, lw=0.7))
    if sensor.flange:
        w, h = sensor.flange.width_mm, sensor.flange.height_mm
        for x in (-w, wx):
            ax.add_patch(Rectangle((x, -height), w, h, fc=WALL_COLOUR, ec=INK, lw=0.7))


def _draw_side(ax: Axes, study: Study, cells: dict[str, PlannedCell], camera: Camera | None, crop) -> None:
    sensor = study.sensor
    wx, height = sensor.width_x_mm, sensor.height_mm
    depths = sorted({depth for cell in cells.values() for depth in cell.depths_mm})
    rim = sensor.flange.width_mm if sensor.flange else 0.0
    base = 0.07 * wx
    seen = camera_footprint(camera, crop)[:, 0].max() if camera else wx
    text_x = max(wx + rim, seen)  # beside the sensor and the camera's view
    ax.add_patch(
        Rectangle((-rim, -height - base), wx + 2 * rim, base, fc="#E3E3E3", ec="#9A9A9A", hatch="///", lw=0.6)
    )
    ax.annotate(
        "rigid base",
        (text_x, -height - base / 2),
        (10, 0),
        textcoords="offset points",
        va="center",
        fontsize=8.5,
    )
    _draw_layers(ax, sensor, text_x)
    deepest = depths[-1]
    shape = shape_of(study.indenter)
    top = draw_indenter(
        ax, study.indenter, wx / 2, shape.support(DOWN) - deepest, fc="#FFFFFFCC", lw=1.2, zorder=1
    )
    text = f"{study.indenter.words},\n{deepest:g} mm deep"
    ax.text(wx / 2 + shape.support(np.eye(3)[0]) + 0.02 * wx, top / 2, text, va="center", fontsize=8.5)
    ax.plot([0, wx], [0, 0], color=INK, lw=0.8, ls=":")
    if camera:
        _draw_view(ax, camera, crop, text_x, -height - base)
    frame_arrows(ax, (0, 0), 0.2 * wx, ("x", "z"))
    ax.set_aspect("equal")
    ax.autoscale_view()
    low = -height - base - 0.35 * wx
    ax.set_ylim(low, top + 0.06 * wx)
    ax.set_xlim(-rim - 0.08 * wx, text_x + 0.6 * wx)
    steps = (
        f"{len(depths)} depths, {depths[0]:g} to {deepest:g} mm"
        if len(depths) > 1
        else f"depth {deepest:g} mm"
    )
    ax.set_title(f"cut through the middle: {steps}")
    ax.set_xlabel("x [mm]")
    ax.set_ylabel("z [mm]")


def _draw_view(ax: Axes, camera: Camera, crop, text_x_mm: float, base_z: float) -> None:
    """Draw the camera's viewing rays up to the surface; the camera itself may lie below the drawing."""
    pinhole = np.array([camera.position_mm[0], camera.position_mm[2]])
    for x in camera_footprint(camera, crop)[:2, 0]:
        ax.plot([pinhole[0], x], [pinhole[1], 0], color=PREDICTED, lw=1.2, ls=(0, (5, 3)), clip_on=True)
    text = f"camera at z = {camera.position_mm[2]:g} mm looks up"
    place: Style = {"textcoords": "offset points", "va": "center", "fontsize": 8.5, "annotation_clip": False}
    ax.annotate(text, (text_x_mm, base_z), (10, -16), color=PREDICTED, **place)
    ax.plot(*pinhole, "s", ms=8, color=PREDICTED, clip_on=True)
