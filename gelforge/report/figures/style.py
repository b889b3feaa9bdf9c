"""Colours, fonts and figure making that all figures of the report share.

Colours are those of Okabe and Ito (2008), distinguished by colour-blind readers. Signed forces use one diverging map
centred at zero, pressures and magnitudes one sequential map, everywhere.
"""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

SIMULATED = "#0072B2"  # our finite elements, the label
MEASURED = "#E69F00"  # force/torque readings
PREDICTED = "#D55E00"  # the network
PUBLISHED = "#555555"  # the paper's numbers
PUBLISHED_LINEAR = "#009E73"
VARIANTS = [
    ("#CC79A7", "^"),
    ("#009E73", "v"),
    ("#56B4E9", "<"),
    ("#000000", ">"),
]  # colour and marker, in turn
LAYERS = ["#F0E6C8", "#9CC9E5", "#B8D8B0", "#F3C59B"]  # soft layers from the base up
SURROUND = {"wall": "#E8B4C8", "flange": "#D9A7D0", "base": "#CFCFCF"}
INK = "#222222"
FAINT = "#B5B5B5"

SIGNED = "RdBu_r"  # signed quantities, white at zero
MAGNITUDE = "PuBu"  # magnitudes from zero up, light at zero

Style = dict[str, Any]  # keywords of Matplotlib's functions, each of its own type
SETTINGS: dict[RcKeyType, Any] = {
    "font.size": 9,
    "font.family": "sans-serif",
    "axes.titlesize": 10,
    "axes.labelsize": 9,
    "axes.edgecolor": "#888888",
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": False,
    "grid.color": "#E4E4E4",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "xtick.color": "#666666",
    "ytick.color": "#666666",
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "text.color": INK,
    "svg.fonttype": "path",
    "svg.hashsalt": "gelforge",
}


styled = matplotlib.rc_context(SETTINGS)  # decorates every function that returns a figure


def new_figure(width_in: float, height_in: float, **subplots) -> tuple[Figure, np.ndarray]:
    """Return a figure [inch] and its axes (rows, columns) as an array; no pyplot state is touched."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained", facecolor="white")
    return figure, figure.subplots(squeeze=False, **subplots)


def region_colours(names: list[str]) -> list[str]:
    """Return one colour per region of the sensor: wall, flange and base have their own, layers take turns."""
    layers = [name for name in names if name not in SURROUND]
    return [SURROUND.get(name) or LAYERS[layers.index(name) % len(LAYERS)] for name in names]


def signed_limit(*arrays: np.ndarray, floor: float = 1e-9) -> float:
    """Return the largest finite magnitude m in arrays: limits -m..m put zero at the colour map's middle."""
    largest = [
        np.abs(a[np.isfinite(a)]).max(initial=0.0) for a in (np.asarray(array, float) for array in arrays)
    ]
    return max(floor, *largest)


@styled
def svg(figure: Figure, dpi: int = 150) -> str:
    """Return a figure as SVG text, the same bytes for the same content; dpi holds for its raster parts."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", dpi=dpi, metadata={"Date": None, "Creator": "gelforge"})
    return buffer.getvalue()


def data_uri(figure: Figure) -> str:
    """Return a figure as a data URI for the src of an HTML image: nothing is fetched."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg(figure).encode()).decode()


def surface_axes(ax: Axes, width_x_mm: float, width_y_mm: float, labels: bool = True) -> None:
    """Frame an axes as the sensor's top surface seen from above [mm], with equal scales."""
    ax.set_aspect("equal")
    ax.set_xlim(0, width_x_mm)
    ax.set_ylim(0, width_y_mm)
    ax.set_xticks([0, width_x_mm / 2, width_x_mm])
    ax.set_yticks([0, width_y_mm / 2, width_y_mm])
    for side in ("top", "right"):
        ax.spines[side].set_visible(True)
    if labels:
        ax.set_xlabel("x [mm]")
        ax.set_ylabel("y [mm]")


def frame_arrows(
    ax: Axes, origin: tuple[float, float], length: float, names: tuple[str, str], out: str = ""
) -> None:
    """Draw the frame's two arrows in data units; `out` names the axis that points out of the page."""
    x, y = origin
    style = {"arrowstyle": "-|>", "color": INK, "lw": 1.4, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 11}
    ax.annotate("", (x + length, y), (x, y), arrowprops=style, annotation_clip=False, zorder=9)
    ax.annotate("", (x, y + length), (x, y), arrowprops=style, annotation_clip=False, zorder=9)
    text: Style = {"fontsize": 9, "fontweight": "bold", "annotation_clip": False, "zorder": 9}
    ax.annotate(names[0], (x + length, y), (0, -3), textcoords="offset points", ha="right", va="top", **text)
    ax.annotate(names[1], (x, y + length), (-4, 0), textcoords="offset points", ha="right", va="top", **text)
    if out:
        ax.plot([x], [y], "o", ms=8, mfc="white", mec=INK, mew=1.2, clip_on=False, zorder=10)
        ax.plot([x], [y], "o", ms=2.5, color=INK, clip_on=False, zorder=11)
        ax.annotate(out, (x, y), (-6, -6), textcoords="offset points", ha="right", va="top", **text)
