"""The flow of untouched images, which is false, the flow of the indentations, and where the flow lost the surface."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from gelforge.recording.plausibility.images import MOST_LOST
from gelforge.report.chapters.chapter import Chapter, count
from gelforge.report.chapters.results_reader import StudyResults
from gelforge.report.figures.style import (
    FAINT,
    MOST_PANELS,
    MOST_POINTS,
    PREDICTED,
    SIMULATED,
    new_figure,
    styled,
)
from gelforge.robust import SIGMA_OF_MEDIAN


def flow_table(columns: dict[str, np.ndarray]) -> pd.DataFrame:
    """Return one row per image of a session: depth_mm (0 before contact), flow_px, lost (bool), press."""
    return pd.DataFrame(
        {
            "press": columns["press"],
            "depth_mm": np.where(columns["phase"] == "zero", 0.0, columns["depth_mm"]),
            "flow_px": columns["flow_px"].astype(float),
            "lost": columns["flow_lost"] > MOST_LOST,
        }
    )


def false_flow_px(table: pd.DataFrame) -> tuple[float, float]:
    """Return median and robust standard deviation [px] of the untouched images' flow; NaN without such images.

    An image that is the reference frame itself has none and does not count.
    """
    flow = table["flow_px"][(table["depth_mm"] == 0) & (table["flow_px"] > 0)]
    return float(flow.median()), float(SIGMA_OF_MEDIAN * (flow - flow.median()).abs().median())


def tell_flow_floor(chapter: Chapter, results: StudyResults) -> None:
    """Add false flow, noise floor and lost indentations of every session with images to a chapter."""
    tables = {
        name: flow_table(columns) for name, columns in results.features.items() if len(columns["press"])
    }
    if not tables:
        return
    for name, table in tables.items():
        false, spread = false_flow_px(table)
        if np.isfinite(false):
            chapter.say(
                f"Session {name}: images before contact move by {false:.2g} px (median of the root mean square over"
                " the image;"
                f" scatter {spread:.1g} px). This is noise; a smaller motion under load means nothing."
            )
        else:
            chapter.say(f"Session {name} has no image before contact, so that its false flow is not known.")
    lost = sum(table.loc[table["lost"], "press"].nunique() for table in tables.values())
    if lost:
        presses = sum(table["press"].nunique() for table in tables.values())
        chapter.say(
            f"In {lost:,} of {count(presses, 'indentation')} the flow does not fit the image on more than"
            f" {100 * MOST_LOST:g} % of the textured pixels (`flow_lost`). These images stay in the dataset, as their"
            " labels are right; the errors of the network in the chapters below include them."
        )
    chapter.show(
        "Flow of the images over depth. The line is the median of the untouched images, the band reaches to their largest.",
        floor_figure(tables),
    )


@styled
def floor_figure(tables: dict[str, pd.DataFrame]) -> Figure:
    """Return the flow of each image over depth next to the false flow, one panel per session."""
    shown = dict(list(tables.items())[:MOST_PANELS])
    least_px = 1e-3  # drawn at least: images without noise have no false flow
    figure, axes = new_figure(1.2 + 3.2 * len(shown), 2.9, ncols=len(shown), sharey=True)
    for ax, (name, table) in zip(axes[0], shown.items()):
        held = table[table["depth_mm"] > 0]
        held = held.iloc[:: -(-len(held) // MOST_POINTS) or 1]
        false, _ = false_flow_px(table)
        if np.isfinite(false):
            largest = table["flow_px"][table["depth_mm"] == 0].max()
            ax.axhspan(0, max(largest, least_px), color=FAINT, alpha=0.35, lw=0)
            ax.axhline(max(false, least_px), color="#777777", lw=1, label="untouched")
        kinds = (False, SIMULATED, "o", "pressed"), (True, PREDICTED, "x", "lost")
        for lost, colour, marker, label in kinds:
            part = held[held["lost"] == lost]
            if len(part):
                flow = part["flow_px"].clip(lower=least_px)
                ax.plot(part["depth_mm"], flow, marker, ms=3.5, color=colour, alpha=0.7, label=label)
        ax.set_yscale("log")
        ax.set_xlim(left=0)
        ax.set(title=name, xlabel="depth [mm]")
        ax.legend(loc="upper left")
    low = min(table["flow_px"].clip(lower=least_px).min() for table in shown.values())
    high = max(table["flow_px"].max() for table in shown.values())
    axes[0, 0].set_ylim(0.5 * low, 20 * max(high, least_px))  # room for the legends
    axes[0, 0].set_ylabel("flow, rms over the image [px]")
    return figure
