"""Vertical force over depth at the centre and the corner, next to the paper's published curves."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import cycle

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from gelforge.report.figures.style import (
    MEASURED,
    PUBLISHED,
    PUBLISHED_LINEAR,
    SIMULATED,
    VARIANTS,
    Style,
    legend_entries,
    new_figure,
    styled,
)

# error bars of the F/T readings in the figures of Sferrazza et al. 2019 (doi:10.1109/ACCESS.2019.2956882)
PAPER_RESOLUTION_N = 0.06


@dataclass(frozen=True)
class ForceDepth:
    """Vertical force on the sensor at one place: simulated (depth, Fz) and, where recorded, F/T readings."""

    title: str
    depth_mm: np.ndarray
    fem_N: np.ndarray
    ft_depth_mm: np.ndarray
    ft_N: np.ndarray
    published: pd.DataFrame | None  # depth_mm, fem_N, fem_linear_N, ft_sensor_N of this place
    variants: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)  # (depth, Fz) by name
    sites: int = 1  # that make the curve; several have no line through them


def deviation_table(curve: ForceDepth) -> pd.DataFrame | None:
    """Return simulated force next to the published FEM's, at the depths that both have, and the variants' forces.

    The deviation [%] is the study's from the published FEM; a variant that did not reach a depth has NaN there.
    """
    if curve.published is None:
        return None
    rows = []
    for row in curve.published.itertuples():
        force = _at_depth(row.depth_mm, curve.depth_mm, curve.fem_N)
        if np.isfinite(force):
            deviation = round(100 * (force / row.fem_N - 1), 1)
            varied = [_at_depth(row.depth_mm, *variant) for variant in curve.variants.values()]
            published = (row.fem_N, row.fem_linear_N)
            place = curve.title.partition(",")[0].partition(" (")[0]
            rows.append((place, row.depth_mm, *published, force, deviation, *varied))
    columns = ["place", "depth [mm]", "published FEM Fz [N]", "published linear FEM Fz [N]"]
    columns += ["simulated Fz [N]", "deviation [%]", *(f"variant {name} Fz [N]" for name in curve.variants)]
    return pd.DataFrame(rows, columns=columns)


def _at_depth(depth_mm: float, depths_mm: np.ndarray, forces_N: np.ndarray) -> float:
    """Return the force at a depth, NaN where the curve has no such point; depths are round numbers."""
    match = np.flatnonzero(np.abs(depths_mm - depth_mm) < 1e-6)
    return float(forces_N[match[0]]) if len(match) else np.nan


@styled
def force_depth_figure(curves: list[ForceDepth], resolution_N: float = PAPER_RESOLUTION_N) -> Figure:
    """Return one panel per place with -Fz over depth: ours, the study's F/T, the paper's three curves."""
    figure, axes = new_figure(4.1 * max(len(curves), 1), 3.5, nrows=1, ncols=len(curves), sharey=True)
    for ax, curve in zip(axes[0], curves):
        if curve.published is not None:
            table = curve.published
            ax.plot(table.depth_mm, -table.fem_N, "--", color=PUBLISHED, lw=1.4, label="paper: FEM")
            linear: Style = {"color": PUBLISHED_LINEAR, "lw": 1.8, "label": "paper: linear FEM"}
            ax.plot(table.depth_mm, -table.fem_linear_N, ":", **linear)
            bars: Style = {
                "fmt": "s",
                "ms": 3.5,
                "mfc": "white",
                "color": PUBLISHED,
                "elinewidth": 0.8,
                "capsize": 2,
            }
            words = "paper: F/T, ± resolution"
            ax.errorbar(table.depth_mm, -table.ft_sensor_N, PAPER_RESOLUTION_N, label=words, **bars)
        line = "o-" if curve.sites == 1 else "o"
        ax.plot(curve.depth_mm, -curve.fem_N, line, color=SIMULATED, ms=4, lw=2, label="this study: FEM")
        for (name, (depth_mm, fem_N)), (colour, marker) in zip(curve.variants.items(), cycle(VARIANTS)):
            style = {"ls": (0, (4, 1.5)), "ms": 4, "lw": 1.3, "mfc": "white"}
            ax.plot(depth_mm, -fem_N, marker=marker, color=colour, label=f"variant: {name}", **style)
        if len(curve.ft_N):
            bars = {
                "fmt": "D",
                "ms": 4,
                "color": MEASURED,
                "mec": "#7A5200",
                "mew": 0.6,
                "elinewidth": 1,
                "capsize": 2,
            }
            words = "this study: F/T, ± resolution"
            ax.errorbar(curve.ft_depth_mm, -curve.ft_N, resolution_N, label=words, **bars)
        ax.set(title=curve.title, xlabel="depth of the ball [mm]")
        ax.grid(True)
        ax.set_xlim(left=0)
    axes[0, 0].set_ylim(bottom=0)
    axes[0, 0].set_ylabel("vertical force, $-F_z$ [N]")
    shown = legend_entries(axes[0, -1], *axes[0])
    axes[0, 0].legend(shown.values(), shown, loc="upper left")
    return figure
