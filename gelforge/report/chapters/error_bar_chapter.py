"""The chapter about the error bars of the labels: what the mesh and the laws leave open of the forces."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from gelforge.report.chapters.chapter import Chapter, count
from gelforge.report.chapters.results_reader import SIGMAS, StudyResults
from gelforge.report.figures.neighbours import depth_classes
from gelforge.report.figures.style import BAND_SIGMAS, SIMULATED, Style, new_figure, styled


def error_bars(results: StudyResults) -> Chapter:
    """Return the uncertainty of the simulated vertical forces by depth: of the mesh and of the constitutive models."""
    chapter = Chapter("sure", "Label uncertainty")
    if not results.study.mechanics.error_bars:
        return chapter.say("No error bars: the study has mechanics.error_bars: false.")
    solved = [cell for cell in results.converged() if not cell.source]
    rows = results.label_errors
    if rows.empty:
        return chapter.miss(
            "No error bars: no solved site holds any; sites made before they were stored are to be made again."
        )
    sites, place = results.sites_at("centre")
    if not sites:
        sites, place = solved[:1], f"({solved[0].x_mm:g}, {solved[0].y_mm:g}) mm"
    of_shown = rows[rows.cell.isin([site.source or site.name for site in sites])].sort_values("depth")
    words = (
        f"The force at {place} with two standard deviations to each side, mesh and constitutive model together."
        " The mesh's is one share for all depths of a site."
    )
    known = {str(name) for name in results.cell_attributes[solved[0].name].get("uncertain_materials", ())}
    unknown = sorted(set(results.study.materials) - known)
    if unknown:
        words += (
            f" How uncertain the constitutive models of {', '.join(unknown)} are is not known: they were"
            " given, and add nothing."
        )
    chapter.show(words, error_bar_figure(of_shown, place))
    return chapter.tabulate(
        f"Standard deviation of the vertical force over the force, of {count(rows.cell.nunique(), 'solved site')}.",
        sigma_table(rows),
    )


def sigma_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return median and largest standard deviation of the mesh and of the constitutive models over Fz [%] by depth."""
    table = []
    depth, names = depth_classes(rows["depth"])
    for mean, at in rows.groupby(depth):
        row = {"depth [mm]": names[mean], "sites": at["cell"].nunique()}
        for name in SIGMAS:
            relative = 100 * at[name] / at["force"].abs()
            row |= {f"{name}, median [%]": relative.median(), f"{name}, largest [%]": relative.max()}
        table.append(row)
    return pd.DataFrame(table)


@styled
def error_bar_figure(cell: pd.DataFrame, place: str) -> Figure:
    """Return the force of one site, or of several together, with its band."""
    figure, axes = new_figure(4.6, 3.3)
    ax = axes[0, 0]
    band = BAND_SIGMAS * np.hypot(cell["mesh"], cell["constitutive models"])
    pooled = cell["cell"].nunique() > 1
    edges = cell["force"] - band, cell["force"] + band
    words = "± 2 sigma, mesh and material"
    ax.fill_between(cell["depth"], *edges, color=SIMULATED, alpha=0.3, lw=0, label=words)
    look: Style = {"color": SIMULATED, "ms": 4, "lw": 0.8, "label": "this study: FEM"}
    ax.plot(cell["depth"], cell["force"], "." if pooled else ".-", **look)
    ax.set(ylabel="vertical force, $-F_z$ [N]", title=place, xlabel="depth [mm]")
    ax.set_xlim(left=0)
    ax.set_ylim(bottom=0)
    ax.grid(True)
    ax.legend(loc="upper left")
    return figure
