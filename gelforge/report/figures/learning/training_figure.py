"""The loss over epochs."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from gelforge.report.figures.style import MEASURED, SIMULATED, new_figure, styled


@styled
def loss_figure(loss: pd.DataFrame) -> Figure:
    """Return training and validation loss over epochs (columns epoch, training, validation), logarithmic."""
    figure, axes = new_figure(6.4, 3.0)
    ax = axes[0, 0]
    ax.plot(loss.epoch, loss.training, color=SIMULATED, lw=1.6, label="training rows")
    ax.plot(loss.epoch, loss.validation, color=MEASURED, lw=1.6, label="validation sites (never trained on)")
    best = loss.loc[loss.validation.idxmin()]
    ax.plot([best.epoch], [best.validation], "o", color=MEASURED, mec="#7A5200")
    ax.annotate(
        f"best: epoch {int(best.epoch)}",
        (best.epoch, best.validation),
        (0, 7),
        textcoords="offset points",
        ha="right" if best.epoch > loss.epoch.max() / 2 else "left",
    )
    ax.set_yscale("log")
    ax.set_xlabel("epoch")
    ax.set_ylabel("mean squared error\nof scaled outputs [-]")
    ax.grid(True, which="both")
    ax.legend()
    return figure
