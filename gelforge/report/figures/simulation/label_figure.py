"""One label drawn: the force distribution of a site's depth or of a shard's row."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from matplotlib.figure import Figure

from gelforge.config import Sensor
from gelforge.files import read_product_json
from gelforge.hdf5 import opened
from gelforge.indentation.cells.cell_file import FORMAT as CELL_FORMAT
from gelforge.indentation.sensor.unrolled import place_in_bins
from gelforge.report.figures.simulation.force_maps import AXES, draw_force_map, row_limits, total_text
from gelforge.report.figures.style import INK, new_figure, styled


class LabelError(ValueError):
    """A file or row that holds no label: which, what was found, what is allowed."""


@dataclass(frozen=True)
class Label:
    """One force distribution (B, 3) with where it comes from."""

    bin_force_N: np.ndarray
    bins: tuple[int, int]
    widths_mm: tuple[float, float]
    position_mm: tuple[float, float]
    depth_mm: float
    title: str
    unrolled_mm: tuple[float, float] | None = None  # the position in a map that is not seen from above


def read_label(path: str | Path, row: int | None = None) -> Label:
    """Return the label of a site's depth (row; the deepest if None) or of a shard's row (the first if None)."""
    path = Path(path)
    with opened(
        path, None, f"name a site's file or a shard, or make it again (snakemake -R {path})", LabelError
    ) as file:
        if file.attrs.get("format") == CELL_FORMAT:
            return _cell_label(file, path, row)
        if "force_distribution_N" in file:
            return _shard_label(file, path, row)
        stated = file.attrs.get("format", "no format attribute")
    raise LabelError(
        f"{path}: neither a site ({CELL_FORMAT}) nor a shard (force_distribution_N); found {stated}"
    )


def _checked_row(path: Path, row: int | None, count: int, default: int) -> int:
    if count == 0:
        raise LabelError(
            f"{path}: holds no label (0 rows); a failed site keeps only the depths that converged"
        )
    row = default if row is None else row
    if not -count <= row < count:
        raise LabelError(f"{path}: row {row} of {count}; give 0 to {count - 1}")
    return row % count


def _cell_label(file: h5py.File, path: Path, row: int | None) -> Label:
    force = file["bin_force_N"]
    row = _checked_row(path, row, force.shape[0], force.shape[0] - 1)
    if "settings" not in file.attrs:  # interpolated by a version that did not write them
        raise LabelError(f"{path}: the sensor's settings are missing; make it again (snakemake -R {path})")
    sensor = json.loads(file.attrs["settings"])["sensor"]
    return Label(
        force[row],
        (sensor["bins"]["nx"], sensor["bins"]["ny"]),
        (sensor["width_x_mm"], sensor["width_y_mm"]),
        (float(file.attrs["x_mm"]), float(file.attrs["y_mm"])),
        float(file["depth_mm"][row]),
        f"site {file.attrs['cell']}",
        _unrolled(sensor, file.attrs["x_mm"], file.attrs["y_mm"]),
    )


def _unrolled(sensor: dict, x_mm: float, y_mm: float) -> tuple[float, float] | None:
    if sensor["bins"].get("over", "plan") == "plan":
        return None
    return place_in_bins(Sensor.model_validate(sensor), float(x_mm), float(y_mm))


def _sensor_of_dataset(shard: Path) -> dict:
    """Return the sensor's settings from the manifest next to a shard, which has the label but not the sensor's size."""
    manifest = shard.parent / "manifest.json"
    remedy = (
        f"it says how large the sensor of {shard.name} is: build the dataset again (snakemake -R {manifest})"
    )
    return read_product_json(manifest, remedy, LabelError)["settings"]["sensor"]


def _shard_label(file: h5py.File, path: Path, row: int | None) -> Label:
    force = file["force_distribution_N"]
    row = _checked_row(path, row, force.shape[0], 0)
    sensor = _sensor_of_dataset(path)
    names = []
    for key in ("cell", "session", "press", "image_index", "split"):
        value = file[key][row] if key in file else b""
        value = value.decode() if isinstance(value, bytes) else str(value)
        names.append(f"{key.replace('_index', '')} {value}" if value else "")
    names.append("untouched" if "untouched" in file and file["untouched"][row] else "")
    return Label(
        force[row],
        (sensor["bins"]["nx"], sensor["bins"]["ny"]),
        (sensor["width_x_mm"], sensor["width_y_mm"]),
        (float(file["position_mm"][row][0]), float(file["position_mm"][row][1])),
        float(file["depth_mm"][row]),
        f"{path.name} row {row}: " + ", ".join(name for name in names if name),
        _unrolled(sensor, *file["position_mm"][row]),
    )


@styled
def label_figure(path: str | Path, row: int | None = None) -> Figure:
    """Return three maps (x, y, z) of a label with totals.

    Parameters
    ----------
    path : str or Path
        A site's file or a shard.
    row : int, optional
        Number of a site's depth, by default the deepest, or of a shard's row, by default the first.

    Returns
    -------
    Figure
        Forces on the sensor [N per bin].

    Raises
    ------
    LabelError
        For another file, and a row that does not exist.
    """
    label = read_label(path, row)
    limits, along = row_limits(label.bin_force_N), " along the surface" if label.unrolled_mm else ""
    figure, axes = new_figure(10.2, 4.2, nrows=1, ncols=3)
    for ax, axis, force, limit in zip(axes[0], AXES, label.bin_force_N.T, limits):
        mesh = draw_force_map(ax, force, *label.bins, label.widths_mm, limit)
        ax.set(title=f"$F_{axis}$  {total_text(force)}", xlabel=f"x{along} [mm]")
        if label.depth_mm > 0:
            ax.plot(*(label.unrolled_mm or label.position_mm), "+", color=INK, ms=7)
        figure.colorbar(mesh, ax=ax, label="[N per bin]", shrink=0.72, orientation="horizontal", pad=0.03)
    axes[0, 0].set_ylabel(f"y{along} [mm]")
    where = f"at ({label.position_mm[0]:g}, {label.position_mm[1]:g}) mm, {label.depth_mm:g} mm deep"
    view = "surface unrolled" if label.unrolled_mm else "seen from above, z towards the viewer"
    figure.suptitle(f"{label.title}\nforce on the sensor {where}, {view}", fontsize=10)
    return figure
