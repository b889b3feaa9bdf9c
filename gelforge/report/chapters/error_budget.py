"""How much of the network's error is optics, learning and mechanics: in a sentence and a figure."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from gelforge.learning.judging.error_budget import AGAINST_TRUTH, LEARNING, MECHANICS, OPTICS, PARTS
from gelforge.report.chapters.chapter import Chapter, millinewtons, newtons
from gelforge.report.chapters.results_reader import StudyResults
from gelforge.report.figures.style import FAINT, MEASURED, PREDICTED, PUBLISHED, SIMULATED, new_figure, styled

BARS = {  # part: words of its bar, colour
    OPTICS: ("optics\nflow against true motion", MEASURED),
    LEARNING: ("learning\nnetwork against labels, less optics", PREDICTED),
    MECHANICS: ("mechanics\nlabels against true force", SIMULATED),
    AGAINST_TRUTH: ("whole error\nnetwork against true force", PUBLISHED),
}
PANELS = (  # column, title, unit and how many of it a newton is, number with its unit
    ("bins_z_N", "force of a pressed bin", "mN", 1e3, millinewtons),
    ("total_z_N", "total force", "N", 1.0, newtons),
)
REMEDIES = {
    OPTICS: "a sharper or nearer camera or a finer flow (features.flow_preset)",
    LEARNING: "more sites",
    MECHANICS: "better material tests, a verdict (gelforge mismatch) or gains fitted to readings (gelforge adapt)",
}


def tell_budget(chapter: Chapter, results: StudyResults) -> None:
    """Add the parts of the network's error to a chapter, or why they are not known."""
    table = results.table("error_budget")
    if table is None and results.study.virtual_lab is None:
        chapter.say(
            "How much of the error is optics, learning and mechanics is not known: that needs recordings whose true forces"
            " and motion are known, as a virtual lab's."
        )
    elif table is None:
        path = results.folder / "tables" / "error_budget.csv"
        chapter.miss(
            f"No error budget: {path} is not there; the log of `evaluate` says why; indentations that follow a path have"
            " none."
        )
    elif table[PANELS[0][0]].notna().any():
        chapter.say(budget_words(table))
        chapter.show(
            "Where the error of the vertical force comes from, on held-out sites of the virtual sensor (SYNTHETIC), rms. The"
            " squares of optics and learning add to the square of the network's error against its labels; with mechanics"
            " they need not add to that of the whole, as parts may cancel or reinforce each other.",
            budget_figure(table),
        )


def budget_words(table: pd.DataFrame) -> str:
    """Return in a paragraph which part of the error is largest, and what would help."""
    parts = table.set_index("part")
    said: list[str] = []
    largest: list[str] = []
    for (column, *_, text), what in zip(PANELS, ("of a pressed bin", "in total")):
        (first, most), *others = parts.loc[list(PARTS), column].sort_values(ascending=False).items()
        rest = ", ".join(f"{name} {text(value)}" for name, value in others)
        total = text(parts.loc[AGAINST_TRUTH, column])
        said.append(f"{what} it is {total}, and the largest part is {first}: {text(most)} ({rest})")
        largest.append(first)
    optics, (bins, totals) = parts.loc[OPTICS], (REMEDIES[part] for part in largest)
    remedies = (
        f"the error of a pressed bin: {bins}; in total: {totals}" if bins != totals else f"both: {bins}"
    )
    return " ".join(
        [
            "The network's error against the true force of the virtual sensor (SYNTHETIC; vertical, rms): "
            f"{'; '.join(said)}.",
            f"The flow is off by {optics['flow_off_px']:.2g} px ({optics['flow_off_mm']:.2g} mm) where particles move by "
            f"{optics['flow_px']:.2g} px (rms over image regions).",
            f"What would lower {remedies}.",
        ]
    )


@styled
def budget_figure(table: pd.DataFrame) -> Figure:
    """Return bars of each part of the rms error of the vertical force: of bins [mN] and of the total [N], at one scale."""
    parts = table.set_index("part").loc[list(BARS)]
    limits = 1.15 * parts[[column for column, *_ in PANELS]].max().to_numpy(float)  # N
    limits = np.maximum(limits, 0.3 * limits.max())  # bars of small errors have room for their numbers
    # as many inches per newton
    figure, axes = new_figure(8.6, 2.6, ncols=2, sharey=True, width_ratios=limits)
    place, (words, colours) = np.arange(len(BARS))[::-1], zip(*BARS.values())
    for ax, (column, title, unit, scale, _), limit in zip(axes[0], PANELS, limits):
        bars = ax.barh(place, scale * parts[column], color=colours, height=0.7)
        ax.bar_label(bars, fmt="%.3g", padding=2)
        ax.axhline(0.5, color=FAINT, lw=0.8)
        ax.set_yticks(place, words)
        ax.set(title=title, xlim=(0, scale * limit), xlabel=f"rms error, vertical [{unit}]")
        ax.set_axisbelow(True)
        ax.grid(axis="x")
    return figure
