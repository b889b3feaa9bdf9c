"""The chapter about the error bars of the labels: what the mesh and the laws leave open of the forces."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.report.chapters.chapter import Chapter, count
from gelforge.report.chapters.results_reader import SIGMAS, StudyResults
from gelforge.report.figures.neighbours import depth_classes
from gelforge.report.figures.style import MEASURED, SIMULATED, new_figure, styled

WIDTH = 2.0  # standard deviations of a band
LOOKS = {"mesh": (SIMULATED, "o"), "constitutive models": (MEASURED, "s")}


def error_bars(results: StudyResults) -> Chapter:
    """Return the uncertainty of the simulated vertical forces by depth: of the mesh and of the constitutive models."""
    chapter = Chapter("sure", "Label uncertainty")
    if not results.study.mechanics.error_bars:
        chapter.say("No error bars: the study has mechanics.error_bars: false.")
        return chapter
    solved = [cell for cell in results.converged() if not cell.source]
    rows = results.label_errors
    if rows.empty:
        chapter.miss(
            "No error bars: no solved site holds any; sites made before they were stored are to be made again."
        )
        return chapter
    sites, place = results.sites_at("centre")
    if not sites:
        sites, place = solved[:1], f"({solved[0].x_mm:g}, {solved[0].y_mm:g}) mm"
    of_shown = rows[rows.cell.isin([site.source or site.name for site in sites])].sort_values("depth")
    words = (
        f"Left: the force at {place} with two standard deviations to each side, mesh and constitutive model together."
        " Right: each part over the force; the line is the median, the shade reaches from the least to the largest of"
        f" {count(rows.cell.nunique(), 'solved site')}. The mesh's is one share for all depths of a site."
    )
    unknown = sorted(set(results.study.materials) - _uncertain(results, solved[0]))
    if unknown:
        words += (
            f" How uncertain the constitutive models of {', '.join(unknown)} are is not known: they were"
            " given, and add nothing."
        )
    chapter.show(words, error_bar_figure(of_shown, rows, place))
    chapter.tabulate(
        "Standard deviation of the vertical force over the force, over all solved sites.", sigma_table(rows)
    )
    return chapter


def _uncertain(results: StudyResults, cell: PlannedCell) -> set[str]:
    """Return the materials whose constitutive models have a covariance, as the site's file says."""
    return {str(name) for name in results.cell_attributes[cell.name].get("uncertain_materials", ())}


def sigma_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return median and largest standard deviation of the mesh and of the constitutive models over Fz [%] by depth."""
    table = []
    depth, names = depth_classes(rows["depth"])
    for mean, at in rows.groupby(depth):
        found = {"depth [mm]": names[mean], "sites": at["cell"].nunique()}
        for name in SIGMAS:
            relative = 100 * at[name] / at["force"].abs()
            found |= {f"{name}, median [%]": relative.median(), f"{name}, largest [%]": relative.max()}
        table.append(found)
    return pd.DataFrame(table)


@styled
def error_bar_figure(cell: pd.DataFrame, rows: pd.DataFrame, place: str) -> Figure:
    """Return the force of one site with its band, and the parts of the band over the force in all sites."""
    figure, axes = new_figure(8.2, 3.3, ncols=2)
    left, right = axes[0]
    sigma = np.hypot(cell["mesh"], cell["constitutive models"])
    pooled = cell["cell"].nunique() > 1
    left.fill_between(
        cell["depth"],
        cell["force"] - WIDTH * sigma,
        cell["force"] + WIDTH * sigma,
        color=SIMULATED,
        alpha=0.3,
        lw=0,
        label="± 2 sigma, mesh and material",
    )
    left.plot(
        cell["depth"],
        cell["force"],
        "." if pooled else ".-",
        color=SIMULATED,
        ms=4,
        lw=0.8,
        label="this study: FEM",
    )
    left.set_ylabel("vertical force, $-F_z$ [N]")
    left.set_title(place)
    for name in SIGMAS:
        _relative(right, rows, name)
    right.set_ylabel("sigma of $F_z$ over $F_z$ [%]")
    right.set_title("all solved sites")
    for ax in (left, right):
        ax.set_xlabel("depth [mm]")
        ax.set_xlim(left=0)
        ax.set_ylim(bottom=0)
        ax.grid(True)
    left.legend(loc="upper left")
    right.legend(loc="best")
    return figure


def _relative(ax: Axes, rows: pd.DataFrame, name: str) -> None:
    """Draw one part over the force by depth: median, and from the least to the largest."""
    colour, marker = LOOKS[name]
    relative = (100 * rows[name] / rows["force"].abs()).groupby(depth_classes(rows["depth"])[0])
    depth = sorted(relative.groups)
    ax.fill_between(depth, relative.min(), relative.max(), color=colour, alpha=0.2, lw=0)
    ax.plot(depth, relative.median(), marker + "-", color=colour, ms=3.5, lw=1.4, label=f"{name}, median")
