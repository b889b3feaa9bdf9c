"""The readings that are judged, of one or more sessions, in the order taken."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field, replace

import numpy as np
import pandas as pd

COLUMNS = [
    *("session", "press", "order", "site", "phase", "time_s", "press_time_s", "x_mm", "y_mm", "depth_mm"),
    *("deepest_mm", "age_days", "temperature_C"),
]


@dataclass(frozen=True)
class Observations:
    """R readings of the force on the sensor, zero subtracted; rows before touch are not among them.

    noise_N, rounding_N and zero_N are standard deviations; zero_N is of the subtracted zero, one draw per press and axis.
    table: columns as in COLUMNS, index 0..R-1. `press` is unique over all sessions, `site` counts distinct positions,
    `press_time_s` runs from the press's first touch (its commanded depth 0), `deepest_mm` is the press's deepest depth.
    """

    table: pd.DataFrame
    force: np.ndarray  # (R, 3) [N], nan where an axis was not read
    sites: np.ndarray  # (S, 2) [mm]
    noise_N: np.ndarray  # (R, 3) of one reading, quantisation included
    zero_N: np.ndarray  # (R, 3), 0 if tared
    touchdown_mm: np.ndarray  # (R,) standard deviation of the depth's zero
    zero_by: np.ndarray  # (R,) "press" or "session": what shares one draw of it
    _: KW_ONLY
    rounding_N: np.ndarray = 0.0  # (R, 3) standard deviation of rounding, shared at one depth of a press
    repeats: np.ndarray = np.inf  # (R,) degrees of freedom behind noise_N; inf: it is known
    tails: np.ndarray = 1.0  # (R,) variance of a squared reading's noise over that of normal noise
    cannot_know: tuple[str, ...] = field(default=())  # what these readings cannot say, in plain sentences
    set_aside: tuple[str, ...] = field(default=())  # outliers: which, and why

    def __post_init__(self):
        shapes = {"rounding_N": self.force.shape, "repeats": len(self.force), "tails": len(self.force)}
        for name, shape in shapes.items():  # one number stands for all readings
            object.__setattr__(self, name, np.broadcast_to(getattr(self, name), shape))

    @property
    def read(self) -> np.ndarray:
        """Return (R, 3) bool: what was read."""
        return np.isfinite(self.force)

    @property
    def tared(self) -> np.ndarray:
        """Return (R,) bool: no zero is subtracted press by press, the session's own stands."""
        return (self.zero_N == 0).all(axis=1)

    def flat(self, array: np.ndarray) -> np.ndarray:
        """Return the entries that were read (n, ...) of an array (R, 3, ...)."""
        return array[self.read]

    def labels(self) -> pd.DataFrame:
        """Return the rows of the table for each entry that was read (n rows), with `reading` and `axis` (0, 1, 2)."""
        reading, axis = np.nonzero(self.read)
        return self.table.iloc[reading].assign(reading=reading, axis=axis).reset_index(drop=True)

    def chosen(self, rows: np.ndarray) -> Observations:
        """Return the observations of some readings (R,) bool; sites keep their numbers."""
        arrays = ("force", "noise_N", "zero_N", "touchdown_mm", "zero_by", "rounding_N", "repeats", "tails")
        table = self.table[rows].reset_index(drop=True)
        return replace(self, table=table, **{name: np.asarray(getattr(self, name))[rows] for name in arrays})
