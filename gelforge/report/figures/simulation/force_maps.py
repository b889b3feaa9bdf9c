"""Maps of the force distribution over the sensor's surface: one label, or predicted next to true."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from gelforge.report.figures.style import (
    CLOUD,
    PREDICTED,
    SIGNED,
    new_figure,
    signed_limit,
    styled,
    surface_axes,
)

AXES = ("x", "y", "z")


def draw_force_map(ax: Axes, bin_force, nx: int, ny: int, widths_mm: tuple[float, float], limit: float):
    """Draw one component (nx*ny,) of a label, bin k = nx iy + ix, from above, to limit; returns the colour mesh."""
    x = np.linspace(0, widths_mm[0], nx + 1)
    y = np.linspace(0, widths_mm[1], ny + 1)
    mesh = ax.pcolormesh(
        x, y, np.asarray(bin_force).reshape(ny, nx), cmap=SIGNED, vmin=-limit, vmax=limit, rasterized=True
    )
    surface_axes(ax, *widths_mm)
    return mesh


def total_text(bin_force_N: np.ndarray) -> str:
    """Return the sum of one component in words, to 1 mN and without a negative zero."""
    return f"total {round(float(bin_force_N.sum()), 3) + 0.0:+.3f} N"


def mark_ball(ax: Axes, position_mm, radius_mm: float) -> None:
    """Circle where the ball's cap meets the undeformed surface."""
    ax.add_patch(Circle(position_mm, max(radius_mm, 0.3), fill=False, ec="#333333", lw=0.9, ls=(0, (4, 2))))


def row_limits(*maps: np.ndarray) -> list[float]:
    """Return the colour limits [N] of x, y and z for maps (B, 3): x and y share one, z has its own."""
    horizontal = signed_limit(*(m[:, :2] for m in maps), floor=1e-4)
    return [horizontal, horizontal, signed_limit(*(m[:, 2] for m in maps), floor=1e-4)]


@styled
def prediction_figure(
    predicted_N: np.ndarray,
    true_N: np.ndarray,
    nx: int,
    ny: int,
    widths_mm: tuple[float, float],
    position_mm,
    contact_mm: float,
) -> Figure:
    """Return predicted, true, difference (columns) of labels (B, 3) per axis (rows), a row on one scale."""
    limits = row_limits(predicted_N, true_N)
    columns = {"predicted by the network": predicted_N, "true (FEM label)": true_N}
    columns["difference"] = predicted_N - true_N
    figure, axes = new_figure(8.2, 7.6, nrows=3, ncols=3, sharex=True, sharey=True)
    for row, axis in enumerate(AXES):
        for column, (title, force) in enumerate(columns.items()):
            ax = axes[row, column]
            mesh = draw_force_map(ax, 1e3 * force[:, row], nx, ny, widths_mm, 1e3 * limits[row])
            mark_ball(ax, position_mm, contact_mm)
            total = total_text(force[:, row])
            ax.set_title(f"{title}\n{total}" if row == 0 else total, fontsize=9)
        axes[row, 0].set_ylabel(f"$\\bf{{F_{axis}}}$    y [mm]")
        figure.colorbar(mesh, ax=list(axes[row]), label=f"$F_{axis}$ [mN per bin]", shrink=0.9, pad=0.01)
    for ax in axes[-1]:
        ax.set_xlabel("x [mm]")
    return figure


@styled
def total_force_figure(predicted_N: np.ndarray, true_N: np.ndarray) -> Figure:
    """Return predicted total force against the label's total, totals (N, 3), one panel per axis."""
    figure, axes = new_figure(8.2, 2.9, nrows=1, ncols=3)
    for ax, axis, predicted, true in zip(axes[0], AXES, predicted_N.T, true_N.T):
        low, high = min(predicted.min(), true.min()), max(predicted.max(), true.max())
        margin = 0.06 * max(high - low, 1e-3)
        ends = [low - margin, high + margin]
        ax.plot(ends, ends, "-", color="#999999", lw=1, label="perfect")
        ax.plot(true, predicted, alpha=0.5, color=PREDICTED, label="held-out image", **CLOUD)
        ax.set(xlim=ends, ylim=ends, aspect="equal")
        ax.set(xlabel=f"true total $F_{axis}$ [N]", ylabel=f"predicted $F_{axis}$ [N]")
        rms = np.sqrt(np.mean((predicted - true) ** 2))
        ax.set_title(f"rms error {rms:.3f} N", fontsize=9)
    axes[0, 0].legend(loc="upper left")
    return figure
