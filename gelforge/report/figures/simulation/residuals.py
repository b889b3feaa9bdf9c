"""How simulated and measured total force differ over depth; over position the verdict's maps show it."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from gelforge.report.figures.neighbours import depth_classes
from gelforge.report.figures.style import CLOUD, INK, MEASURED, SIMULATED, new_figure, signed_limit, styled

AXES = ("x", "y", "z")


def residuals_N(agreement: pd.DataFrame) -> np.ndarray:
    """Return F/T minus FEM (N, 3) of an agreement table with ft_x_N.. and fem_x_N.., as the table rmse_gt does."""
    measured = agreement[[f"ft_{a}_N" for a in AXES]].to_numpy(float)
    return measured - agreement[[f"fem_{a}_N" for a in AXES]].to_numpy(float)


@styled
def residual_depth_figure(agreement: pd.DataFrame, resolution_N) -> Figure:
    """Return each indentation's residual over depth, the mean, and the band of the F/T resolution (3) [N]."""
    residual = residuals_N(agreement)
    depth = agreement["depth_mm"].to_numpy(float)
    level_of, names = depth_classes(agreement["depth_mm"])
    level_of, levels = level_of.to_numpy(), np.array(list(names))
    gap = np.diff(levels).min() if len(levels) > 1 else 0.25
    # so that presses do not hide each other
    jitter = np.random.default_rng(0).uniform(-0.12, 0.12, len(depth)) * gap
    figure, axes = new_figure(9.6, 3.1, nrows=1, ncols=3)
    for ax, axis, column, resolution in zip(axes[0], AXES, residual.T, resolution_N):
        ax.axhspan(-resolution, resolution, color="#EFEFEF", zorder=0, label="F/T resolution")
        ax.axhline(0, color=INK, lw=0.8)
        ax.plot(depth + jitter, column, alpha=0.55, color=MEASURED, label="one indentation", **CLOUD)
        mean = [column[level_of == level].mean() for level in levels]
        ax.plot(levels, mean, "o-", ms=4, lw=1.6, color=SIMULATED, label="mean")
        limit = 1.08 * max(signed_limit(column), 1.3 * resolution)
        ax.set(ylim=(-limit, limit), xlabel="depth [mm]")
        ax.set_title(f"$F_{axis}$, resolution ± {resolution:g} N")
    axes[0, 0].set_ylabel("F/T − FEM [N]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure
