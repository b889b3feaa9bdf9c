"""The noise that a session's readings show themselves: of a reading, and of its rounding."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import pandas as pd

from gelforge.recording.readings import AXES, FORCE, RAW, Recording

FINEST = (
    1e-9  # N, digits that are looked at: those beyond are of a computation, as interpolated readings have
)
FEWEST_STEPS = 5  # between recorded numbers, that show an amplifier's step
BENT = 2.0  # times the scatter of zero readings: more than that of dwells about a line is relaxation
LEAST_SCATTER = 0.1  # of the step, where all repeats were rounded to one number
LEAST_FREEDOM = 10  # repeats that a noise estimate needs
TOGETHER = (
    "{session}: single indentations have too few zero rows to show the noise: it is taken from those of all"
    " indentations together,"
    " about their drift, which is allowed for"
)


def reading_noise(
    recording: Recording, zeros: Repeats | None = None
) -> tuple[np.ndarray, np.ndarray, tuple[float, float], list[str]]:
    """Return the standard deviations (3,) [N] of one reading and of its rounding, how well, and what is not known of them.

    Repeats are zero rows of an indentation, and its dwell rows about their straight line, unless these bend by more than
    the zero rows scatter: that is relaxation. Where they scatter by less than half of the readings' step, rounding is one
    and the same error in all repeats: step / sqrt(12), in the zero and at each depth; where they scatter more, it is part
    of the scatter. How well: the repeats' degrees of freedom (inf where the deviation is stated), and the variance of
    their squares over that of normal ones. zeros: repeats of all indentations together, where single indentations have too
    few (zeros_together). The step is that of the recorded numbers; where they show none it is the stated resolution, or
    nothing beside a stated repeatability, which holds it.
    """
    readings, session = recording.readings, recording.session
    resolution, axes = (np.array(v, dtype=float) for v in (session.force.resolution_N, session.force.axes))
    stated = np.broadcast_to(session.force.repeatability_N or 0.0, 3)
    recorded = np.where(axes == 0, 0.0, axes * steps_of(readings[RAW].to_numpy()))
    step = np.hypot.reduce(recorded, axis=1)  # along the sensor's axes
    held = (stated > 0) & (np.ptp(readings[FORCE].to_numpy(), axis=0) > 0)
    step = np.where(np.isnan(step), np.where(held, 0.0, resolution), step)
    zero, dwell = repeats_of(readings, "zero", 1), repeats_of(readings, "dwell", 2)
    zero, said = (zero, []) if zeros is None else (zeros, [TOGETHER.format(session=session.session)])
    if min(zero.freedom, dwell.freedom) >= LEAST_FREEDOM:
        usual = np.maximum(zero.scatter, step / 2)
        k = int(np.argmax(dwell.scatter / usual))
        if dwell.scatter[k] > BENT * usual[k]:
            dwell = Repeats.none()
            said.append(
                f"{session.session}: F{AXES[k]} bends during dwells by more than zero readings scatter, {usual[k]:.2g} N: "
                "the noise is taken from the zero readings alone, and is too small if it grows with the force"
            )
    found = zero + dwell
    if found.freedom >= LEAST_FREEDOM:
        scatter = found.scatter
        rounding = np.where(scatter < step / 2, step / np.sqrt(12), 0.0)
        tails = _tails(found.fourths, found.expected, scatter, rounding == 0)
        least = LEAST_SCATTER * np.maximum(step, stated)
        return np.maximum(scatter, least), rounding, (float(found.freedom), tails), said
    reported = (
        f"{session.session}: {found.freedom:.3g} repeated readings, {LEAST_FREEDOM} are needed to know the noise; "
        + (
            "the stated repeatability is used"
            if stated.any()
            else "the stated resolution is taken as its standard deviation"
        )
    )
    return np.where(stated > 0, stated, resolution), np.zeros(3), (np.inf, 1.0), [reported]


def steps_of(raw: np.ndarray) -> np.ndarray:
    """Return by axis (3,) [N] the step of recorded numbers (N, 3); nan where they have more digits than FINEST.

    It is their greatest common divisor, the last digit written, or the step of an amplifier of which all are multiples
    within that digit.
    """
    steps = np.full(raw.shape[1], np.nan)
    for axis, own in enumerate(raw.T):
        apart = np.diff(np.unique(np.rint(own[np.isfinite(own)] / FINEST).astype(np.int64)))
        digit = int(np.gcd.reduce(apart, initial=0))
        if digit <= 1:
            continue
        near = apart[apart < 1.5 * apart.min()].mean()
        counts = np.cumsum(np.rint(apart / near))
        at = np.cumsum(apart)
        step = at[-1] / counts[-1]
        same = len(apart) >= FEWEST_STEPS and np.abs(at - step * counts).max() <= digit
        steps[axis] = FINEST * (step if same else digit)
    return steps


@dataclass(frozen=True, eq=False)
class Repeats:
    """Sums over repeated readings R e about their mean or line: squares, fourth powers, and what `_tails` expects."""

    squares: np.ndarray  # (3,) [N^2]
    fourths: np.ndarray  # (3,) [N^4]
    expected: np.ndarray  # (2,), or (3, 2) by axis
    freedom: float

    def __add__(self, other: Repeats) -> Repeats:
        return Repeats(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    @property
    def scatter(self) -> np.ndarray:
        """Return the standard deviations (3,) [N]."""
        return np.sqrt(self.squares / self.freedom)

    @staticmethod
    def none() -> Repeats:
        """Return no repeats."""
        return Repeats(np.zeros(3), np.zeros(3), np.zeros(2), 0)


def repeats_of(readings: pd.DataFrame, phase: str, fitted: int) -> Repeats:
    """Return the repeats of a phase about a polynomial in time of so many coefficients per indentation."""
    own = readings[readings["phase"] == phase]
    times, forces = own["time_s"].to_numpy(), own[FORCE].to_numpy()
    found = Repeats.none()
    for rows in own.groupby("press", sort=False).indices.values():
        if len(rows) <= fitted:
            continue
        time = times[rows]
        curve = np.vander(time - time.mean(), fitted)
        residual_of = np.eye(len(time)) - curve @ np.linalg.pinv(curve)
        left = residual_of @ forces[rows]
        expected = np.array([np.sum((residual_of**2).sum(axis=1) ** 2), np.sum(residual_of**4)])
        found += Repeats((left**2).sum(axis=0), (left**4).sum(axis=0), expected, len(time) - fitted)
    return found


def _tails(fourths: np.ndarray, expected: np.ndarray, scatter: np.ndarray, free: np.ndarray) -> float:
    """Return the variance of a squared draw over that of a normal one, at least 1, from the repeats of the free axes.

    Residuals R e of draws e of variance v and excess kurtosis k have fourth moments 3 v^2 sum (RR')_ii^2 + k v^2 sum R_ij^4:
    fourths (3,) are summed over all, expected holds both sums, (2,) or by axis (3, 2).
    """
    known = free & (scatter > 0)
    if not known.any():
        return 1.0
    usual, excess = np.broadcast_to(expected, (3, 2))[known].T
    excess = (fourths[known] / scatter[known] ** 4 - 3 * usual) / excess
    return 1.0 + max(float(excess.mean()), 0.0) / 2
