"""A material's tests and its laws: a panel per test with samples (thin), their mean and the models; residuals below."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gelforge.files import read_product_table
from gelforge.materials.basis.common_form import LOAD_CASE_OF
from gelforge.materials.characterise import MEAN
from gelforge.materials.fitting.law_file import MaterialLaw, read_law
from gelforge.mechanics.laws.homogeneous import LOAD_CASES, stress_points
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.report.figures.style import (
    INK,
    MEASURED,
    PREDICTED,
    PUBLISHED,
    PUBLISHED_LINEAR,
    SIMULATED,
    Style,
    new_figure,
    styled,
)

TITLES = {
    "uniaxial": "Uniaxial tension",
    "pure_shear": "Pure shear",
    "equibiaxial": "Equibiaxial tension",
    "biaxial": "Biaxial tension",
    "compression": "Compression",
    "simple_shear": "Simple shear",
}
BESIDE = {"compression", "simple_shear"}  # without a standard test next to them, its empty panels say nothing
# colour and line of each law but the chosen one
OTHER_LAWS = [
    *((PREDICTED, "--"), (PUBLISHED_LINEAR, "-."), ("#CC79A7", ":"), ("#56B4E9", "--"), ("#8C6D1F", "-.")),
    *(("#555555", ":"), (PREDICTED, (0, (6, 1.5, 1, 1.5, 1, 1.5)))),
]
MARKS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*")


@styled
def material_figure(
    law_json: str | Path, curves_csv: str | Path, others: Sequence[str | Path] = ()
) -> Figure:
    """Return Cauchy stress over stretch in the three load cases, one scale for all, as in the paper's fig. 4.

    Further kinds of test have panels of their own, and the only ones where no test is in tension. Below, the model minus the
    mean of the samples. R2 in the panels is that of the nominal stress, which was fitted.

    Parameters
    ----------
    law_json : str or Path
        The law's file.
    curves_csv : str or Path
        Curves of its tests, as `characterise` writes them.
    others : sequence of str or Path
        Law files of the same tests, drawn next to the law.

    Returns
    -------
    Figure
        Stresses in kPa.

    Raises
    ------
    LawFileError, FileError
        For a file that is missing, damaged or edited.
    """
    material = read_law(law_json)
    remedy = f"run the material stage again (snakemake -R {curves_csv})"
    curves = read_product_table(curves_csv, remedy, dtype={"sample": str, "test": str})
    compared = [read_law(path) for path in others]
    curves["kind"] = curves.test.str.split(" ").str[0]
    further = [k for k in TITLES if k not in LOAD_CASES and k in set(curves.kind)]
    standard = (
        () if set(further) <= BESIDE and further and not set(LOAD_CASES) & set(curves.kind) else LOAD_CASES
    )
    kinds, rows = [*standard, *further], 2 if len(curves) else 1
    ratios = {"height_ratios": [3, 1.25]} if rows == 2 else None
    size = (max(3.0 * len(kinds), 6.5), 3.5 if rows == 1 else 5.1)  # the title fits
    figure, axes = new_figure(
        *size, nrows=rows, ncols=len(kinds), sharey="row", sharex="col", gridspec_kw=ratios
    )
    laws = [material, *compared]
    for column, kind in enumerate(kinds):
        measured, draw = curves[curves.kind == kind], _biaxial if kind == "biaxial" else _load_case
        residual = axes[1][column] if rows == 2 else None
        draw(axes[0][column], residual, kind, measured, laws, _reach(curves))
        axes[0][column].set_title(TITLES[kind], loc="left", fontweight="bold")
        bottom = residual if residual is not None else axes[0][column]
        bottom.set_xlabel("amount of shear [-]" if kind == "simple_shear" else "stretch [-]")
    _scale(axes, curves)
    axes[0][0].set_ylabel("Cauchy stress [kPa]")
    shown: dict[str, Artist] = {}
    for ax in axes[0]:
        for handle, label in zip(*ax.get_legend_handles_labels()):
            shown.setdefault(label, handle)
    columns = min(len(shown), 5 if len(kinds) > 2 else 3)
    figure.legend(
        list(shown.values()), list(shown), loc="outside lower center", ncols=columns, handlelength=2.4
    )
    figure.suptitle(_title(material), fontsize=11, x=0.01, ha="left", linespacing=1.5)
    return figure


def _load_case(
    ax: Axes, residual: Axes | None, test: str, curves: pd.DataFrame, laws: list[MaterialLaw], reach: float
) -> None:
    """Draw a test whose curve follows from its stretch alone."""
    samples = [group for name, group in curves.groupby("sample") if name != MEAN]
    for number, group in enumerate(samples):
        label = "specimens" if number == 0 else None
        ax.plot(group.stretch, group.cauchy_stress_kPa, color=PUBLISHED, lw=0.6, alpha=0.7, label=label)
    valid = (laws[0].valid_stretch or {}).get(test)
    stretch = np.linspace(*(valid or (1.0, reach)), 200)
    mean = curves[(curves["sample"] == MEAN) & (curves.test == test)]
    for number, (m, colour, line) in enumerate(_drawn(laws)):
        style: Style = {
            "color": colour,
            "ls": line if valid or number else "--",
            "lw": 1.1 if number else 1.8,
        }
        label = _label(m, len(laws))
        area = 1.0 if test == "simple_shear" else stretch  # per current area; the sheared plane keeps its own
        model = _nominal(m.law, test, stretch) * area
        ax.plot(stretch, model, label=label, zorder=3 - 0.1 * number, **style)
        if residual is not None and len(mean):
            error = _nominal(m.law, test, mean.stretch.to_numpy()) - mean.nominal_stress_kPa
            residual.plot(mean.stretch, 100 * error / mean.nominal_stress_kPa.abs().max(), **style)
    if len(mean):
        mean = _thinned(mean)
        marks: Style = {"ls": "", "marker": "o", "ms": 4.2, "mfc": "white", "mec": MEASURED, "mew": 1.5}
        ax.plot(mean.stretch, mean.cauchy_stress_kPa, label="mean of specimens", **marks)
    if stretch[0] >= 1:
        ax.set_xlim(left=1.0)
    r2 = (laws[0].r2_nominal or {}).get(test)
    count = f"{len(samples)} specimen{'s' if len(samples) != 1 else ''}"
    text = "not tested" if r2 is None else f"R² = {np.floor(r2 * 1e4) / 1e4:.4f}\n{count}"
    _say(ax, text)


def _biaxial(
    ax: Axes, residual: Axes | None, kind: str, curves: pd.DataFrame, laws: list[MaterialLaw], reach: float
) -> None:
    """Draw tests whose second stretch is one's own, the law where it was measured; hollow marks: across the load."""
    mean = curves[curves["sample"] == MEAN]
    parts = list(dict.fromkeys(label.removesuffix(" P22") for label in mean.test))
    for label, curve in mean.groupby("test", sort=False):
        mark = MARKS[parts.index(label.removesuffix(" P22")) % len(MARKS)]
        to_cauchy = (curve.cauchy_stress_kPa / curve.nominal_stress_kPa).to_numpy()
        model = curve.model_nominal_stress_kPa * to_cauchy
        ax.plot(curve.stretch, model, color=SIMULATED, lw=1.2, label=_label(laws[0], len(laws)))
        fill = "white" if label.endswith("P22") else MEASURED
        thinned = _thinned(curve)
        style: Style = {"ls": "", "marker": mark, "ms": 3.6, "mfc": fill, "mec": MEASURED}
        ax.plot(thinned.stretch, thinned.cauchy_stress_kPa, **style)
        if residual is not None:
            error = curve.model_nominal_stress_kPa - curve.nominal_stress_kPa
            share = 100 * error / mean.nominal_stress_kPa.abs().max()
            residual.plot(curve.stretch, share, color=SIMULATED, lw=0.9)
    r2, count = (laws[0].r2_nominal or {}).get(kind), mean.test.nunique()
    curves_shown = f"{count} curve{'s' if count > 1 else ''}"
    text = curves_shown if r2 is None else f"R² = {r2:.4f}\n{curves_shown}"
    _say(ax, text)


