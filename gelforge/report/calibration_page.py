"""The page of a calibration: one offline HTML file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from gelforge.calibration.results import CALIBRATION
from gelforge.files import read_product_json
from gelforge.mismatch.result.verdict import PAGE
from gelforge.mismatch.result.verdict_tables import READINGS, read_table
from gelforge.report.chapters.chapter import Chapter, Facts
from gelforge.report.figures.style import SIGNED, Style, new_figure, styled
from gelforge.report.page import write_page
from gelforge.report.verdict.mismatch_curves import depth_figure
from gelforge.report.verdict.mismatch_reader import JudgedReadings

Content = dict[str, Any]


def write_calibration_page(folder: str | Path) -> Path:
    """Write the page of a calibration.

    Parameters
    ----------
    folder : str or Path
        Holds calibration.json and readings.csv.

    Returns
    -------
    Path
        report.html in the folder.
    """
    folder = Path(folder)
    content = read_product_json(folder / CALIBRATION, "run `gelforge calibrate` again")
    readings = read_table(folder, READINGS, content["tables"])
    assert readings is not None  # a calibration always writes it
    chapters = [in_short(content), curves(readings), residuals(readings), apart(content), origin(content)]
    head = {key: content[key] for key in ("title", "synthetic")}
    sentence = "; ".join(_value(one) for one in content["parameters"])
    return write_page(folder / PAGE, "calibration.html", chapters, sentence=sentence, **head)


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
    return chapter.add(Facts(facts))


def curves(readings: pd.DataFrame) -> Chapter:
    """Return force over depth before and after at a few sites, and what is left."""
    chapter = Chapter("curves", "Force over depth")
    return chapter.show(
        "Grey is the study at the priors' means (before), blue calibrated by all readings (after), orange the readings."
        " Below are residuals. Bands are two standard deviations of the errors allowed for.",
        depth_figure(JudgedReadings(readings)),
    )


def residuals(readings: pd.DataFrame) -> Chapter:
    """Return what is left of the pressing force, site by site."""
    chapter = Chapter("sites", "Residuals by site")
    return chapter.show(
        "Mean of measured less simulated pressing force over its size [%], before and after, each on its own scale."
        " A pattern over the sensor says that something with a place is missing.",
        site_figure(readings),
    )


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
        look: Style = {"s": 70, "cmap": SIGNED, "vmin": -limit, "vmax": limit, "edgecolors": "#888"}
        drawn = ax.scatter(place["x_mm"], place["y_mm"], c=share, **look)
        figure.colorbar(drawn, ax=ax, label="residual of $F_z$ [%]")
        ax.set(title=name, xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
        ax.margins(0.2)
    return figure


def apart(content: Content) -> Chapter:
    """Return the correlations of the parameters."""
    chapter, correlation = Chapter("apart", "Which parameters can be distinguished"), content["correlation"]
    table = pd.DataFrame(np.round(correlation["matrix"], 3), columns=correlation["names"])
    table.insert(0, "parameter", correlation["names"])
    return chapter.tabulate(
        "Correlation of the errors of two parameters; ±1: the presses see one combination of them alone.",
        table,
    )


def origin(content: Content) -> Chapter:
    """Return what the calibration rests on."""
    chapter, made = Chapter("origin", "What this rests on"), content["provenance"]
    kind = "SYNTHETIC: made by a virtual lab or another solver" if content["synthetic"] else "recorded"
    facts = [("Readings", kind), ("Start", made["base"]), ("SHA-256 of the start", made["base_sha256"])]
    facts += [(f"Prior of {one['name']}", one["prior"]["source"]) for one in content["parameters"]]
    facts += [(f"SHA-256 of session {name}", value) for name, value in made["sessions"].items()]
    facts.append(("Seed of what is held out", str(made["seed"])))
    facts += [("Versions", ", ".join(f"{name} {version}" for name, version in made["versions"].items()))]
    chapter.add(Facts(facts))
    for sentence in content["cannot_know"]:
        chapter.say(sentence)
    return chapter
