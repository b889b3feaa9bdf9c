"""The images' part of a verdict: what is left of the flow, region by region."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure

from gelforge.report.figures.style import MOST_PANELS, new_figure, styled
from gelforge.report.verdict.mismatch_maps import draw_squares, spacing
from gelforge.report.verdict.mismatch_reader import MismatchResults

SIZES = "Blues"  # sizes, white at none


@styled
def flow_residual_figure(results: MismatchResults) -> Figure:
    """Return the size of measured less simulated flow at the sites where it is largest, before and after, on one scale."""
    flow = results.flow
    assert flow is not None  # the chapter has looked
    columns = ["base", "after"] if flow["after_u_px"].notna().any() else ["base"]
    sites = [*flow.groupby(["x_mm", "y_mm"], sort=False)]
    sites = sorted(sites, key=lambda one: -float(np.sum(_left(one[1], "base") ** 2)))[:MOST_PANELS]
    left = {name: [_left(table, name) for _, table in sites] for name in columns}
    limit = max(float(np.percentile(np.hypot(*parts.T), 99)) for parts in left["base"])
    figure, axes = new_figure(
        1.3 + 1.9 * len(sites),
        0.7 + 2.1 * len(columns),
        nrows=len(columns),
        ncols=len(sites),
        sharex=True,
        sharey=True,
    )
    for row, name in zip(axes, columns):
        for ax, ((x, y), table), residual in zip(row, sites, left[name]):
            shown = _draw(ax, table, residual, limit)
            if name == "base":
                ax.set_title(f"({x:.3g}, {y:.3g}) mm, {table['depth_mm'].iloc[0]:.3g} mm deep", fontsize=8.5)
        row[0].set_ylabel(f"{'before' if name == 'base' else name}    v [px]")
    for ax in axes[-1]:
        ax.set_xlabel("u [px]")
    figure.colorbar(shown, ax=list(axes.ravel()), label="|measured − simulated| flow [px]", shrink=0.8)
    return figure


def _left(table: pd.DataFrame, name: str) -> np.ndarray:
    """Return measured less simulated flow (regions, 2) [px]."""
    return np.column_stack([table[f"measured_{axis}_px"] - table[f"{name}_{axis}_px"] for axis in "uv"])


def _draw(ax: Axes, table: pd.DataFrame, left: np.ndarray, limit: float) -> PatchCollection:
    """Draw the size of what is left; return what the colour bar belongs to."""
    at, none = table[["middle_u_px", "middle_v_px"]].to_numpy(float), np.zeros(len(table), bool)
    shown = draw_squares(ax, at, spacing(at), np.hypot(*left.T), (SIZES, 0, limit), none)
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.yaxis.set_inverted(True)  # v points down, as in the image
    return shown
