"""Errors of the readings as sessions show or state them, or assumed: noise, rounding, drift of the zero, contact point."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
import pandas as pd
from scipy.optimize import minimize_scalar

from gelforge.config import DepthZero
from gelforge.mismatch.readings.observations import Observations
from gelforge.recording.readings import AXES, FORCE, RAW, Recording, force_on_sensor

# Repeats that a noise estimate needs: of 10 the standard deviation is known to 1 / sqrt(20) = 22 % (GUM 2008, table E.1).
LEAST_FREEDOM = 10
TOGETHER = (
    "{session}: single indentations have too few zero rows to show the noise: it is taken from those of all"
    " indentations together,"
    " about their drift, which is allowed for"
)
# Assumed where neither the session nor repeated indentations say how well zero was found
CONTACT_POINT_MM = 0.02


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
    nothing in addition to a stated repeatability, which holds it.
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
        if dwell.scatter[k] > 2 * usual[k]:  # that is relaxation
            dwell = Repeats.none()
            said.append(
                f"{session.session}: F{AXES[k]} bends during dwells by more than zero readings scatter, {usual[k]:.2g} N: "
                "the noise is taken from the zero readings alone, and is too small if it grows with the force"
            )
    repeats = zero + dwell
    if repeats.freedom >= LEAST_FREEDOM:
        scatter = repeats.scatter
        rounding = np.where(scatter < step / 2, step / np.sqrt(12), 0.0)
        tails = _tails(repeats.fourths, repeats.expected, scatter, rounding == 0)
        least = 0.1 * np.maximum(step, stated)  # where all repeats were rounded to one number
        return np.maximum(scatter, least), rounding, (float(repeats.freedom), tails), said
    reported = (
        f"{session.session}: {repeats.freedom:.3g} repeated readings, {LEAST_FREEDOM} are needed to know the noise; "
        + (
            "the stated repeatability is used"
            if stated.any()
            else "the stated resolution is taken as its standard deviation"
        )
    )
    return np.where(stated > 0, stated, resolution), np.zeros(3), (np.inf, 1.0), [reported]


def steps_of(raw: np.ndarray) -> np.ndarray:
    """Return by axis (3,) [N] the step of recorded numbers (N, 3); nan where they have digits below 1 nN.

    Those are of a computation, as interpolated readings have.

    It is their greatest common divisor, the last digit written, or the step of an amplifier of which all are multiples
    within that digit.
    """
    steps, finest = np.full(raw.shape[1], np.nan), 1e-9  # N
    for axis, column in enumerate(raw.T):
        apart = np.diff(np.unique(np.rint(column[np.isfinite(column)] / finest).astype(np.int64)))
        digit = int(np.gcd.reduce(apart, initial=0))
        if digit <= 1:
            continue
        near = apart[apart < 1.5 * apart.min()].mean()
        counts = np.cumsum(np.rint(apart / near))
        at = np.cumsum(apart)
        step = at[-1] / counts[-1]
        same = len(apart) >= 5 and np.abs(at - step * counts).max() <= digit
        steps[axis] = finest * (step if same else digit)
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
    of_phase = readings[readings["phase"] == phase]
    times, forces = of_phase["time_s"].to_numpy(), of_phase[FORCE].to_numpy()
    repeats = Repeats.none()
    for rows in of_phase.groupby("press", sort=False).indices.values():
        if len(rows) <= fitted:
            continue
        time = times[rows]
        curve = np.vander(time - time.mean(), fitted)
        residual_of = np.eye(len(time)) - curve @ np.linalg.pinv(curve)
        left = residual_of @ forces[rows]
        expected = np.array([np.sum((residual_of**2).sum(axis=1) ** 2), np.sum(residual_of**4)])
        repeats += Repeats((left**2).sum(axis=0), (left**4).sum(axis=0), expected, len(time) - fitted)
    return repeats


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


@dataclass(frozen=True, eq=False)
class Zeros:
    """What zero rows z = offset + trend t + a random walk + noise say: the noise as repeats, and the drift, by axis."""

    repeats: Repeats
    trend: np.ndarray  # (3,) [N/s], a standard deviation: the trend found, and how well
    wander: np.ndarray  # (3,) [N/s^0.5] standard deviation of the random walk after 1 s

    def drift(self, readings: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
        """Return the standard deviations (R, 3) [N] of the zero's walk and trend since each reading's own zero rows."""
        zero = readings[readings["phase"] == "zero"].groupby("press")["time_s"].mean()
        since = readings["time_s"].to_numpy() - zero.reindex(readings["press"]).to_numpy()
        since = np.maximum(since, 0.0)[:, None]
        return self.wander * np.sqrt(since), self.trend * since


def zeros_together(recording: Recording) -> Zeros | None:
    """Return what the zero rows of all indentations say together; None where single ones show it, or all are too few."""
    readings = recording.readings
    rows = readings[readings["phase"] == "zero"]
    if len(rows) < LEAST_FREEDOM or repeats_of(readings, "zero", 1).freedom >= LEAST_FREEDOM:
        return None
    time = rows["time_s"].to_numpy()
    force = force_on_sensor(rows[RAW].to_numpy(), recording.session.force)
    # 500 rows at once know a standard deviation to 4 %, and a root of their matrix is quick
    parts = np.array_split(np.arange(len(rows)), -(-len(rows) // 500))
    blocks = [_block(time[part], force[part]) for part in parts]
    repeats = sum((one.repeats for one in blocks), Repeats.none())
    trend, wander = (
        np.sqrt(np.mean([getattr(one, name) ** 2 for one in blocks], axis=0)) for name in ("trend", "wander")
    )
    return Zeros(repeats, trend, wander)


def _block(time: np.ndarray, force: np.ndarray) -> Zeros:
    """Return what zero rows (N,) [s], (N, 3) [N] in the order taken say, by restricted maximum likelihood of each axis.

    Their differences d have the covariance s^2 A + q B, A tridiagonal (2, -1), B diagonal of the steps in time: in the basis
    that makes both diagonal, y ~ N(trend x, s^2 m + q) entry by entry.
    """
    step = np.maximum(np.diff(time), 1e-6)  # two rows may be written with one time
    D = np.diff(np.eye(len(time)), axis=0)
    scaled = D / np.sqrt(step)[:, None]
    m, E = np.linalg.eigh(scaled @ scaled.T)
    basis = E.T @ scaled  # (N - 1, N): y of the rows themselves
    x = E.T @ np.sqrt(step)
    axes = [_axis(m, x, basis, z) for z in (force - force.mean(axis=0)).T]
    variance, freedom, residual, expected, trend, wander = (np.array(found) for found in zip(*axes))
    known = float(freedom.min())
    repeats = Repeats(variance * known, (residual**4).sum(axis=1), expected, known)
    return Zeros(repeats, trend, wander)


def _axis(m: np.ndarray, x: np.ndarray, basis: np.ndarray, z: np.ndarray) -> tuple:
    """Return of one axis' zero rows z (N,): variance of the noise, its degrees of freedom, residuals, trend and walk.

    Residuals are R e of the noise e, R = s^2 P of the generalised least squares; with them what `Repeats` expects of R.
    """
    y, m = basis @ z, np.maximum(m, m.max() * np.finfo(float).eps)

    def fitted(ratio: float) -> tuple[np.ndarray, float, float]:
        weight = 1 / (m + ratio)
        trend = (weight * x) @ y / ((weight * x) @ x)
        return weight, trend, float(weight @ (y - trend * x) ** 2 / (len(y) - 1))

    def cost(ratio: float) -> float:
        weight, _, variance = fitted(ratio)
        return (len(y) - 1) * np.log(variance) - np.log(weight).sum() + np.log((weight * x) @ x)

    ratio = _likeliest(cost, m) if np.ptp(z) > 0 else 0.0
    weight, trend, variance = fitted(ratio)
    root = basis.T @ np.diag(weight) @ basis
    along = basis.T @ (weight * x)
    R = root - np.outer(along, along) / ((weight * x) @ x)
    of_trend = variance / ((weight * x) @ x)
    information = np.array([[np.sum((m * weight) ** 2), m @ weight**2], [m @ weight**2, weight @ weight]])
    freedom = 1 / np.linalg.inv(information)[0, 0]  # 2 s^4 over the variance of the estimate of s^2
    expected = np.array([np.sum(np.diag(R) ** 2), np.sum(R**4)])
    return variance, freedom, R @ z, expected, np.hypot(trend, np.sqrt(of_trend)), np.sqrt(ratio * variance)


def _likeliest(cost, m: np.ndarray) -> float:
    """Return the ratio of the walk's variance per second to the noise's that costs least, 0 where none does better."""
    logs = np.linspace(np.log(m.min() * 1e-2), np.log(m.max() * 1e2), 30)
    best = logs[int(np.argmin([cost(np.exp(log)) for log in logs]))]
    width = logs[1] - logs[0]
    minimum = minimize_scalar(
        lambda log: cost(np.exp(log)), bounds=(best - width, best + width), method="bounded"
    )
    return float(np.exp(minimum.x)) if minimum.fun < cost(0.0) else 0.0


def depth_scatter(zero: DepthZero, stated_mm: float | None = None) -> tuple[float, float]:
    """Return the standard deviations [mm] of the depth from one indentation to the next and of the session's contact point;
    nan: missing.

    The one that the session does not find its zero by is 0 where nothing is said of either; where the contact point is
    stated and the indentations are not, repeats may show these. stated_mm stands in place of what is stated of `zero.by`.
    """
    press, session = zero.press_scatter_mm, zero.session_scatter_mm
    if zero.by == "session":
        unsaid = 0.0 if session is None else np.nan
        session = session if stated_mm is None else stated_mm
        return unsaid if press is None else press, np.nan if session is None else session
    press = press if stated_mm is None else stated_mm
    return np.nan if press is None else press, session or 0.0


def with_contact_point(found: Observations) -> Observations:
    """Fill scatter of the depth that no session states: from repeated indentations, or assumed and reported.

    Repeats show what differs from one indentation to the next; a session's contact point, which all its indentations share,
    is assumed.
    """
    press, session = found.press_depth_mm, found.session_depth_mm
    lone, shared = np.isnan(press), np.isnan(session)
    scatter = _repeated_contact_points(found, press != 0) if lone.any() else None
    stated = session > 0  # with a contact point that is stated, nothing is assumed of indentations
    filled = np.where(stated, 0.0, CONTACT_POINT_MM) if scatter is None else scatter
    said, unseen = [], lone & (scatter is None)
    if shared.any() or (unseen & ~stated).any():
        said.append(
            f"how well the contact point was found is not stated ({_keys(unseen & ~stated, shared)}):"
            f" {CONTACT_POINT_MM} mm is assumed"
        )
    if (unseen & stated).any():
        said.append(
            "the stage's repeatability is not stated (depth_zero.press_scatter_mm) and too few indentations are repeated to"
            " show it: indentations are taken to have no depth error of their own"
        )
    return replace(
        found,
        press_depth_mm=np.where(lone, filled, press),
        session_depth_mm=np.where(shared, CONTACT_POINT_MM, session),
        cannot_know=(*found.cannot_know, *said),
    )


def _keys(*missing: np.ndarray) -> str:
    """Return the keys of session.yaml that are missing: of indentations, of sessions (R,) bool each."""
    names = ("depth_zero.press_scatter_mm", "depth_zero.session_scatter_mm")
    return ", ".join(name for name, some in zip(names, missing) if some.any())


def _repeated_contact_points(found: Observations, of: np.ndarray) -> float | None:
    """Return the scatter [mm] of contact point that repeated indentations show in Fz, less the noise; None with few repeats.

    of (R,) bool: the readings that count. Of each indentation the depth by which all its loading readings are off their
    means, as the slope has it; indentations less places are the repeats.
    """
    table = found.table.assign(fz=found.force[:, 2], noise=found.noise_N[:, 2], zero=found.zero_N[:, 2])
    loads = table[(table["phase"] == "load") & of & np.isfinite(table["fz"])]
    squares, freedom = 0.0, 0
    for _, of_site in loads.groupby("site"):
        curve = of_site.groupby("depth_mm")["fz"].mean()
        if len(curve) < 2:
            continue
        slopes = pd.Series(np.gradient(curve.to_numpy(), curve.index.to_numpy()), curve.index)
        means = of_site.groupby("depth_mm")["fz"]
        repeated = of_site[means.transform("size") > 1]
        k, off = repeated["depth_mm"].map(slopes), repeated["fz"] - means.transform("mean")
        sums = pd.DataFrame(
            {
                "press": repeated["press"],
                "kf": k * off,
                "kk": k**2,
                "noise": (k * repeated["noise"]) ** 2,
                "zero": k * repeated["zero"],
            }
        )
        sums = sums.groupby("press").sum()
        sums = sums[sums["kk"] > 0]
        if len(sums) < 2:
            continue
        from_noise = ((sums["noise"] + sums["zero"] ** 2) / sums["kk"] ** 2).mean()
        squares += ((sums["kf"] / sums["kk"]) ** 2).sum() - (len(sums) - 1) * from_noise
        freedom += len(sums) - 1
    return float(np.sqrt(max(squares / freedom, 0.0))) if freedom >= LEAST_FREEDOM else None
