"""A mismatch over the sensor's surface and through its body."""

from __future__ import annotations

from itertools import product

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PatchCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from scipy.spatial import cKDTree

from gelforge.mismatch.result.verdict import Where
from gelforge.report.figures.style import FAINT, INK, SIGNED, new_figure, signed_limit, styled, surface_axes
from gelforge.report.verdict.mismatch_reader import SIGMA, MismatchResults

ORDER = "zxy"  # of the rows: pressing first, the sideways axes with their own scale below
UNITS = {"": "N", SIGMA: "σ"}  # of a column's ending


def square_mm(sites: pd.DataFrame, width_mm: float) -> float:
    """Return the side of a site's square: neighbours of a grid nearly touch, a few far sites are still seen as squares."""
    at = sites[["x_mm", "y_mm"]].to_numpy(float)
    if len(at) == 1:
        return width_mm / 6
    nearest = cKDTree(at).query(at, k=2)[0][:, 1]
    return float(np.clip(0.94 * np.median(nearest), width_mm / 40, width_mm / 6))


def draw_squares(
    ax: Axes, at: np.ndarray, sides: tuple[float, float], values: np.ndarray, scale: tuple, framed: np.ndarray
) -> PatchCollection:
    """Draw values (n,) as rectangles about at (n, 2), some in a dark frame; scale: colour map, lowest, highest."""
    cmap, low, high = scale
    corners = at - np.divide(sides, 2)
    shown = PatchCollection(
        [Rectangle((x, y), *sides) for x, y in corners], cmap=cmap, norm=Normalize(low, high)
    )
    shown.set_array(values)
    shown.set_edgecolor(np.where(framed, INK, FAINT).tolist())
    shown.set_linewidth(np.where(framed, 1.3, 0.4).tolist())
    ax.add_collection(shown)
    return shown


def draw_residual_map(
    ax: Axes, results: MismatchResults, axis: str, column: str, limit: float
) -> PatchCollection:
    """Draw a column of the sites' means, held-out sites framed; return what the colour bar belongs to."""
    sites = results.site_means[results.site_means["axis"] == axis]
    sites = sites.sort_values("held_out", kind="stable")  # frames lie on top
    sensor = results.verdict.sensor
    assert sensor is not None  # the chapter has looked
    side, at = square_mm(sites, sensor.width_x_mm), sites[["x_mm", "y_mm"]].to_numpy(float)
    values, framed = sites[column].to_numpy(), sites["held_out"].to_numpy(bool)
    shown = draw_squares(ax, at, (side, side), values, (SIGNED, -limit, limit), framed)
    surface_axes(ax, sensor.width_x_mm, sensor.width_y_mm)
    for where in results.verdict.where:
        _circle(ax, where)
    return shown


def _circle(ax: Axes, where: Where) -> None:
    if where.x_mm is not None and where.y_mm is not None and where.radius_mm is not None:
        circle = Circle((where.x_mm, where.y_mm), where.radius_mm, fill=False, ec=INK, lw=1.2, ls=(0, (4, 2)))
        ax.add_patch(circle)


@styled
def before_after_figure(results: MismatchResults) -> Figure:
    """Return measured minus simulated at each site, before and after: an axis per row, in newtons and then in sigma.

    Newtons have a scale for pressing and one for the sideways axes, sigma has one.
    """
    axes_read = [axis for axis in ORDER if axis in results.axes]
    states = ["before", "after"] if results.has_after else ["before"]
    columns = [f"{state}{ending}" for ending in UNITS for state in states]
    figure, axes = new_figure(
        2.0 + 1.9 * len(columns),
        0.5 + 1.95 * len(axes_read),
        nrows=len(axes_read),
        ncols=len(columns),
        sharex=True,
        sharey=True,
    )
    for ending, same in (("", "z"), ("", "xy"), (SIGMA, ORDER)):
        rows, drawn = [axis for axis in axes_read if axis in same], []
        for axis, state in product(rows, states):
            column = state + ending
            ax = axes[axes_read.index(axis), columns.index(column)]
            shown = draw_residual_map(ax, results, axis, column, colour_limit(results, rows, ending))
            ax.set_title(f"$F_{axis}$ {state}: {results.size(axis, column):.2g} {UNITS[ending]}")
            drawn.append(ax)
        if rows:
            bar = figure.colorbar(shown, ax=drawn, aspect=12 * len(rows))
            bar.ax.set_title(UNITS[ending])
    for ax in axes[:, 0]:
        ax.set_ylabel("y [mm]")
    for ax in axes[-1]:
        ax.set_xlabel("x [mm]")
    return figure


def colour_limit(results: MismatchResults, axes: list[str], ending: str) -> float:
    """Return the limit that maps of some axes share: at least what the errors of one reading can do (two sigma)."""
    sites, readings = (table[table["axis"].isin(axes)] for table in (results.site_means, results.readings))
    noise = 1.0 if ending else float(readings.groupby("axis")["sigma_N"].median().max())
    return signed_limit(sites[f"before{ending}"], sites[f"after{ending}"], floor=2 * noise)


@styled
def body_map_figure(results: MismatchResults) -> Figure:
    """Return the modulus's change through the body, top level first; patches beyond two sigma are framed, others faded."""
    patches = results.body_map
    assert patches is not None  # the chapter has looked
    levels = sorted(patches["z_mm"].unique(), reverse=True)
    limit = signed_limit(100 * patches["change"], floor=1.0)
    figure, axes = new_figure(
        1.1 + 2.8 * len(levels), 3.1, nrows=1, ncols=len(levels), sharex=True, sharey=True
    )
    sensor = results.verdict.sensor
    layers = sensor.layers if sensor else []
    for ax, z in zip(axes[0], levels):
        level = patches[patches["z_mm"] == z]
        at, known = level[["x_mm", "y_mm"]].to_numpy(float), is_known(level).to_numpy()
        scale = (SIGNED, -limit, limit)
        shown = draw_squares(ax, at, spacing(at), 100 * level["change"].to_numpy(), scale, known)
        shown.set_alpha(np.where(known, 1.0, 0.4).tolist())
        if sensor:
            surface_axes(ax, sensor.width_x_mm, sensor.width_y_mm)
        for where in results.verdict.where:
            _circle(ax, where)
        layer = next((one.name for one in layers if one.z_mm[0] <= z <= one.z_mm[1]), "body")
        ax.set_title(f"{layer}, {abs(z):.2g} mm below the top", fontsize=9)
        ax.set_xlabel("x [mm]")
    axes[0, 0].set_ylabel("y [mm]")
    bar = ScalarMappable(Normalize(-limit, limit), SIGNED)  # of full opacity
    figure.colorbar(bar, ax=list(axes[0]), label="change of the modulus [%]", shrink=0.85)
    return figure


def spacing(at: np.ndarray) -> tuple[float, float]:
    """Return the distances of neighbours along both axes of a grid (n, 2); 1 along an axis with one."""
    unique = [np.unique(values) for values in at.T]
    first, second = (float(np.diff(values).min()) if len(values) > 1 else 1.0 for values in unique)
    return first, second


def is_known(patches: pd.DataFrame) -> pd.Series:
    """Return which patches of a body map are beyond two standard deviations."""
    return patches["change"].abs() > 2 * patches["sigma"]
