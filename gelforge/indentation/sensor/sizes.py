"""Sizes that cannot be meant: sensors and indenters in another unit than mm, and files with their origin off the body."""

from __future__ import annotations

import numpy as np

from gelforge import units
from gelforge.config import ConfigError, Indenter, IndenterPart, Sensor, Study
from gelforge.indentation.sensor.indenter_shapes import part_corners
from gelforge.mechanics.indenters.closed_surface import SurfaceError
from gelforge.mechanics.indenters.shapes import rotation_about_axes

# Length in mm of the units in which drawings are saved.
UNITS = {
    name: units.UNITS[unit][1]
    for name, unit in {"metres": "m", "inches": "in", "centimetres": "cm", "micrometres": "um"}.items()
}

# Drawings in other units and origins next to the body are asked about (tests/indentation/test_sizes.py):
SAME_RATIO = 0.05  # ratios of stated to found sizes this near a unit's are that unit's
# Wider side of a sensor [mm]: from a small fingertip to a forearm's skin. 4 and 320 mm pass, 32 mm taken for inches are 1.3
# or 810 mm and are asked about (tests/indentation/test_sizes.py).
SENSOR_MM = (3.0, 400.0)
# Height of the soft layers over the wider side, from a thin pad to a tall finger: 0.015 and 2.5 pass, a height in metres is
# asked about (tests/indentation/test_sizes.py).
FLATNESS = (1 / 200, 5.0)
# Wider horizontal side of a part of an indenter over that of the sensor: on one of 32 mm from a pin of 0.8 mm to a plate;
# bodies of 0.01 and 10 000 mm are asked about (tests/indentation/test_sizes.py).
INDENTER_SHARE = (1 / 40, 3.0)
# A surface may reach this far beyond the sensor's stated rectangle and height: files of five digits round 400 mm, the
# largest sensor, to 0.005 mm (what does not fit is refused: tests/indentation/test_shapes.py).
OUTSIDE_MM = 0.01


def check_sensor_size(sensor: Sensor) -> None:
    """Refuse a sensor of implausible size that is not confirmed, with the unit that was probably meant."""
    wide, high = max(sensor.width_x_mm, sensor.width_y_mm), sensor.height_mm
    if sensor.size_confirmed:
        return
    confirm = "or set sensor.size_confirmed: true if it is meant"
    if not SENSOR_MM[0] <= wide <= SENSOR_MM[1]:
        raise ConfigError(
            f"sensor: width_x_mm and width_y_mm are {sensor.width_x_mm:g} x {sensor.width_y_mm:g} mm, usual are "
            f"{SENSOR_MM[0]:g} to {SENSOR_MM[1]:g} mm{_likely(wide, SENSOR_MM, 'sizes')}; correct them, {confirm}"
        )
    if not FLATNESS[0] <= high / wide <= FLATNESS[1]:
        limits = (FLATNESS[0] * wide, FLATNESS[1] * wide)
        raise ConfigError(
            f"sensor: the layers' thickness_mm add up to {high:g} mm at a width of {wide:g} mm, usual are "
            f"{limits[0]:.3g} to {limits[1]:.3g} mm{_likely(high, limits, 'thicknesses')}; correct them, {confirm}"
        )


def check_fits(sensor: Sensor, low: np.ndarray, high: np.ndarray) -> None:
    """Refuse surfaces with bounds low, high (3,) [mm] that are not those of the sensor's description.

    Raises SurfaceError with the key that mends it: the files' unit, or the point that is the frame's origin.
    """
    shape, wide = sensor.shape, (sensor.width_x_mm, sensor.width_y_mm)
    extent = high[:2] - low[:2]
    ratio = np.array(wide) / np.maximum(extent, 1e-300)
    for unit, mm in {**UNITS, "mm": 1.0, "mm, 25.4 times too large": 1 / 25.4}.items():
        same = (np.abs(ratio * shape.mm_per_unit / mm - 1) < SAME_RATIO).all()
        if same and abs(mm / shape.mm_per_unit - 1) > SAME_RATIO:
            raise SurfaceError(
                f"the surfaces are {extent[0]:.4g} x {extent[1]:.4g} mm wide, the sensor {wide[0]:g} x {wide[1]:g} mm: are "
                f"the files in {unit}? set shape.mm_per_unit: {mm:.6g}, or correct width_x_mm and "
                "width_y_mm"
            )
    room = np.array([[0.0, 0.0, -np.inf], [*wide, 0.0]])
    within = (low >= room[0] - OUTSIDE_MM).all() and (high <= room[1] + OUTSIDE_MM).all()
    if within and high[2] >= -OUTSIDE_MM:
        return
    turned = rotation_about_axes(shape.orientation_deg).T @ [low[0], low[1], high[2]]
    origin = [round(float(value), 4) for value in np.array(shape.origin_mm) + turned]
    raise SurfaceError(
        f"the outer surface reaches from {np.round(low, 3)} to {np.round(high, 3)} mm; the sensor's frame wants x in "
        f"[0, {wide[0]:g}], y in [0, {wide[1]:g}] and its highest point at z = 0: set shape.origin_mm: {origin}, the corner "
        "below which all of it lies, or correct shape.orientation_deg, width_x_mm and width_y_mm"
    )


