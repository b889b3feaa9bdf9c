"""How much of the network's error is optics, learning and mechanics, where a virtual lab knows the true forces and motion.

Of a row p is the prediction from its image, q that from the true motion as the flow shows it (`true_motion.FlowMap`), y the
label, t the true force. Then p - t = (p - q) + (q - y) + (y - t): optics, learning, mechanics.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

if TYPE_CHECKING:  # the report reads the names of parts from here; it needs no torch
    from gelforge.learning.judging.predictions import Predictions

COLUMNS = tuple(f"{what}_{axis}_N" for what in ("bins", "total") for axis in "xyz")
OPTICS, LEARNING, MECHANICS = PARTS = ("optics", "learning", "mechanics")
AGAINST_LABEL, AGAINST_TRUTH, CONTACT_POINT = "against the label", "against the truth", "contact point"


def error_budget_table(predictions: Predictions) -> pd.DataFrame | None:
    """Return rms errors of pressed bins and of totals of touched test rows [N], by part.

    `optics` and `learning` share out the mean square of p - y (`against the label`) by `shared_out`; `mechanics` is the rms
    of y - t and `against the truth` that of p - t; `contact point` that of the true force at the depth reached less that at
    the commanded one, which is in learning and in mechanics. Pressed bins are those whose label is not zero, as of RMSES.
    flow_px, flow_off_px, flow_off_mm, with optics: rms of the true motion over image regions, and of what the flow is off.

    Parameters
    ----------
    predictions : Predictions
        On test rows: p predicted, y label, t truth.

    Returns
    -------
    pandas.DataFrame or None
        A row for each part; None where no truth is known.
    """
    if not predictions.has_truth:
        return None
    names = ("bin_force_N", "contact_point_bin_N", "predicted_N", "flow_px", "flow_off_px")
    by_part: dict[str, list[np.ndarray]] = {}
    for rows, predicted, label, true, contact, from_motion, *flow in predictions.columns(
        "predicted_N", "true_N", *(f"truth/{name}" for name in names)
    ):
        on = ~predictions.untouched[rows]
        p, y, t, q, c = (part[on].astype(float) for part in (predicted, label, true, from_motion, contact))
        offs = {AGAINST_LABEL: p - y, OPTICS: p - q, MECHANICS: y - t, AGAINST_TRUTH: p - t, CONTACT_POINT: c}
        for name, off in offs.items():
            by_part.setdefault(name, []).append(off)
        by_part.setdefault("pressed", []).append(y != 0)
        by_part.setdefault("flow", []).append(np.stack(flow, axis=1)[on].astype(float))
    errors = {name: np.concatenate(parts) for name, parts in by_part.items()}
    return budget_of(errors, predictions.mm_per_px)


def budget_of(errors: dict[str, np.ndarray], mm_per_px: float) -> pd.DataFrame:
    """Return the table of errors (N, B, 3) [N] by name, `pressed` (N, B, 3) bool and `flow` (N, 2) [px]: moved, off."""
    pressed, flow = errors["pressed"], errors["flow"]
    rms: dict[str, list[float]] = {name: [] for name in (*PARTS, AGAINST_LABEL, AGAINST_TRUTH, CONTACT_POINT)}
    for of_totals in (False, True):
        for axis in range(3):
            parts = {
                name: off[..., axis].sum(axis=1) if of_totals else off[..., axis][pressed[..., axis]]
                for name, off in errors.items()
                if name in rms
            }
            parts[OPTICS], parts[LEARNING] = shared_out(parts[AGAINST_LABEL], parts[OPTICS])
            for name, values in rms.items():
                values.append(float(_rms(parts[name])))
    table = pd.DataFrame(rms.values(), columns=COLUMNS, index=pd.Index(rms, name="part")).reset_index()
    moved, off = (float(_rms(column)) for column in flow.T)
    only = (table["part"] == OPTICS).to_numpy()
    for name, value in (("flow_px", moved), ("flow_off_px", off), ("flow_off_mm", off * mm_per_px)):
        table[name] = np.where(only, value, np.nan)
    return table


def shared_out(error: np.ndarray, optics: np.ndarray) -> tuple[float, float]:
    """Return the rms that goes with optics and the rest of it, whose squares add to that of an error.

    error = o + l: <error^2> = <error o> + <error l>, each mean product the share of its part. A plain <o^2> would count
    what the network has learnt to undo: then o and l cancel. A share below zero or above the whole counts as none or all.
    """
    square = _mean(error**2)
    if not square > 0:
        return square, square
    share = np.clip(_mean(error * optics) / square, 0.0, 1.0)
    return float(np.sqrt(share * square)), float(np.sqrt((1 - share) * square))


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if np.size(values) else np.nan


def _rms(values: np.ndarray | float) -> float:
    return float(np.sqrt(_mean(np.square(values))))
