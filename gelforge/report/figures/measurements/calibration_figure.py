"""What a calibration leans on: where corners were seen, by how much they miss the fit, and an image with straight lines."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from gelforge.recording.optics.calibration import CELLS, Calibration
from gelforge.report.figures.style import FAINT, MEASURED, PREDICTED, SIMULATED, new_figure, styled


@styled
def calibration_figure(lens: Calibration, example: np.ndarray, straight: np.ndarray) -> Figure:
    """Return corners over the image, their residuals as arrows and by size, and an image before and after.

    Parameters
    ----------
    lens : Calibration
        With the boards seen.
    example, straight : numpy.ndarray
        (H, W) in grey, as recorded and without distortion.

    Returns
    -------
    Figure
        Four panels, axes in px.
    """
    width, height = lens.views.size
    pixels = np.concatenate([view.pixels for view in lens.views.seen])
    off = np.concatenate(lens.residuals())
    figure, axes = new_figure(10.0, 7.6 * height / width + 0.8, nrows=2, ncols=2)
    where, arrows, before, after = axes.ravel()
    for number in range(1, CELLS):
        where.axvline(number * width / CELLS - 0.5, color=FAINT, lw=0.6)
        where.axhline(number * height / CELLS - 0.5, color=FAINT, lw=0.6)
    where.plot(*pixels.T, ".", ms=3, color=SIMULATED)
    where.plot(*lens.K[:2, 2], "+", ms=12, mew=2, color=PREDICTED)
    where.set_title(
        f"{len(pixels)} corners of {len(lens.views.seen)} images in {lens.covered:.0%} of the parts; + principal point"
    )
    scale = 0.04 * width / max(lens.rms_px, 1e-6)
    arrows.quiver(
        *pixels.T, *(scale * off).T, angles="xy", scale_units="xy", scale=1, width=0.002, color=MEASURED
    )
    arrows.set_title(f"seen less fitted, {scale:.0f} times as long; {lens.rms_px:.3f} px rms")
    pictures = (before, example, "an image as recorded"), (after, straight, "without distortion")
    for ax, picture, title in pictures:
        ax.imshow(picture, cmap="gray", vmin=0, vmax=255)
        ax.set_title(title)
    for ax in axes.ravel():
        ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
        ax.set(xlabel="u [px]", ylabel="v [px]")
    return figure
