"""An image of an indentation with the optical flow that its features describe."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.image import imread

from gelforge.report.figures.style import new_figure, styled


def read_picture(path: str | Path, used: Callable[[np.ndarray], np.ndarray] | None = None) -> np.ndarray:
    """Return an image (H, W) or (H, W, 3) for display; used: makes of it what its features saw, cropped or remapped."""
    picture = imread(path)
    picture = picture[..., :3] if picture.ndim == 3 else picture
    return used(picture) if used else picture


def region_flow(
    feature: np.ndarray, shape_px: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return region centres u, v [px] and mean displacement du, dv [px] of one feature row (2 m).

    The first m features are magnitudes [px], the last m directions [rad], u right and v down, regions row by
    row from the image's top left; m is a square number.
    """
    magnitude, direction = np.split(np.asarray(feature, float), 2)
    n = round(np.sqrt(len(magnitude)))
    height, width = shape_px
    column, row = np.meshgrid(np.arange(n), np.arange(n))
    u, v = (column.ravel() + 0.5) * width / n - 0.5, (row.ravel() + 0.5) * height / n - 0.5
    return u, v, magnitude * np.cos(direction), magnitude * np.sin(direction)


@styled
def flow_figure(image: np.ndarray, feature: np.ndarray) -> Figure:
    """Return a pressed image next to its region flow from the reference image, drawn as arrows."""
    height, width = image.shape[:2]
    u, v, du, dv = region_flow(feature, (height, width))
    figure, axes = new_figure(9.6, 4.3 * height / width + 0.5, nrows=1, ncols=2)
    for ax, title, strength in zip(
        axes[0], ("image of the indentation", "flow since the zero-force image"), (1, 0.3)
    ):
        ax.imshow(image, cmap="gray", interpolation="nearest", alpha=strength)
        ax.set(title=title, xticks=[0, width - 1], yticks=[0, height - 1], xlabel="u [px]")
    axes[0, 0].set_ylabel("v [px]")
    n = round(np.sqrt(len(u)))
    step = int(np.ceil(n / 20))  # more arrows along a side merge into a carpet
    keep = (np.arange(n * n) % n % step == 0) & (np.arange(n * n) // n % step == 0)
    size = np.hypot(du, dv)
    largest = max(size.max(initial=0.0), 1e-6)
    scale = largest / (2.2 * step * width / n)  # the longest arrow spans about two spacings
    look = {"cmap": "viridis_r", "angles": "xy", "scale_units": "xy", "scale": scale, "width": 0.004}
    arrows = axes[0, 1].quiver(*(values[keep] for values in (u, v, du, dv, size)), **look)
    arrows.set_clim(0, largest)
    exaggeration = f"displacement [px], arrows drawn {1 / scale:.2g} times as long"
    figure.colorbar(arrows, ax=axes[0, 1], label=exaggeration, shrink=0.85)
    return figure
