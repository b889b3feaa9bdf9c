"""Whether images lag or lead their readings, by the row of the session that each image fits."""

from __future__ import annotations

import numpy as np
import pandas as pd

# Of 14 kinds of honest SYNTHETIC images each passes, and each fault is found (tests/recording/test_image_plausibility.py):
MOST_STEPS = 3  # images that a buffer holds back
# for a correlation to say something: of 8 unrelated images it exceeds FITS in 1 % (Fisher 1915)
LEAST_IMAGES = 8
# Correlation of flow and depth at a shift, and by how much it beats that as recorded: frames one or two images late are
# refused with their lag (test_image_plausibility.py).
FITS, BETTER = 0.8, 0.3
# As recorded; a camera that sees a fifth of the indentations reaches it, images of other rows do not
# (test_image_plausibility.py).
LEAST_FIT = 0.3
# Standard deviation of depths over the largest; of less variety no correlation is asked: sessions of one depth pass
# (test_image_plausibility.py).
DEPTHS_DIFFER = 0.2


def lag(table: pd.DataFrame, depth: pd.Series) -> str:
    """Return in words by how many images, and seconds, images lag or lead the readings, or that no shift fits.

    "" where they fit as recorded.

    table: images in the order taken with `flow_px`, `time_s` and `run`, within which rows follow one another.
    """
    by_shift = {shift: _correlation(table, depth, shift) for shift in range(-MOST_STEPS, MOST_STEPS + 1)}
    best = max(by_shift, key=by_shift.__getitem__)
    if best == 0 or by_shift[best] < FITS or by_shift[best] < by_shift[0] + BETTER:
        varied = len(depth) >= LEAST_IMAGES and depth.std() > DEPTHS_DIFFER * depth.max()
        if not varied or by_shift[0] >= LEAST_FIT:
            return ""
        return f"the images belong to other rows, as flow and depth correlate by {by_shift[0]:.2f}"
    # with one depth the image before and the one after fit equally well
    also = by_shift[-best] > by_shift[best] - 0.05
    times = table.groupby("run")["time_s"].diff(abs(best)).dropna()
    count = f"{abs(best)} image{'s' if abs(best) > 1 else ''} (about {times.median():.3g} s)"
    words = "lag or lead" if also else "lag" if best > 0 else "lead"
    return (
        f"frames {words} the readings by {count}: shifted, flow and depth correlate by {by_shift[best]:.2f}, as recorded by"
        f" {by_shift[0]:.2f}"
    )


def _correlation(table: pd.DataFrame, depth: pd.Series, shift: int) -> float:
    """Return the correlation of each image's flow with the depth `shift` images before; -1 where it says nothing."""
    earlier = depth.groupby(table["run"]).shift(shift)
    known = earlier.notna()
    flow, at = table["flow_px"][known], earlier[known]
    if len(at) < LEAST_IMAGES or np.ptp(at) == 0 or np.ptp(flow) == 0:
        return -1.0
    return float(np.corrcoef(flow, at)[0, 1])
