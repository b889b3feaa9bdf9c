"""The loss over steps."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from gelforge.report.figures.style import MEASURED, SIMULATED, new_figure, styled


@styled
def loss_figure(loss: pd.DataFrame) -> Figure:
    """Return training and validation loss over steps (columns step, training, validation), logarithmic."""
    figure, axes = new_figure(6.4, 3.0)
    ax = axes[0, 0]
    ax.plot(loss.step, loss.training, color=SIMULATED, lw=1.6, label="training rows")
    ax.plot(loss.step, loss.validation, color=MEASURED, lw=1.6, label="validation sites (never trained on)")
    ax.set(yscale="log", xlabel="optimiser step", ylabel="mean squared error\nof scaled outputs [-]")
    ax.grid(True, which="both")
    ax.legend()
    return figure
