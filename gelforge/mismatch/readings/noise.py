"""The noise that a session's readings show themselves: of a reading, and of its rounding."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import pandas as pd

from gelforge.recording.readings import AXES, FORCE, Recording

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
    few (zeros_together).
    """
    readings, session = recording.readings, recording.session
    step = np.array(session.force.resolution_N, dtype=float)
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
        return np.maximum(scatter, LEAST_SCATTER * step), rounding, (float(found.freedom), tails), said
    stated = np.broadcast_to(session.force.repeatability_N or 0.0, 3)
    reported = (
        f"{session.session}: {found.freedom:.3g} repeated readings, {LEAST_FREEDOM} are needed to know the noise; "
        + (
            "the stated repeatability is used"
            if stated.any()
            else "the stated resolution is taken as its standard deviation"
        )
    )
    return np.where(stated > 0, stated, step), np.zeros(3), (np.inf, 1.0), [reported]


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
