"""The readings that are judged, of one or more sessions, in the order taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Literal

import numpy as np
import pandas as pd
from pydantic import Field

from gelforge.config import Section
from gelforge.indentation.paths.places import POSITION_MATCH_MM, within

COLUMNS = [
    *("session", "press", "order", "site", "phase", "time_s", "press_time_s", "x_mm", "y_mm", "depth_mm"),
    *("deepest_mm", "age_days", "temperature_C"),
]
ARRAYS = [  # of observations, one row per reading
    *("force", "noise_N", "zero_N", "press_depth_mm", "session_depth_mm"),
    *("rounding_N", "drift_N", "trend_N", "came_along", "repeats", "tails"),
]


class SetAside(Section):
    """A reading that was left out."""

    session: str = Field(description="Its session")
    press: str = Field(description="Its indentation, as its session calls it")
    time_s: float | None = Field(None, description="Its time [s]")
    depth_mm: float | None = Field(None, description="Its depth [mm]")
    axis: Literal["x", "y", "z"] | None = Field(None, description="Its axis; empty: all")
    size: float | None = Field(None, description="Standard deviations from what it should be [-]")
    reason: str = Field(description="Why it was left out")


def _zero() -> np.ndarray:
    return np.zeros(())


@dataclass(frozen=True)
class Observations:
    """R readings of the force on the sensor, zero subtracted; rows before contact are not among them.

    noise_N, rounding_N and zero_N are standard deviations; zero_N is of the subtracted zero, one draw per indentation and
    axis. So are press_depth_mm (the stage's repeatability, a zero that each indentation finds by itself) and
    session_depth_mm (the session's contact point): of the depth, one draw per indentation and one per session. drift_N and
    trend_N are those of the zero's change since it was read, one draw per indentation and axis, and one per session and
    axis. table: columns as in COLUMNS, index 0..R-1. `press` is unique over all sessions, `site` counts distinct positions,
    `press_time_s` runs from the indentation's first touch (its commanded depth 0), `deepest_mm` is the indentation's
    deepest depth.
    """

    table: pd.DataFrame
    force: np.ndarray  # (R, 3) [N], nan where an axis was not read
    sites: np.ndarray  # (S, 2) [mm]
    noise_N: np.ndarray  # (R, 3) of one reading, quantisation included
    zero_N: np.ndarray  # (R, 3), 0 if tared
    press_depth_mm: np.ndarray  # (R,)
    session_depth_mm: np.ndarray  # (R,)
    _: KW_ONLY
    # (R, 3) standard deviation of rounding, shared at one depth of an indentation
    rounding_N: np.ndarray = field(default_factory=_zero)
    drift_N: np.ndarray = field(default_factory=_zero)  # (R, 3)
    trend_N: np.ndarray = field(default_factory=_zero)  # (R, 3)
    # (R, 2, 2) the stage's last moves before the indentation, see last_moves; 0: not known
    came_along: np.ndarray = field(default_factory=_zero)
    # (R,) degrees of freedom behind noise_N; inf: it is known
    repeats: np.ndarray = field(default_factory=lambda: np.array(np.inf))
    # (R,) variance of a squared reading's noise over that of normal noise
    tails: np.ndarray = field(default_factory=lambda: np.ones(()))
    cannot_know: tuple[str, ...] = field(default=())  # what these readings cannot say, in plain sentences
    set_aside: tuple[SetAside, ...] = field(default=())  # readings that are not judged

    def __post_init__(self):
        R = len(self.force)
        shapes: dict[str, tuple[int, ...]] = {"rounding_N": (R, 3), "drift_N": (R, 3), "trend_N": (R, 3)}
        shapes |= {"came_along": (R, 2, 2), "repeats": (R,), "tails": (R,)}
        for name, shape in shapes.items():  # one number stands for all readings
            object.__setattr__(self, name, np.broadcast_to(getattr(self, name), shape))

    @classmethod
    def none(cls) -> Observations:
        """Return the observations before anything is recorded: no reading and no site."""
        table, per_axis, per_reading = pd.DataFrame(columns=COLUMNS), np.zeros((0, 3)), np.zeros(0)
        return cls(table, per_axis, np.zeros((0, 2)), per_axis, per_axis, per_reading, per_reading)

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
        table = self.table[rows].reset_index(drop=True)
        return replace(self, table=table, **{name: np.asarray(getattr(self, name))[rows] for name in ARRAYS})

    def saying(self, *sentences: str) -> Observations:
        """Return the observations with more that they cannot say."""
        return replace(self, cannot_know=(*self.cannot_know, *sentences))

    def at_sites(self, chosen: Sequence[int] | np.ndarray) -> Observations:
        """Return the observations at some sites, which are numbered in the order given."""
        part = self.chosen(self.table["site"].isin(chosen).to_numpy())
        number = {int(old): new for new, old in enumerate(chosen)}
        return replace(
            part, table=part.table.assign(site=part.table["site"].map(number)), sites=self.sites[list(chosen)]
        )


def last_moves(
    table: pd.DataFrame, axes: np.ndarray | None = None, tolerance_mm: float = POSITION_MATCH_MM
) -> np.ndarray:
    """Return the directions (R, 2, 2) of the stage's last move along each of its axes before each row's press.

    table: columns press, x_mm and y_mm of one session, its indentations in the order taken. axes: the stage's axes in the
    sensor frame as columns (2, 2), those of the frame where none are given. Row by row one column for each axis, 0 before
    its first move; moves within the tolerance are none.
    """
    axes = np.eye(2) if axes is None else axes
    at = table.groupby("press", sort=False)[["x_mm", "y_mm"]].first()
    move = at.diff().fillna(0.0).to_numpy() @ axes  # along the stage's axes
    sign = pd.DataFrame(np.where(within(np.abs(move), tolerance_mm), np.nan, np.sign(move)), at.index)
    last = sign.ffill().fillna(0.0).loc[table["press"]].to_numpy()
    return axes * last[:, None, :]


def spread_out(points: np.ndarray, most: int, first: int = 0) -> np.ndarray:
    """Return the numbers, in order, of at most so many points (S, 2): the first, then always the farthest from them."""
    chosen = [first]
    away = np.linalg.norm(points - points[first], axis=1)
    while len(chosen) < min(most, len(points)):
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.sort(chosen)
