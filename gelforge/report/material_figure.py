"""A material's tests and its law: three panels, samples thin, their mean, and the model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from gelforge.characterisation.characterise import MEAN
from gelforge.characterisation.law_file import MaterialLaw, read_law
from gelforge.mechanics.homogeneous import LOAD_CASES, cauchy_stress
from gelforge.report.style import INK, MEASURED, PUBLISHED, SIMULATED, new_figure, styled

TITLES = {"uniaxial": "Uniaxial tension", "pure_shear": "Pure shear", "equibiaxial": "Equibiaxial tension"}
SHOWN_STRETCH = (1.0, 2.0)  # where a test is missing and the law stands alone
MEAN_MARKS = 14  # of the averaged curve; more would hide the model's line


@styled
def material_figure(law_json: str | Path, curves_csv: str | Path) -> Figure:
    """Return Cauchy stress over stretch in the three load cases, one scale for all, as in the paper's fig. 4.

    R2 in the panels is that of the nominal stress, which was fitted.
    """
    material, curves = read_law(law_json), pd.read_csv(curves_csv, dtype={"sample": str})
    figure, axes = new_figure(9.0, 3.5, nrows=1, ncols=3, sharey=True)
    for ax, test in zip(axes[0], LOAD_CASES):
        _panel(ax, test, curves[curves.test == test], material)
    axes[0][0].set_ylabel("Cauchy stress [kPa]")
    axes[0][0].set_ylim(bottom=0)
    shown = {label: handle for ax in axes[0] for handle, label in zip(*ax.get_legend_handles_labels())}
    axes[0][0].legend(shown.values(), shown.keys(), loc="upper left", handlelength=1.6)
    figure.suptitle(_title(material), fontsize=11, x=0.01, ha="left", linespacing=1.5)
    return figure


def _panel(ax: Axes, test: str, curves: pd.DataFrame, material: MaterialLaw) -> None:
    samples = [group for name, group in curves.groupby("sample") if name != MEAN]
    for number, group in enumerate(samples):
        label = "samples" if number == 0 else None
        ax.plot(group.stretch, group.cauchy_stress_kPa, color=PUBLISHED, lw=0.6, alpha=0.7, label=label)
    valid = (material.valid_stretch or {}).get(test)
    stretch = np.linspace(*(valid or SHOWN_STRETCH), 200)
    model = cauchy_stress(material.law, test, stretch) * 1e3
    ax.plot(stretch, model, "-" if valid else "--", color=SIMULATED, lw=1.8, label="Ogden law")
    mean = curves[curves["sample"] == MEAN]
    if len(mean):
        mean = mean.iloc[np.linspace(0, len(mean) - 1, MEAN_MARKS).round().astype(int)]
        style = {"ls": "", "marker": "o", "ms": 4.2, "mfc": "white", "mec": MEASURED, "mew": 1.5}
        ax.plot(mean.stretch, mean.cauchy_stress_kPa, **style, label="mean of samples")
    ax.set_title(TITLES[test], loc="left", fontweight="bold")
    ax.set_xlabel("stretch [-]")
    ax.set_xlim(left=1.0 if stretch[0] >= 1 else None)
    r2 = (material.r2_nominal or {}).get(test)
    text = "not tested" if r2 is None else f"R² = {np.floor(r2 * 1e4) / 1e4:.4f}\n{len(samples)} samples"
    ax.text(0.97, 0.06, text, transform=ax.transAxes, ha="right", va="bottom", fontsize=9.5, color=INK)
    _sketch(ax, test)


def _sketch(ax: Axes, test: str) -> None:
    """Draw a square of material with the arrows of its load case above R2, in units of a small inset."""
    inset = ax.inset_axes((0.72, 0.22, 0.26, 0.26))
    inset.set_axis_off()
    inset.set_aspect("equal")
    inset.set_xlim(-2, 2)
    inset.set_ylim(-2, 2)
    width, height = {"uniaxial": (0.9, 1.6), "pure_shear": (2.6, 0.9), "equibiaxial": (1.5, 1.5)}[test]
    inset.add_patch(Rectangle((-width / 2, -height / 2), width, height, fc="#E8EEF4", ec=INK, lw=0.9))
    ends = [((0, s * height / 2), (0, s * (height / 2 + 0.9))) for s in (-1, 1)]
    if test == "equibiaxial":
        ends += [((s * width / 2, 0), (s * (width / 2 + 0.9), 0)) for s in (-1, 1)]
    for start, end in ends:
        arrow = {"arrowstyle": "-|>", "color": INK, "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
        inset.annotate("", end, start, arrowprops=arrow)


def _title(material: MaterialLaw) -> str:
    law = material.law
    mu = ", ".join(f"{m * 1e3:.3g}" for m in law.mu)
    alpha = ", ".join(f"{a:.3g}" for a in law.alpha)
    source = "" if material.samples else ", parameters given"
    source += ", SYNTHETIC tests" if material.synthetic else ""
    return (
        f"{material.material}{source}\n"
        f"Ogden law: E = {law.youngs_modulus * 1e3:.1f} kPa, μ = ({mu}) kPa, α = ({alpha})"
        f"{'; R² of the nominal stress' if material.r2_nominal else ''}"
    )
