"""Time stamps of rows and frames in seconds; what a clock cannot have shown is refused by its cause."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import given
from gelforge.config.foreign.importing import Stamp
from gelforge.importing.refusals import ImportingError
from gelforge.recording.plausibility.streams import COARSEST_TICK_S, spread_stamps
from gelforge.units import UNITS, known_unit

# Off the straight line through stamps that are declared even: samples were lost. A jitter of 2 ms passes
# (tests/importing/test_clocks.py), a clock that is set or loses its digits is refused (benchmarks/faults.py, inputs).
UNEVEN_S = 0.25
# significant digits: what programs write unasked (%g), to tens of seconds of an epoch
FEW_DIGITS = range(6, 10)
# At most, of a clock that was set; more are jitter, or rows in no order. Clocks that are set once are named, jitter is
# distinguished (tests/importing/test_logs_of_programs.py).
STEPS_BACK = 3
# Between rows: less is jitter. A clock that is set back by 0.4 s is none (tests/importing/test_logs_of_programs.py).
LEAST_STEP_PERIODS = 3.0
# customary ways to write dates, to name in an error; day and month may be either
DAYS = ("%m/%d/%Y", "%d/%m/%Y", "%d.%m.%Y", "%Y/%m/%d", "%m/%d/%y", "%d.%m.%y", "%d-%b-%Y", "%Y-%m-%d")
TIMES = ("%H:%M:%S.%f", "%H:%M:%S", "%I:%M:%S.%f %p", "%I:%M:%S %p", "%H:%M:%S,%f")


def units_of(stamp: Stamp) -> dict[str, str]:
    """Return the unit of each column of numbers."""
    return dict(zip(stamp.columns, stamp.units))


def stamps(
    path: Path, table: pd.DataFrame, stamp: Stamp | None, rate_hz: float | None, even: bool, key: str
) -> np.ndarray:
    """Return the times (n,) [s] of the rows of a table, as its clock shows them; shared stamps are spread."""
    if rate_hz:
        return np.arange(len(table)) / rate_hz
    stamp = given(stamp, f"{key}.time")
    if stamp.is_date:
        time = _dates(path, table, stamp, key)
    else:
        parts = (table[c].to_numpy(float) * UNITS[known_unit(unit)][1] for c, unit in units_of(stamp).items())
        time = np.sum(list(parts), axis=0)
    if even:
        return _even(path, time, key)
    _refuse_backward(path, table, time, key)
    distinct, counts = np.unique(time, return_counts=True)
    if counts.max() == 1:
        return time
    tick = float(np.median(np.diff(distinct))) if len(distinct) > 1 else np.inf
    if tick > (1 + 1e-6) * COARSEST_TICK_S:
        lost = _lost_digits(distinct, stamp)
        if lost:
            raise ImportingError(
                f"{path}: {counts.max()} rows show the stamp {distinct[counts.argmax()]:.10g} s: the stamps {lost}; export"
                f" them with all digits, or give {key}.rate_hz"
            )
        if len(distinct) < 2:
            raise ImportingError(
                f"{path}: all rows have one time, {distinct[0]:.10g} s; name the column of time stamps in {key}.time"
            )
        raise ImportingError(
            f"{path}: {counts.max()} rows share a stamp of a clock with steps of {tick:.3g} s, the limit is"
            f" {COARSEST_TICK_S} s; name a finer column in {key}.time, or give {key}.rate_hz"
        )
    return spread_stamps(distinct, counts, tick)


def _lost_digits(distinct: np.ndarray, stamp: Stamp) -> str:
    """Return how stamps (n,) [s] lost their digits, "" where they did not; they share stamps for long."""
    if stamp.is_date:
        return ""
    shown = distinct / UNITS[known_unit(stamp.units[0])][1]
    largest = float(np.abs(shown).max())
    for digits in FEW_DIGITS:
        short = np.array([float(f"{value:.{digits}g}") for value in shown])
        if largest >= 10 ** (digits - 1) and np.allclose(short, shown, rtol=1e-12):
            return f"have {digits} significant digits, too few for {largest:.10g}"
    if largest > 2**24 and np.allclose(shown.astype(np.float32), shown, rtol=1e-12):
        return "were kept in single precision (float32)"
    return ""


def _refuse_backward(path: Path, table: pd.DataFrame, time: np.ndarray, key: str) -> None:
    """Raise ImportingError where the time runs back: a clock that was set, jitter, or rows in another order."""
    steps = np.diff(time)
    backward = np.flatnonzero(steps < 0)
    if not len(backward):
        return
    k = int(backward[0])
    line, back, period = table.index[k + 1], -float(steps[k]), float(np.median(steps))
    where = f"{path}, row {line}: the time runs back by {back:.4g} s"
    if len(backward) <= STEPS_BACK and period > 0 and back > LEAST_STEP_PERIODS * period:
        raise ImportingError(
            f"{where}, {time[k] - time[0]:.6g} s after its beginning, and goes on in steps of {period:.3g} s: the clock was"
            f" set there, as by a network's time; split the session there, name a steady column in {key}.time, or give"
            f" {key}.rate_hz"
        )
    raise ImportingError(
        f"{where}; set {key}.even: true if rows were taken evenly and only the stamps jitter, else sort the rows by time or"
        " name another column"
    )


def _dates(path: Path, table: pd.DataFrame, stamp: Stamp, key: str) -> np.ndarray:
    """Return dates and times of day, in one column or two, in seconds since 1970."""
    texts = table[stamp.columns[0]]
    for column in stamp.columns[1:]:
        texts = texts + " " + table[column]
    form = stamp.format or "ISO8601"
    try:
        dates = pd.to_datetime(texts, format=form, utc=True)
    except ValueError:
        parsed = pd.to_datetime(texts, format=form, utc=True, errors="coerce")
        line = parsed.index[parsed.isna()][0]
        name = " and ".join(stamp.columns)
        if stamp.format:
            remedy = f"not of the format {stamp.format!r}; correct the row or {key}.time.format"
        else:
            remedy = (
                f"no date and time of ISO 8601; correct the row, set {key}.time.format{_guessed(texts)}, or declare"
                " the unit of the stamps (a time of day is h:mm:ss)"
            )
        raise ImportingError(f"{path}, row {line}: {name} is {texts[line]!r}, {remedy}") from None
    return dates.astype("datetime64[ns, UTC]").astype("int64").to_numpy() / 1e9


def _guessed(texts: pd.Series) -> str:
    """Return in brackets the formats that fit the first and the last date, "" where none of the customary ones does."""
    ends = pd.Series([texts.iloc[0], texts.iloc[len(texts) // 2], texts.iloc[-1]])
    forms = [f"{day} {time}" for day in DAYS for time in TIMES]
    fit = [f for f in forms if pd.to_datetime(ends, format=f, errors="coerce").notna().all()]
    return f" ({' or '.join(map(repr, fit))} fits)" if fit else ""


def _even(path: Path, time: np.ndarray, key: str) -> np.ndarray:
    """Return the straight line through stamps (n,) [s]."""
    number = np.arange(len(time))
    slope, offset = np.polyfit(number, time - time[0], 1)
    line = offset + slope * number
    off = np.abs(time - time[0] - line)
    if slope <= 0 or off.max() > UNEVEN_S:
        raise ImportingError(
            f"{path}, row {int(off.argmax()) + 1} below the header: its stamp lies {off.max():.3g} s off the straight line"
            f" through all, the limit is {UNEVEN_S} s: rows were lost; set {key}.even: false"
        )
    return time[0] + line
