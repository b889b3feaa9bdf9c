"""The network's error next to baselines, and by depth and place."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from gelforge.report.figures.style import MEASURED, SIMULATED, new_figure, styled


@styled
def errors_figure(baselines: pd.DataFrame, by: pd.DataFrame) -> Figure:
    """Return rms errors of the vertical force of pressed bins [mN]: of each predictor, and of the network by class."""
    figure, axes = new_figure(8.6, 3.4, ncols=2)
    left, right = axes[0]
    shown = baselines[baselines["predictor"] != "zero"].sort_values("RMSES_z_N", ascending=False)
    _bars(left, shown["predictor"], shown["RMSES_z_N"], shown["predictor"] == "network")
    left.set_title("all held-out sites")
    classes = by[by["by"].isin(["depth", "place", "session"])].iloc[::-1]
    kind = classes["by"].map({"depth": "depth ", "session": "session "}).fillna("")
    _bars(right, kind + classes["class"], classes["RMSES_z_N"], np.ones(len(classes), bool))
    right.set_title("the network by class")
    for ax in (left, right):
        ax.set_xlabel("RMSES of the vertical force [mN]")
        ax.set_xlim(left=0)
    return figure


def _bars(ax, names: pd.Series, errors: pd.Series, of_network: pd.Series | np.ndarray) -> None:
    colours = [SIMULATED if network else MEASURED for network in of_network]
    bars = ax.barh(np.arange(len(names)), 1e3 * errors, color=colours, height=0.7)
    ax.bar_label(bars, fmt="%.3g", padding=2, fontsize=7)
    ax.set_yticks(np.arange(len(names)), names, fontsize=7)
    ax.margins(x=0.12)
    ax.set_axisbelow(True)
    ax.grid(axis="x")
