"""What a laboratory would do instead: gain and offset, a Gaussian process on the residual, stepwise regression by BIC, and
calibration of all effects at once next to a Gaussian process.

They get more than the tool: the generator's own base forces, and the last two its own linearised effects.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import chi2

from .draw import NEEDS, base_world
from .kinds import KINDS
from .library import Library
from .recording import FORCE, Instrument, depth_errors, with_circumstances
from .score import CONFIDENT, Judged, share_of_gain
from .sensors import SMALL, Sensor
from .world import held, zeroed

ALARM_P = 0.025
# Length over the plane and over depth [mm], size over the readings' median standard deviation, of Gaussian processes.
PROCESSES = tuple(itertools.product((3.0, 8.0), (0.4, 1.2), (0.5, 1.0, 2.0, 4.0)))
STEPS = 3  # effects that stepwise regression takes at most


@dataclass(frozen=True)
class Table:
    """A recording's readings under load as numbers (n,): residuals in standard deviations, depth errors on the diagonal."""

    rows: pd.DataFrame  # all rows
    base: np.ndarray  # (R, 3) [N]
    oracle: np.ndarray  # (R, 3) [N]
    measured: np.ndarray  # (R, 3) [N], zero subtracted
    sigma: np.ndarray  # (R, 3) [N]
    train: np.ndarray  # (R,) bool


def read_rows(case: Path, sensor: Sensor = SMALL) -> tuple[pd.DataFrame, np.ndarray]:
    """Return the rows of a written recording as the generator's `timeline` has them, and the readings (R, 3) [N]."""
    parts = []
    for number, folder in enumerate(sorted((case / "recordings").iterdir())):
        parts.append(pd.read_csv(folder / "indentations.csv").assign(session=number))
    rows = pd.concat(parts, ignore_index=True)
    rows[["x_mm", "y_mm"]] -= sensor.middle
    rows["at_s"] = rows["time_s"] - rows["order"] * sensor.plan.press_s
    deepest = rows["depth_mm"].groupby([rows["session"], rows["order"]]).transform("max")
    sign = rows["phase"].map({"load": 1.0, "unload": -1.0}).fillna(0.0)
    return rows.assign(deepest_mm=deepest, speed=sensor.plan.speed * sign), rows[FORCE].to_numpy()


def table_of(library: Library, case: Path, truth: dict) -> Table:
    """Return a written case for the baselines, as `table_from` does."""
    instrument = Instrument(
        **{k: tuple(v) if isinstance(v, list) else v for k, v in truth["instrument"].items()}
    )
    rows, readings = read_rows(case, library.sensor)
    return table_from(library, truth, instrument, with_circumstances(rows, instrument), readings)


