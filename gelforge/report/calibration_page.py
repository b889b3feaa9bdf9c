"""The page of a calibration: one offline HTML file."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.figure import Figure

import gelforge
from gelforge.calibration.results import CALIBRATION
from gelforge.files import read_product_json, write_text
from gelforge.mismatch.result.verdict import PAGE
from gelforge.mismatch.result.verdict_tables import READINGS, read_table
from gelforge.report.chapters.chapter import Chapter, Facts
from gelforge.report.figures.style import MEASURED, PUBLISHED, SIGNED, SIMULATED, new_figure, styled
from gelforge.report.page import environment

MOST_CURVES = 4  # sites that are drawn
Content = dict[str, Any]


def write_calibration_page(folder: str | Path, written: datetime | None = None) -> Path:
    """Write report.html beside calibration.json and readings.csv in a folder; return its path."""
    folder = Path(folder)
    content = read_product_json(folder / CALIBRATION, "run `gelforge calibrate` again")
    readings = read_table(folder, READINGS, content["tables"])
    assert readings is not None  # a calibration always writes it
    chapters = [in_short(content), curves(readings), residuals(readings), apart(content), origin(content)]
    templates = environment()
    html = templates.get_template("calibration.html").render(
        title=content["title"],
        synthetic=content["synthetic"],
        sentence="; ".join(_value(one) for one in content["parameters"]),
        chapters=chapters,
        style=Markup(templates.get_template("report.css").render()),
        version=gelforge.__version__,
        written=(written or datetime.now(UTC)).strftime("%Y-%m-%d %H:%M UTC"),
    )
    write_text(folder / PAGE, html)
    return folder / PAGE


def _value(one: Content) -> str:
    unit = "" if one["unit"] == "1" else f" {one['unit']}"
    return f"{one['name']} {one['value']:.3g}{unit} ({_range(one['interval_90'])})"


def _range(ends: list[float]) -> str:
    return f"{ends[0]:.3g} to {ends[1]:.3g}"


def in_short(content: Content) -> Chapter:
    """Return the parameters before and after, the held-out error, and what must be known of them."""
    chapter, held = Chapter("short", "In short"), content["held_out"]
    rows = [
        {
            "parameter": one["name"],
            "what": one["words"],
            "unit": one["unit"],
            "before": _range(one["prior"]["interval_90"]),
            "calibrated": f"{one['value']:.4g}",
            "90 % interval": _range(one["interval_90"]),
            "spread over the prior's": one["posterior_over_prior"],
        }
        for one in content["parameters"]
    ]
    chapter.tabulate(
        "Parameters. Ranges hold 90 %; a spread near the prior's says that the presses leave it open.",
        pd.DataFrame(rows),
    )
    for sentence in content["sentences"]:
        chapter.say(sentence)
    facts = [("Presses", f"{content['presses']}, at {held['of_sites']} sites")]
    facts += [
        (
            f"F{axis} of {held['readings']} readings held out ({held['block']})",
            f"{before:.3g} N off before, {held['after_N'][axis]:.3g} N after; the force is {held['force_N'][axis]:.3g} N"
            " (rms)",
        )
        for axis, before in held["before_N"].items()
    ]
    facts.append(("By chance as much is left", f"p = {content['p']:.2g}"))
    chapter.blocks.append(Facts(facts))
    return chapter


def curves(readings: pd.DataFrame) -> Chapter:
    """Return force over depth before and after at a few sites, and what is left."""
    chapter = Chapter("curves", "Force over depth")
    chapter.show(
        "Readings, the study at the priors' means (before), and calibrated by all readings (after); below, residuals"
        " with the errors allowed for (two standard deviations).",
        curve_figure(readings),
    )
    return chapter


@styled
def curve_figure(readings: pd.DataFrame) -> Figure:
    """Return -Fz over depth and what is left of it, at sites far apart."""
    table = readings[readings["axis"] == "z"]
    sites = list(table["site"].unique())
    shown = sites[:: max(1, len(sites) // MOST_CURVES)][:MOST_CURVES]
    figure, axes = new_figure(
        1.0 + 3.2 * len(shown), 4.8, nrows=2, ncols=len(shown), sharex=True, sharey="row"
    )
    for (upper, lower), site in zip(axes.T, shown):
        own = table[table["site"] == site].sort_values("depth_mm")
        depth, measured = own["depth_mm"], own["measured_N"]
        means = own.groupby("depth_mm")[["base_N", "after_N", "sigma_N"]].mean()
        for name, colour, line, label in (
            ("base_N", PUBLISHED, "--", "before"),
            ("after_N", SIMULATED, "-", "after"),
        ):
            force = np.concatenate([[0.0], -means[name]])
            upper.plot([0.0, *means.index], force, line, color=colour, label=label)
            lower.plot(
                depth, own[name] - measured, "o", ms=3, color=colour, label=f"{label}: measured − simulated"
            )
        upper.plot(depth, -measured, "o", ms=4, color=MEASURED, label="measured")
        band = 2 * means["sigma_N"]
        lower.fill_between(means.index, -band, band, color="#E6E6E6", lw=0, label="errors allowed for")
        held = " (held out)" if (own["held_out"] != "no").any() else ""
        upper.set_title(f"({own['x_mm'].iloc[0]:.3g}, {own['y_mm'].iloc[0]:.3g}) mm{held}", fontsize=9.5)
        lower.set_xlabel("depth [mm]")
    axes[0, 0].set_ylabel("$-F_z$ [N]")
    axes[1, 0].set_ylabel("residual of $-F_z$ [N]")
    handles = dict(zip(*axes[0, 0].get_legend_handles_labels()[::-1]))
    handles |= dict(zip(*axes[1, 0].get_legend_handles_labels()[::-1]))
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3)
    return figure


def residuals(readings: pd.DataFrame) -> Chapter:
    """Return what is left of the pressing force, site by site."""
    chapter = Chapter("sites", "Residuals by site")
    chapter.show(
        "Mean of measured less simulated pressing force over its size [%], before and after, each on its own scale."
        " A pattern over the sensor says that something with a place is missing.",
        site_figure(readings),
    )
    return chapter


@styled
def site_figure(readings: pd.DataFrame) -> Figure:
    """Return two maps of the relative residual of Fz by site, each on a scale of its own."""
    table = readings[readings["axis"] == "z"]
    by_site = table.groupby("site")
    place, force = by_site[["x_mm", "y_mm"]].first(), by_site["measured_N"].mean()
    figure, axes = new_figure(8.0, 3.6, ncols=2, sharex=True, sharey=True)
    left = {
        name: 100 * (force - by_site[column].mean()) / force
        for name, column in (("before", "base_N"), ("after", "after_N"))
    }
    for ax, (name, share) in zip(axes[0], left.items()):
        limit = max(float(share.abs().max()), 1e-6)
        drawn = ax.scatter(
            place["x_mm"],
            place["y_mm"],
            c=share,
            s=70,
            cmap=SIGNED,
            vmin=-limit,
            vmax=limit,
            edgecolors="#888",
        )
        figure.colorbar(drawn, ax=ax, label="residual of $F_z$ [%]")
        ax.set(title=name, xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
        ax.margins(0.2)
    return figure


def apart(content: Content) -> Chapter:
    """Return the correlations of the parameters."""
    chapter, found = Chapter("apart", "Which parameters can be distinguished"), content["correlation"]
    table = pd.DataFrame(np.round(found["matrix"], 3), columns=found["names"])
    table.insert(0, "parameter", found["names"])
    chapter.tabulate(
        "Correlation of the errors of two parameters; ±1: the presses see one combination of them alone.",
        table,
    )
    return chapter


def origin(content: Content) -> Chapter:
    """Return what the calibration rests on."""
    chapter, made = Chapter("origin", "What this rests on"), content["provenance"]
    kind = "SYNTHETIC: made by a virtual lab or another solver" if content["synthetic"] else "recorded"
    facts = [("Readings", kind), ("Start", made["base"]), ("SHA-256 of the start", made["base_sha256"])]
    facts += [(f"Prior of {one['name']}", one["prior"]["source"]) for one in content["parameters"]]
    facts += [(f"SHA-256 of session {name}", value) for name, value in made["sessions"].items()]
    facts.append(("Seed of what is held out", str(made["seed"])))
    facts += [("Versions", ", ".join(f"{name} {version}" for name, version in made["versions"].items()))]
    chapter.blocks.append(Facts(facts))
    for sentence in content["cannot_know"]:
        chapter.say(sentence)
    return chapter