def check_indenter(study: Study) -> None:
    """Refuse parts of an indenter that are implausibly small or large, or whose file lies next to its own origin."""
    wide = max(study.sensor.width_x_mm, study.sensor.width_y_mm)
    least, most = INDENTER_SHARE
    limits = least * wide, most * wide
    for number, part in enumerate(study.indenter.shapes, start=1):
        name = f"indenter, part {number}" if study.indenter.parts else "indenter"
        corners = part_corners(part)
        size = np.ptp(corners[:, :2], axis=0).max()
        if not (part.size_confirmed or limits[0] <= size <= limits[1]):
            raise ConfigError(
                f"{name}: a body of {size:.3g} mm on a sensor of {wide:g} mm, usual are {limits[0]:.3g} to "
                f"{limits[1]:.3g} mm{_unit_remedy(part, size, limits)}; correct its size, or set size_confirmed: true if it "
                "is meant"
            )
        if part.kind == "mesh" and part.origin_mm is None:
            _check_over_origin(name, part, corners)


def indenter_words(indenter: Indenter) -> list[str]:
    """Return of each part of an indenter its extents [mm], and of a file where its lowest point is next to the position.

    Parameters
    ----------
    indenter : Indenter
        One shape, or parts with offsets [mm].

    Returns
    -------
    list of str
        A line for each part.
    """
    lines = []
    for part in indenter.shapes:
        corners = part_corners(part)
        extents = " x ".join(f"{size:.4g}" for size in np.ptp(corners, axis=0))
        x, y, _ = np.round(lowest_point(corners) + part.offset_mm, 3) + 0.0  # no minus zero
        lowest_at = f", lowest at ({x:g}, {y:g}) mm from the position" if part.kind == "mesh" else ""
        lines.append(f"{part.words}: {extents} mm{lowest_at}")
    return lines


def lowest_point(corners: np.ndarray) -> np.ndarray:
    """Return the middle (3,) of the lowest of corners (V, 3)."""
    low = corners[corners[:, 2] <= corners[:, 2].min() + 1e-6 * np.ptp(corners, axis=0).max()]
    return (low.min(axis=0) + low.max(axis=0)) / 2


def _check_over_origin(name: str, part: IndenterPart, corners: np.ndarray) -> None:
    """Refuse a body with corners (V, 3) that does not lie over its origin, where the position is."""
    if (corners[:, :2].min(axis=0) <= 0).all() and (corners[:, :2].max(axis=0) >= 0).all():
        return
    lowest = lowest_point(corners)
    in_file = [round(float(v), 4) for v in rotation_about_axes(part.orientation_deg).T @ lowest]
    raise ConfigError(
        f"{name}: the lowest point of {part.file} lies {np.hypot(*lowest[:2]):.3g} mm next to the position, which is under "
        f"the file's origin: set origin_mm: {in_file} to press with that point, or origin_mm: [0, 0, 0] if it is meant so"
    )


def _likely(size: float, limits: tuple[float, float], what: str) -> str:
    """Return the question about the unit that brings a size [mm] into its limits, or nothing."""
    for unit, factor in UNITS.items():
        if limits[0] <= factor * size <= limits[1]:
            return f"; are the {what} in {unit}? {size:g} of them are {factor * size:.4g} mm"
    return ""


def _unit_remedy(part: IndenterPart, size: float, limits: tuple[float, float]) -> str:
    """Return the question about the unit of a part's file or sizes."""
    if part.kind != "mesh":
        return _likely(size, limits, "sizes")
    for unit, mm in {"mm": 1.0, **UNITS}.items():
        if mm != part.mm_per_unit and limits[0] <= size / part.mm_per_unit * mm <= limits[1]:
            return f": is {part.file} in {unit}? set mm_per_unit: {mm:g}"
    return f" ({part.file}, mm_per_unit {part.mm_per_unit:g})"
