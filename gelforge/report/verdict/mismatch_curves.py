"""A mismatch over depth and over time."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gelforge.report.figures.style import (
    ALLOWED,
    BAND_SIGMAS,
    CLOUD,
    INK,
    MEASURED,
    PUBLISHED,
    SIMULATED,
    Style,
    legend_entries,
    new_figure,
    signed_limit,
    styled,
)
from gelforge.report.verdict.mismatch_reader import LOADING, JudgedReadings, MismatchResults

BEFORE = {"color": PUBLISHED, "label": "simulated before"}
AFTER = {"color": SIMULATED, "label": "simulated after"}


@styled
def depth_figure(results: JudgedReadings) -> Figure:
    """Return force over depth and, below, what is left of it, at a few sites, for the axis that differs most."""
    axis, sites = results.strongest_axis, results.shown_sites()
    sign = -1.0 if axis == "z" else 1.0  # pressing is drawn upward
    grid: Style = {
        "nrows": 2,
        "ncols": len(sites),
        "sharex": True,
        "sharey": "row",
        "height_ratios": [1.5, 1],
    }
    figure, axes = new_figure(1.0 + 3.3 * len(sites), 4.9, **grid)
    for (upper, lower), (site, why) in zip(axes.T, sites):
        table, (about, distance) = results.readings, results.sites_about(site)
        at = table[table["site"] == site].iloc[0]
        table = table[table["site"].isin(about) & (table["axis"] == axis)].sort_values(
            "depth_mm", kind="stable"
        )
        loading = table[table["phase"].isin(LOADING)]
        means = (loading if len(loading) else table).groupby("depth_mm").mean(numeric_only=True)
        _simulated(upper, means, "base_N", "sigma_N", sign, BEFORE, "--")
        if results.has_after:
            _simulated(upper, means, "after_N", "after_sigma_N", sign, AFTER, "-")
        _measured(upper, table, sign * table["measured_N"], MEASURED, "measured")
        lower.axhline(0, color=INK, lw=0.8)
        band = BAND_SIGMAS * means["sigma_N"]
        lower.fill_between(
            means.index, -band, band, color=ALLOWED, lw=0, label="errors allowed for, ± 2 sigma"
        )
        _measured(lower, table, sign * table["before"], PUBLISHED, "measured − before")
        if results.has_after:
            _measured(lower, table, sign * table["after"], SIMULATED, "measured − after")
        more = "" if len(about) == 1 else f"\nand {len(about) - 1} sites up to {distance:.2g} mm from it"
        upper.set_title(f"({at['x_mm']:.3g}, {at['y_mm']:.3g}) mm: {why}{more}", fontsize=9.5)
        upper.grid(True)
        lower.set_xlabel("depth [mm]")
    name = "$-F_z$" if axis == "z" else f"$F_{axis}$"
    axes[0, 0].set_ylabel(f"{name} [N]")
    axes[1, 0].set_ylabel(f"difference in {name} [N]")
    shown = legend_entries(*axes[:, 0])
    figure.legend(shown.values(), shown, loc="outside lower center", ncols=3)
    return figure


def _simulated(
    ax: Axes, means: pd.DataFrame, column: str, sigma: str, sign: float, look: dict, line: str
) -> None:
    spread = means[sigma].fillna(means["sigma_N"])
    depth, force = np.concatenate([[0.0], means.index]), np.concatenate([[0.0], sign * means[column]])
    band = np.concatenate([[0.0], BAND_SIGMAS * spread])
    ax.fill_between(depth, force - band, force + band, color=look["color"], alpha=0.16, lw=0)
    ax.plot(depth, force, line, lw=1.8, **look)


def _measured(ax: Axes, table: pd.DataFrame, values: pd.Series, colour: str, label: str) -> None:
    """Draw readings, those during unloading hollow (the caption says so)."""
    down = table["phase"].isin(LOADING)
    style: Style = {"ms": 4, "mew": 0.9, "mec": colour, "ls": "none", "marker": "o", "zorder": 5}
    ax.plot(table["depth_mm"][down], values[down], mfc=colour, label=label, **style)
    if (~down).any():
        ax.plot(table["depth_mm"][~down], values[~down], mfc="white", **style)


@styled
def time_figure(results: MismatchResults) -> Figure:
    """Return measured minus simulated over the recording's time, a strip per axis on one scale; sessions side by side."""
    table, ends = _session_time(results.readings)
    figure, axes = new_figure(
        9.6, 0.9 + 1.25 * len(results.axes), nrows=len(results.axes), sharex=True, sharey=True
    )
    limit = 1.1 * signed_limit(table["before"], table["after"], 3 * table["sigma_N"].median())
    for ax, axis in zip(axes[:, 0], results.axes):
        rows = table[table["axis"] == axis]
        band = BAND_SIGMAS * float(rows["sigma_N"].median())
        ax.axhspan(-band, band, color=ALLOWED, lw=0, label="errors allowed for, ± 2 sigma (median)")
        ax.axhline(0, color=INK, lw=0.7)
        ax.plot(rows["minute"], rows["before"], color=PUBLISHED, label="before", alpha=0.75, **CLOUD)
        if results.has_after:
            ax.plot(rows["minute"], rows["after"], color=SIMULATED, label="after", alpha=0.75, **CLOUD)
        for _, start, _ in ends[1:]:
            ax.axvline(start, color="#BBBBBB", lw=0.9, ls=":")
        ax.set(ylim=(-limit, limit), ylabel=f"$F_{axis}$ [N]")
    if len(ends) > 1:
        above = axes[0, 0].get_xaxis_transform()
        for name, start, end in ends:
            axes[0, 0].text((start + end) / 2, 1.02, name, transform=above, ha="center")
    axes[-1, 0].set_xlabel("time of the recording [min]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _session_time(readings: pd.DataFrame) -> tuple[pd.DataFrame, list[tuple[str, float, float]]]:
    """Return readings with `minute`, sessions laid end to end with a small gap, and each session's ends."""
    length = readings.groupby("session")["time_s"].agg(lambda time: time.max() - time.min()).sum() / 60
    gap, at, ends, parts = 0.03 * max(length, 1e-6), 0.0, [], []
    for name, part in readings.groupby("session", sort=False):
        minute = (part["time_s"] - part["time_s"].min()) / 60 + at
        parts.append(part.assign(minute=minute))
        ends.append((str(name), at, float(minute.max())))
        at = float(minute.max()) + gap
    return pd.concat(parts), ends
