"""Sensor, positions, bins and camera view in one picture."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from gelforge.config import Camera, Sensor, Session, Study
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.sensor_mesh import sensor_solids
from gelforge.indentation.sensor.unrolled import is_unrolled, rolled
from gelforge.recording.optics.camera import CameraError, unproject
from gelforge.report.figures.simulation.cross_section import add_layer_key, draw_cut
from gelforge.report.figures.style import PREDICTED, SIMULATED, Style, new_figure, styled

OUTSIDE = "#E9E6DC"  # of a shape seen from above: the positions' blues must stand out


def camera_footprint(camera: Camera, crop_px: list[int] | None = None) -> np.ndarray:
    """Return the corners (4, 2) [mm] of the image on the plane z = 0, clockwise from its top left.

    Pixel (0, 0) is the centre of the top left pixel, so the image spans -1/2 to width - 1/2.
    """
    left, top, width, height = crop_px or (0, 0, camera.width_px, camera.height_px)
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) + [left - 0.5, top - 0.5]
    return unproject(camera, corners, 0.0)[:, :2]


def _sees_a_frame(camera: Camera | None, crop: list[int] | None) -> bool:
    """Return whether the image's corners show the surface: a wide lens may show no ray there, and no frame is drawn."""
    try:
        return camera is not None and bool(len(camera_footprint(camera, crop)))
    except CameraError:
        return False


@styled
def sensor_figure(study: Study, cells: dict[str, PlannedCell], session: Session | None = None) -> Figure:
    """Return the sensor from above (positions, bins, camera view, frame) next to its section with the ball.

    Parameters
    ----------
    study : Study
        Sensor, indenter and bins.
    cells : dict of str to PlannedCell
        Sites of the plan.
    session : Session, optional
        Whose camera and crop are shown.

    Returns
    -------
    Figure
        Two panels [mm].
    """
    crop = session.crop_px if session else None
    camera = session.camera if session and _sees_a_frame(session.camera, crop) else None
    figure, axes = new_figure(10.4, 6.3, ncols=2)
    _draw_above(axes[0, 0], study, cells, camera, crop)
    _draw_side(axes[0, 1], study, cells, camera, crop)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower left", ncols=2)
    add_layer_key(figure, study, "outside lower right")
    return figure


def _draw_above(ax: Axes, study: Study, cells: dict[str, PlannedCell], camera: Camera | None, crop) -> None:
    sensor = study.sensor
    wx, wy = sensor.width_x_mm, sensor.width_y_mm
    if sensor.flange:
        w = sensor.flange.width_mm
        ax.add_patch(
            Rectangle((-w, -w), wx + 2 * w, wy + 2 * w, fc="#F6E3EA", ec="#999999", label=f"flange {w:g} mm")
        )
    _draw_surface_above(ax, sensor)
    along_x, along_y = np.linspace(0, wx, 60), np.linspace(0, wy, 60)  # a dome bends the edges of bins
    edges = [np.stack(np.broadcast_arrays(x, along_y), -1) for x in np.linspace(0, wx, sensor.bins.nx + 1)]
    edges += [np.stack(np.broadcast_arrays(along_x, y), -1) for y in np.linspace(0, wy, sensor.bins.ny + 1)]
    for edge in edges:
        ax.plot(*rolled(sensor, edge)[:, :2].T, color="#00000022", lw=0.5)
    dot = float(np.clip(40 / np.sqrt(max(len(cells), 1)), 1.2, 5))
    kinds = {  # words: colour, sites
        "positions to simulate": (SIMULATED, [c for c in cells.values() if c.solved]),
        "interpolated between solved": (PREDICTED, [c for c in cells.values() if c.between and not c.source]),
        "mirrored from them": ("#8CC3E6", [c for c in cells.values() if c.source]),
    }
    for words, (colour, sites) in kinds.items():
        if sites or colour == SIMULATED:
            places = np.array([(c.x_mm, c.y_mm) for c in sites]).reshape(-1, 2)
            ax.plot(*places.T, "o", ms=dot, color=colour, mew=0, label=f"{len(sites)} {words}")
    if camera:
        corners = camera_footprint(camera, crop)
        view: Style = {"fill": False, "ec": PREDICTED, "lw": 1.6, "ls": (0, (5, 3))}
        ax.add_patch(Polygon(corners, label="what the camera sees at z = 0", **view))
        place: Style = {"textcoords": "offset points", "ha": "left", "va": "bottom", "fontsize": 8}
        ax.annotate("image's top left", corners[0], (0, 3), color=PREDICTED, **place)
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.margins(0.06)
    nx, ny = sensor.bins.nx, sensor.bins.ny
    of_each = "equal areas" if is_unrolled(sensor) else f"{wx / nx:.3g} x {wy / ny:.3g} mm"
    bins = f"{nx} x {ny} bins of {of_each}"
    ax.set(title=f"from above: {wx:g} x {wy:g} mm, {bins}", xlabel="x [mm]", ylabel="y [mm]")


def _draw_surface_above(ax: Axes, sensor: Sensor) -> None:
    """Draw the surfaces of a sensor, seen from above."""
    surfaces = sensor_solids(sensor).surfaces
    triangles = np.concatenate([surface.vertices[surface.triangles][:, :, :2] for surface in surfaces])
    ax.add_collection(PolyCollection(list(triangles), facecolors=OUTSIDE, edgecolors=OUTSIDE, linewidths=0.4))
    ax.add_patch(Rectangle((0, 0), 0, 0, fc=OUTSIDE, label=f"outer surface, a {sensor.shape.kind}"))


def _draw_side(ax: Axes, study: Study, cells: dict[str, PlannedCell], camera: Camera | None, crop) -> None:
    """Draw the cut at the middle of y, with the camera's rays up to the surface; it may lie below the drawing."""
    draw_cut(ax, study, sensor_solids(study.sensor), 0)
    depths = sorted({depth for cell in cells.values() for depth in cell.depths_mm})
    title = f"cut at the middle of y: {len(depths)} depths, {depths[0]:g} to {depths[-1]:g} mm"
    if camera:
        pinhole = np.array([camera.position_mm[0], camera.position_mm[2]])
        for x in camera_footprint(camera, crop)[:2, 0]:
            ax.plot([pinhole[0], x], [pinhole[1], 0], color=PREDICTED, lw=1.2, ls=(0, (5, 3)))
        ax.plot(*pinhole, "s", ms=8, color=PREDICTED)
        title += f"\ncamera at z = {camera.position_mm[2]:g} mm looks up"
    ax.set_title(title)