def table_from(
    library: Library, truth: dict, instrument: Instrument, rows: pd.DataFrame, readings: np.ndarray
) -> Table:
    """Return a recording for the baselines; a quarter of the places and the deepest presses elsewhere are held out."""
    world = base_world(library, truth["base"])
    slope = (world.forces(rows, 0.005) - world.forces(rows, -0.005)) / 0.01
    sigma = np.sqrt(instrument.sigma_N**2 + slope**2 * sum(size**2 for _, size in depth_errors(instrument)))
    places = sorted(set(zip(rows["x_mm"].round(3), rows["y_mm"].round(3))))
    rng = np.random.default_rng(int(truth["case"][1:]))
    out = {places[k] for k in rng.choice(len(places), len(places) // 4, replace=False)}
    there = np.array([(x, y) in out for x, y in zip(rows["x_mm"].round(3), rows["y_mm"].round(3))])
    train = held(rows) & ~there & (rows["depth_mm"] < rows["depth_mm"].max()).to_numpy()
    base = zeroed(rows, world.forces(rows), instrument.tared)
    return Table(
        rows,
        base,
        np.array(truth["readings"]["force_N"]),
        zeroed(rows, readings, instrument.tared),
        sigma,
        train,
    )


def gain_and_offset(table: Table) -> tuple[str, tuple, np.ndarray]:
    """Return state, answer and forces of a gain and an offset of every axis, fitted to the training readings."""
    after, fall, best = table.base.copy(), 0.0, ("", 0.0)
    for axis in range(3):
        on, sigma = table.train, table.sigma[:, axis]
        A = np.stack([table.base[:, axis], np.ones(len(sigma))], axis=1) / sigma[:, None]
        r = (table.measured - table.base)[:, axis] / sigma
        c, *_ = np.linalg.lstsq(A[on], r[on], rcond=None)
        fall += float(r[on] @ r[on] - np.sum((r[on] - A[on] @ c) ** 2))
        for k, name in enumerate(("force_gain", "force_offset")):
            alone = (A[on, k] @ r[on]) ** 2 / max(A[on, k] @ A[on, k], 1e-300)
            best = max(best, (name, float(alone)), key=lambda pair: pair[1])
        after[:, axis] += table.sigma[:, axis] * (A @ c)
    alarm = chi2.sf(fall, 6) < ALARM_P
    return ("identified", (((best[0],), 1.0),), after) if alarm else ("consistent", (), after)


def gaussian_process(table: Table) -> tuple[str, tuple, np.ndarray]:
    """Return state, answer (it can name nothing) and forces of a Gaussian process over place and depth, per axis."""
    after, gain = table.base.copy(), 0.0
    discrepancies = [_discrepancies(table, process) for process in PROCESSES]
    for axis in range(3):
        r, s = (table.measured - table.base)[:, axis], table.sigma[:, axis]
        on = np.flatnonzero(table.train)
        best = (_log_density(np.diag(s[on] ** 2), r[on]), None)
        for by_axis in discrepancies:
            covariance = by_axis[axis]
            here = _log_density(covariance[np.ix_(on, on)] + np.diag(s[on] ** 2), r[on])
            if here > best[0] + 1e-9:
                best = (here, covariance)
        gain += best[0] - _log_density(np.diag(s[on] ** 2), r[on])
        if best[1] is not None:
            weights = np.linalg.solve(best[1][np.ix_(on, on)] + np.diag(s[on] ** 2), r[on])
            after[:, axis] += best[1][:, on] @ weights
    return ("unexplained" if chi2.sf(2 * gain, 9) < ALARM_P else "consistent"), (), after


def stepwise_bic(table: Table, columns: dict[str, np.ndarray]) -> tuple[str, tuple, np.ndarray]:
    """Return state, answer and forces of effects taken in while they lower BIC; what it takes it is sure of."""
    on = table.train
    r = ((table.measured - table.base) / table.sigma)[on].ravel()
    whitened = {name: (c / table.sigma[:, :, None])[on].reshape(len(r), -1) for name, c in columns.items()}
    chosen: list[str] = []
    bic = float(r @ r)
    while len(chosen) < STEPS:
        tried = {}
        for name in whitened:
            if name not in chosen:
                A = np.hstack([whitened[n] for n in (*chosen, name)])
                c, *_ = np.linalg.lstsq(A, r, rcond=None)
                tried[name] = float(np.sum((r - A @ c) ** 2) + A.shape[1] * np.log(len(r)))
        best = min(tried, key=tried.get)
        if tried[best] >= bic:
            break
        chosen, bic = [*chosen, best], tried[best]
    if not chosen:
        return "consistent", (), table.base
    A = np.hstack([whitened[n] for n in chosen])
    c, *_ = np.linalg.lstsq(A, r, rcond=None)
    after = table.base + np.concatenate([columns[n] for n in chosen], axis=2) @ c
    return "identified", tuple(((name,), 1.0) for name in chosen), after


def kennedy_ohagan(table: Table, columns: dict[str, np.ndarray]) -> tuple[str, tuple, np.ndarray]:
    """Return state, answer and forces of all effects calibrated at once next to a discrepancy (Kennedy & O'Hagan 2001).

    Values have the prior N(0, 1) in units of plausible ones, the discrepancy is a Gaussian process over place and depth by
    axis, with the length scales and size of most evidence, or none. All is linear and normal, so the posterior is exact. An
    effect is in the answer with the probability of its values' credible region that just leaves 0 out.
    """
    names, on = list(columns), table.train
    A = np.concatenate([columns[name] for name in names], axis=2)
    parts = {process: _discrepancies(table, process) for process in (None, *PROCESSES)}
    evidence = {process: _calibrated(table, A, K, on)[0] for process, K in parts.items()}
    best = max(evidence, key=evidence.__getitem__)
    _, mean, spread, after = _calibrated(table, A, parts[best], on)
    nothing = sum(
        _log_density(np.diag(table.sigma[on, k] ** 2), (table.measured - table.base)[on, k]) for k in range(3)
    )
    owner, answer = np.repeat(range(len(names)), [columns[name].shape[2] for name in names]), []
    for k, name in enumerate(names):
        m, S = mean[owner == k], spread[np.ix_(owner == k, owner == k)]
        answer.append(((name,), float(chi2.cdf(m @ np.linalg.solve(S, m), len(m)))))
    sure = tuple(sorted((one for one in answer if one[1] >= CONFIDENT), key=lambda one: -one[1]))
    if sure:
        return "identified", sure, after
    # evidence against the exact base: by chance at most so likely (Markov)
    alarm = np.exp(-max(evidence[best] - np.log(len(parts)) - nothing, 0.0)) < ALARM_P
    return ("unexplained" if alarm else "consistent"), (), after


def _discrepancies(table: Table, process: tuple | None) -> list[np.ndarray]:
    """Return by axis the covariance (R, R) [N^2] of a discrepancy with length, depth scale [mm] and size; none is zero."""
    x = table.rows[["x_mm", "y_mm", "depth_mm"]].to_numpy()
    if process is None:
        return [np.zeros((len(x), len(x)))] * 3
    length, deep, size = process
    K = np.exp(-0.5 * _square_distance(x / [length, length, deep]))
    return [(size * np.median(table.sigma[table.train, axis])) ** 2 * K for axis in range(3)]


def _calibrated(table: Table, A: np.ndarray, K: list[np.ndarray], on: np.ndarray) -> tuple:
    """Return log evidence, mean and covariance of the values, and the forces (R, 3) [N] that chosen readings predict."""
    p = A.shape[2]
    H, b, fit, evidence = np.eye(p), np.zeros(p), [], 0.0
    residual = table.measured - table.base
    for axis in range(3):
        C = K[axis][np.ix_(on, on)] + np.diag(table.sigma[on, axis] ** 2)
        factor, J, r = cho_factor(C, lower=True), A[on, axis], residual[on, axis]
        H, b = H + J.T @ cho_solve(factor, J), b + J.T @ cho_solve(factor, r)
        evidence += _log_density(C, r)
        fit.append((factor, J, r))
    spread = np.linalg.inv(H)
    mean = spread @ b
    evidence += 0.5 * float(b @ mean) - 0.5 * float(np.linalg.slogdet(H)[1])
    after = table.base + A @ mean
    for axis, (factor, J, r) in enumerate(fit):
        after[:, axis] += K[axis][:, on] @ cho_solve(factor, r - J @ mean)
    return evidence, mean, spread, after


SHAPES = {  # the directions and constants at which stepwise regression knows the effects
    "sign": [{"sign": 1.0}],
    "direction": [{"x": 1.0, "y": 0.0}, {"x": 0.0, "y": 1.0}],
    "gains": [
        {"gx": 1.0, "gy": 0.0, "gz": 0.0},
        {"gx": 0.0, "gy": 1.0, "gz": 0.0},
        {"gx": 0.0, "gy": 0.0, "gz": 1.0},
    ],
    "offsets": [
        {"ox": 1.0, "oy": 0.0, "oz": 0.0},
        {"ox": 0.0, "oy": 1.0, "oz": 0.0},
        {"ox": 0.0, "oy": 0.0, "oz": 1.0},
    ],
    "angles": [
        {"a": 1.0, "b": 0.0, "c": 0.0},
        {"a": 0.0, "b": 1.0, "c": 0.0},
        {"a": 0.0, "b": 0.0, "c": 1.0},
    ],
}
CONSTANTS = {
    "t0": 0.5,
    "n": 0.6,
    "w0": 1.2,
    "most": 0.6,
    "spread": 2.0,
    "give_N": 0.05,
    "warm_s": 300.0,
    "place": "inner",
    "turns": 0,
}
SHAPE_OF = {
    "wedge": "direction", "turned body": "direction", "pressed elsewhere": "direction", "amplifier gains": "gains",
    "zero left": "offsets", "warming up": "offsets", "turned sensor": "angles", "backlash": "direction",
    "slowing creep of the zero": "offsets",
}  # fmt: skip


def linearised(library: Library, table: Table, truth: dict) -> dict[str, np.ndarray]:
    """Return the generator's own effects (R, 3, p), linearised at a fifth of a plausible value, by their names."""
    solved = set(library.changes) | {name for name, _ in library.defects}
    tared = truth["instrument"]["tared"]
    columns = {}
    for form, kind in KINDS.items():
        if (
            any(name not in solved for name in NEEDS.get(form, []))
            or kind.base not in ("", truth["base"])
            or (kind.sessions == 2 and table.rows["session"].max() == 0)
        ):
            continue
        parts = []
        for hyperparameters in SHAPES[SHAPE_OF.get(form, "sign")]:
            world = base_world(library, truth["base"])
            kind.put(world, 0.2, {**CONSTANTS, **hyperparameters})
            parts.append((zeroed(table.rows, world.forces(table.rows), tared) - table.base) / 0.2)
        column = np.stack(parts, axis=2)
        if np.abs(column).max() > 1e-9:
            columns[kind.name] = column
    return columns


def judged_by_baselines(library: Library, case: Path, truth: dict) -> dict[str, Judged]:
    """Return what each baseline says of a case."""
    table = table_of(library, case, truth)
    columns = linearised(library, table, truth)
    said = {
        "gain and offset": gain_and_offset(table),
        "Gaussian process": gaussian_process(table),
        "stepwise BIC": stepwise_bic(table, columns),
        "Kennedy-O'Hagan": kennedy_ohagan(table, columns),
    }
    return {name: _judged(truth, table, *answer) for name, answer in said.items()}


def _judged(truth, table: Table, state: str, answer: tuple, after: np.ndarray) -> Judged:
    out = held(table.rows) & ~table.train
    square = [
        float(np.mean(((table.measured - other) / table.sigma)[out] ** 2))
        for other in (table.base, after, table.oracle)
    ]
    true = tuple(effect["name"] for effect in truth["effects"])
    gain = share_of_gain(*square) if true else float("nan")
    ratio = float(np.sqrt(square[1] / square[2])) if true else float("nan")
    each = tuple(float(effect["snr"]) for effect in truth["effects"])
    return Judged(truth["content"], truth["snr"], true, state, answer, (), gain, ratio, snr_each=each)


def _log_density(covariance, r) -> float:
    factor = cho_factor(covariance, lower=True)
    return float(-0.5 * r @ cho_solve(factor, r) - np.log(np.diag(factor[0])).sum())


def _square_distance(x) -> np.ndarray:
    square = (x**2).sum(axis=1)
    return np.maximum(square[:, None] + square[None] - 2 * x @ x.T, 0.0)
