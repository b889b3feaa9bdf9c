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
# colour and marker, in turn
VARIANTS = [("#CC79A7", "^"), ("#009E73", "v"), ("#56B4E9", "<"), ("#000000", ">")]
LAYERS = ["#F0E6C8", "#9CC9E5", "#B8D8B0", "#F3C59B"]  # soft layers from the base up
SURROUND = {"wall": "#E8B4C8", "flange": "#D9A7D0", "base": "#CFCFCF"}
INK = "#222222"
FAINT = "#B5B5B5"
ALLOWED = "#E6E6E6"  # band of the errors that are allowed for

# How much a figure shows: what stays legible on a page of some 10 inches (judgement; no result depends on it).
BAND_SIGMAS = 2  # of every band, to each side: 95 % of a normal distribution
MOST_POINTS = 6000  # of a curve or a cloud: more make the file large and show nothing more
MOST_PANELS = 6  # side by side

SIGNED = "RdBu_r"  # signed quantities, white at zero
MAGNITUDE = "PuBu"  # magnitudes from zero up, light at zero

Style = dict[str, Any]  # keywords of Matplotlib's functions, each of its own type
CLOUD: Style = {"ls": "none", "marker": "o", "ms": 3, "mew": 0, "rasterized": True}  # many points
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


def legend_entries(*axes: Axes) -> dict[str, Any]:
    """Return what the legends of some axes show, by label: of equal ones the last."""
    return {label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels())}


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
def svg(figure: Figure) -> str:
    """Return a figure as SVG text, the same bytes for the same content; its raster parts have 150 dpi."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", dpi=150, metadata={"Date": None, "Creator": "gelforge"})
    return buffer.getvalue()


def data_uri(figure: Figure) -> str:
    """Return a figure as a data URI for the src of an HTML image: nothing is fetched."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg(figure).encode()).decode()


def surface_axes(ax: Axes, width_x_mm: float, width_y_mm: float) -> None:
    """Frame an axes as the sensor's top surface seen from above [mm], with equal scales."""
    ax.set(aspect="equal", xlim=(0, width_x_mm), ylim=(0, width_y_mm))
    ax.set(xticks=[0, width_x_mm / 2, width_x_mm], yticks=[0, width_y_mm / 2, width_y_mm])
    for side in ("top", "right"):
        ax.spines[side].set_visible(True)