def _say(ax: Axes, text: str) -> None:
    """Write a text into the upper left corner, legible on curves."""
    behind = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
    ax.text(0.04, 0.97, text, transform=ax.transAxes, va="top", fontsize=9.5, color=INK, bbox=behind)


def _thinned(curve: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a curve that are marked: more would hide the model's line."""
    return curve.iloc[np.linspace(0, len(curve) - 1, min(len(curve), 14)).round().astype(int)]


def _drawn(laws: list[MaterialLaw]):
    """Yield each law with its colour and line; the chosen one first."""
    yield laws[0], SIMULATED, "-"
    for number, law in enumerate(laws[1:]):
        yield law, *OTHER_LAWS[number % len(OTHER_LAWS)]


def _label(material: MaterialLaw, laws: int) -> str:
    title = material.family.title
    return title if laws > 1 else f"{title.split(',')[0]} model"


def _nominal(law: PrincipalLaw, test: str, stretch: np.ndarray) -> np.ndarray:
    """Return the nominal stress [kPa], NaN beyond a limiting stretch."""
    return stress_points(LOAD_CASE_OF[test], stretch).measured_stress(law) * 1e3


def _reach(curves: pd.DataFrame) -> float:
    """Return up to which stretch a test that was not made is shown: as far as the others went."""
    standard = curves[curves.kind.isin([*LOAD_CASES, "biaxial"])]
    return float(standard.stretch.max()) if len(standard) and standard.stretch.max() > 1.05 else 2.0


def _scale(axes: np.ndarray, curves: pd.DataFrame) -> None:
    """Scale the axes by what was measured: a law that fails must not flatten it."""
    low = min(0.0, 1.08 * float(curves.cauchy_stress_kPa.min())) if len(curves) else 0.0
    high = 1.08 * float(curves.cauchy_stress_kPa.max()) if len(curves) else None
    axes[0][0].set_ylim(low, high)
    if len(axes) == 1:
        return
    lines = [line.get_ydata() for ax in axes[1] for line in ax.get_lines()]
    largest = max((float(np.nanmax(np.abs(y))) for y in lines if np.isfinite(y).any()), default=1.0)
    limit = min(1.1 * largest, 15.0)  # per cent: worse laws leave the picture
    axes[1][0].set(ylim=(-limit, limit), ylabel="model - mean\n[% of largest]")
    for ax in axes[1]:
        ax.axhline(0, color="#999999", lw=0.7, zorder=0)


def _title(material: MaterialLaw) -> str:
    family, law = material.family, material.law
    source = "" if material.samples else ", parameters given"
    source += ", SYNTHETIC tests" if material.synthetic else ""
    if isinstance(law, Ogden):
        mu = ", ".join(f"{m * 1e3:.3g}" for m in law.mu)
        alpha = ", ".join(f"{a:.3g}" for a in law.alpha)
        constants = f"μ = ({mu}) kPa, α = ({alpha})"
    else:
        named = zip(family.parameters, material.values)
        constants = ", ".join(
            f"{name.removesuffix('_kPa')} = {v:.3g}{' kPa' if family.unit(name) == 'kPa' else ''}"
            for name, v in named
        )
    return (
        f"{material.material}{source}\n"
        f"{family.title.split(',')[0]} model: E = {law.youngs_modulus * 1e3:.1f} kPa, {constants}"
        f"{'; R² of the nominal stress' if material.r2_nominal else ''}"
    )
