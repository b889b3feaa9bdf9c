"""A mismatch over the sensor's surface and through its body."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PatchCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from scipy.spatial import cKDTree

from gelforge.mismatch.result.verdict import Layer, Where
from gelforge.report.figures.style import (
    FAINT,
    INK,
    SIGNED,
    SIMULATED,
    new_figure,
    signed_limit,
    styled,
    surface_axes,
)
from gelforge.report.verdict.mismatch_reader import MismatchResults

CHANCES = 5  # bars of the headline
OTHER = "#9AA3AB"
NOTHING = "#009E73"  # as the page marks a verdict of consistent
FADED = 0.4  # opacity of a patch whose change is within two standard deviations


def pretty(name: str) -> str:
    """Return an effect's name as people write it."""
    return name.replace("_", " ")


def colour_limit(results: MismatchResults) -> float:
    """Return the limit [N] that all maps of a page share: at least what the errors of one reading can do (two sigma)."""
    noise = results.readings.groupby("axis")["sigma_N"].median().max()
    return signed_limit(results.site_means["before"], results.site_means["after"], floor=2 * float(noise))


def square_mm(sites: pd.DataFrame, width_mm: float) -> float:
    """Return the side of a site's square: neighbours of a grid nearly touch, a few far sites are still seen as squares."""
    at = sites[["x_mm", "y_mm"]].to_numpy(float)
    if len(at) == 1:
        return width_mm / 6
    nearest = cKDTree(at).query(at, k=2)[0][:, 1]
    return float(np.clip(0.94 * np.median(nearest), width_mm / 40, width_mm / 6))


def draw_residual_map(ax: Axes, results: MismatchResults, axis: str, column: str, limit: float):
    """Draw the mean residual (before or after) at each site, held-out sites framed; return what the bar belongs to."""
    sites = results.site_means[results.site_means["axis"] == axis]
    sites = sites.sort_values("held_out", kind="stable")  # frames lie on top
    sensor = results.verdict.sensor
    assert sensor is not None  # the chapter has looked
    side = square_mm(sites, sensor.width_x_mm)
    corners = sites[["x_mm", "y_mm"]].to_numpy(float) - side / 2
    shown = PatchCollection(
        [Rectangle(tuple(corner), side, side) for corner in corners],
        cmap=SIGNED,
        norm=Normalize(-limit, limit),
    )
    shown.set_array(sites[column].to_numpy())
    shown.set_edgecolor(np.where(sites["held_out"], INK, FAINT).tolist())
    shown.set_linewidth(np.where(sites["held_out"], 1.3, 0.4).tolist())
    ax.add_collection(shown)
    surface_axes(ax, sensor.width_x_mm, sensor.width_y_mm, labels=False)
    for where in results.verdict.where:
        _circle(ax, where)
    return shown


def _circle(ax: Axes, where: Where) -> None:
    if where.x_mm is not None and where.y_mm is not None and where.radius_mm is not None:
        circle = Circle((where.x_mm, where.y_mm), where.radius_mm, fill=False, ec=INK, lw=1.2, ls=(0, (4, 2)))
        ax.add_patch(circle)


def _error(results: MismatchResults, axis: str, column: str) -> str:
    score = results.verdict.fit.before if column == "before" else results.verdict.fit.after
    value = score.rmse_N["xyz".index(axis)] if score else None
    return "" if value is None else f"error {value:.3f} N rms"


@styled
def headline_figure(results: MismatchResults) -> Figure:
    """Return the strongest axis before and after on one scale, and the chances of what is missing."""
    axis, columns = results.strongest_axis, ["before", "after"] if results.has_after else ["before"]
    maps = len(columns) if results.verdict.sensor else 0
    figure, axes = new_figure(
        3.1 * maps + 4.2, 3.1, nrows=1, ncols=maps + 1, width_ratios=[1.0] * maps + [1.25]
    )
    limit = colour_limit(results)
    for ax, column in zip(axes[0, :maps], columns):
        shown = draw_residual_map(ax, results, axis, column, limit)
        ax.set_title(f"$F_{axis}$ {column}: {_error(results, axis, column)}", fontsize=10)
        ax.set_xlabel("x [mm]")
    if maps:
        axes[0, 0].set_ylabel("y [mm]")
        figure.colorbar(shown, ax=list(axes[0, :maps]), label="measured − simulated [N]", shrink=0.85)
    draw_chances(axes[0, -1], results)
    return figure


