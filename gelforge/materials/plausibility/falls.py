"""Sudden falls of the stress while a specimen is stretched on: it breaks, or slips in its grip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.basis.statistics import ROWS_OF_SCATTER, channel_step, row_noise

# Breaks and slips are found; noise, softening, holds and yield points are none (tests/materials/test_curve_defects.py):
WITHIN, WITHIN_ROWS = 0.01, (3, 50)  # of the rows, in which the stress falls: slower is softening
# Of the range of strain, by which it grows meanwhile: else the specimen is held, and relaxes. A hold that relaxes by 40 %
# is no fall (test_curve_defects.py).
GOES_ON = 5e-4
# Of the largest stress: a slip by a fifth is found, slow softening is none (test_curve_defects.py).
LEAST_FALL = 0.05
# Standard deviations of a row, and steps of a coarse channel: noise of 2 % of the stress and single steps of 2.5 kPa are no
# fall (test_curve_defects.py).
NOISE, STEPS = 10.0, 2.0
LASTS_ROWS = 3  # a single row that is low is a reading that failed
# Of the stress before, below which what is left bears nothing: a specimen that keeps 3 % broke, one that keeps 80 % slipped
# (test_curve_defects.py).
BROKEN = 0.3
# Below which WITHIN_ROWS are more than 5 % of the rows: so slow a fall is softening where more is borne later, as yield
# points of curves of 30 to 50 rows are (test_curve_defects.py).
FEW_ROWS = 60


@dataclass(frozen=True)
class Fall:
    """The last row before a fall, the first after it, the stresses there [MPa], the largest share borne again later."""

    row: int
    after: int
    before_MPa: float
    after_MPa: float
    recovers: float


def fall_while_loading(test: MaterialTest) -> Fall | None:
    """Return the first sudden fall of the stress in the loadings of a test, by rows of the test; None without any."""
    stress = test.nominal_stress if test.cauchy_difference is None else test.cauchy_difference
    if test.test == "biaxial":
        return None
    for segment in test.segments:
        if segment.kind == "load":
            rows = segment.rows
            fall = sudden_fall(np.abs(test.stretch[rows] - test.at_rest), stress[rows])
            if fall:
                return replace(fall, row=fall.row + segment.start, after=fall.after + segment.start)
    return None


def sudden_fall(strain: np.ndarray, stress: np.ndarray) -> Fall | None:
    """Return the first sudden fall of the stress (n,) while the strain (n,) grows away from rest, None without any."""
    size, n = np.abs(np.asarray(stress, float)), len(stress)
    if n < ROWS_OF_SCATTER or not np.isfinite(size).all():
        return None
    limit = max(LEAST_FALL * size.max(), NOISE * row_noise(size), STEPS * channel_step(size))
    rows = int(np.clip(np.ceil(WITHIN * n), *WITHIN_ROWS))
    ahead = np.min(sliding_window_view(np.append(size, np.full(rows, np.inf)), rows + 1), axis=1)
    for row in np.flatnonzero(size - ahead > limit).tolist():
        after = row + int(np.argmin(size[row : row + rows + 1]))
        last = row + int(np.argmax(size[row:after]))
        # a single row that is high is no curve to fall from
        base = float(np.median(size[max(last - 2, 0) : last + 1]))
        grown = strain[last : after + 1] - strain[last]
        goes_on = grown[-1] >= GOES_ON * np.ptp(strain) and grown.min() >= -WITHIN * np.ptp(strain)
        rest = size[after : after + LASTS_ROWS]
        if goes_on and len(rest) == LASTS_ROWS and base - rest.max() > limit:
            recovers = float(size[after:][strain[after:] >= strain[last]].max(initial=0.0) / size[last])
            if recovers >= 1.0 and n < FEW_ROWS:
                continue  # a yield point of a curve of few rows, which bears more later
            return Fall(last, after, float(stress[last]), float(stress[after]), recovers)
    return None


def fall_words(fall: Fall, lines: Sequence[int]) -> str:
    """Return in words where the stress falls, and what it looks like; lines: the row numbers in the file."""
    cause = "the specimen broke" if fall.recovers < BROKEN else "it slipped in its grip, or tore"
    return (
        f"row {lines[fall.row]}: the stress falls from {fall.before_MPa * 1e3:.4g} to {fall.after_MPa * 1e3:.4g} kPa by row"
        f" {lines[fall.after]} while the stretch goes on: {cause}"
    )