def draw_chances(ax: Axes, results: MismatchResults) -> None:
    """Draw the probability of the first few effects, of a discrepancy and of nothing; the answer's members in blue."""
    verdict = results.verdict
    members = {name for group in verdict.answer for name in group.names}
    bars = [
        (pretty(e.name), e.probability, SIMULATED if e.name in members else OTHER)
        for e in verdict.effects[:CHANCES]
    ]
    if verdict.unknown is not None:
        colour = SIMULATED if verdict.state in ("unexplained", "modelled") else OTHER
        bars.append(("no known effect", verdict.unknown.probability, colour))
    nothing = NOTHING if verdict.state == "consistent" else OTHER
    bars.append(("nothing is missing", verdict.null_probability, nothing))
    for row, (_, chance, colour) in enumerate(bars):
        ax.barh(row, chance, color=colour, height=0.62)
        ax.text(chance + 0.02, row, chance_text(chance), va="center", fontsize=9)
    ax.set_yticks(range(len(bars)), [name for name, *_ in bars], fontsize=9.5)
    ax.set_xticks([0, 0.5, 1], ["0 %", "50 %", "100 %"])
    ax.set_xlim(0, 1.22)
    ax.tick_params(axis="y", length=0)
    ax.invert_yaxis()
    ax.spines["left"].set_visible(False)
    ax.set_title("probability that it is missing", fontsize=10)


def chance_text(chance: float) -> str:
    """Return a probability as people read it: never a bare 0 or 1."""
    if chance < 0.01:
        return "< 1 %" if chance < 0.005 else "1 %"
    return "> 99 %" if chance > 0.995 else f"{100 * chance:.0f} %"


@styled
def residual_maps_figure(results: MismatchResults) -> Figure:
    """Return measured minus simulated at each site, before and after (rows) per axis (columns), all on one scale."""
    columns = ["before", "after"] if results.has_after else ["before"]
    figure, axes = new_figure(
        1.8 + 2.7 * len(results.axes),
        0.5 + 2.75 * len(columns),
        nrows=len(columns),
        ncols=len(results.axes),
        sharex=True,
        sharey=True,
    )
    limit = colour_limit(results)
    for row, column in zip(axes, columns):
        for ax, axis in zip(row, results.axes):
            shown = draw_residual_map(ax, results, axis, column, limit)
            ax.set_title(f"$F_{axis}$ {column}: {_error(results, axis, column)}", fontsize=9)
        row[0].set_ylabel(f"{column}    y [mm]", fontweight="bold" if column == "after" else None)
    for ax in axes[-1]:
        ax.set_xlabel("x [mm]")
    figure.colorbar(shown, ax=list(axes.ravel()), label="measured − simulated [N]", shrink=0.8)
    return figure


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
        x, y = np.sort(level["x_mm"].unique()), np.sort(level["y_mm"].unique())
        change = level.pivot(index="y_mm", columns="x_mm", values="change").to_numpy()
        sigma = level.pivot(index="y_mm", columns="x_mm", values="sigma").to_numpy()
        edges = _edges(x), _edges(y)
        shown = ax.pcolormesh(*edges, 100 * change, cmap=SIGNED, vmin=-limit, vmax=limit, ec="white", lw=0.6)
        known = np.abs(change) > 2 * sigma
        shown.set_alpha(np.where(known, 1.0, FADED))
        for j, i in zip(*np.nonzero(known)):
            corners_x, corners_y = edges[0][[i, i + 1, i + 1, i, i]], edges[1][[j, j, j + 1, j + 1, j]]
            ax.plot(corners_x, corners_y, "-", color=INK, lw=1.3)
        if sensor:
            surface_axes(ax, sensor.width_x_mm, sensor.width_y_mm, labels=False)
        for where in results.verdict.where:
            _circle(ax, where)
        ax.set_title(f"{_layer_at(layers, z)}, {abs(z):.2g} mm below the top", fontsize=9)
        ax.set_xlabel("x [mm]")
    axes[0, 0].set_ylabel("y [mm]")
    figure.colorbar(
        ScalarMappable(Normalize(-limit, limit), SIGNED),
        ax=list(axes[0]),
        label="change of the modulus [%]",
        shrink=0.85,
    )
    return figure


def _layer_at(layers: list[Layer], z_mm: float) -> str:
    return next((layer.name for layer in layers if layer.z_mm[0] <= z_mm <= layer.z_mm[1]), "body")


def _edges(centres: np.ndarray) -> np.ndarray:
    """Return the edges (n+1,) of patches with these centres (n,)."""
    if len(centres) == 1:
        return centres[0] + np.array([-1.0, 1.0])
    between = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - between[0]], between, [2 * centres[-1] - between[-1]]])


def known_patches(patches: pd.DataFrame) -> int:
    """Return how many patches of a body map are beyond two standard deviations."""
    return int((patches["change"].abs() > 2 * patches["sigma"]).sum())
