"""Tables of the network's errors, recomputed from saved predictions alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from gelforge.learning.judging.predictions import Predictions
from gelforge.learning.models.reliability import centre_of_pressure

AXES = ("x_N", "y_N", "z_N")


def rmse_table(predictions: Predictions) -> pd.DataFrame:
    """Return RMSE, RMSES, RMSET_FEM and RMSET_FT [N] per axis (Sferrazza et al. 2019, section V-B, table 3).

    RMSE over all bins and rows; RMSES over the entries whose true force is not zero; RMSET over the rows' total forces,
    against the sum of the true bins (FEM) or the readings (FT). RMSES_TRAINING is RMSES over rows that trained the network.

    Parameters
    ----------
    predictions : Predictions
        On test rows, and on rows that trained the network.

    Returns
    -------
    pandas.DataFrame
        A row for each error, a column for each axis [N]; NaN where no entry counts.
    """
    names = ("RMSE", "RMSES", "RMSES_TRAINING", "RMSET_FEM", "RMSET_FT")
    squares = {name: np.zeros(3) for name in names}
    counts = {name: np.zeros(3) for name in squares}
    for rows, predicted, true in predictions.blocks():
        difference = predicted - true
        contact = true != 0
        total = difference.sum(axis=1)  # (n, 3)
        measured = predicted.sum(axis=1) - predictions.ft[rows]
        known = np.isfinite(measured)
        for name, values, valid in (
            ("RMSE", difference, np.ones_like(contact)),
            ("RMSES", difference, contact),
            ("RMSET_FEM", total, np.ones_like(known)),
            ("RMSET_FT", measured, known),
        ):
            squares[name] += (np.where(valid, values, 0.0).reshape(-1, 3) ** 2).sum(axis=0)
            counts[name] += valid.reshape(-1, 3).sum(axis=0)
    for predicted, true in predictions.blocks_of_training():
        contact = true != 0
        squares["RMSES_TRAINING"] += np.where(contact, (predicted - true) ** 2, 0.0).sum(axis=(0, 1))
        counts["RMSES_TRAINING"] += contact.sum(axis=(0, 1))
    errors = [(name, *np.sqrt(_ratio(squares[name], counts[name]))) for name in squares]
    return pd.DataFrame(errors, columns=["error", *AXES])


@dataclass(frozen=True)
class RowErrors:
    """What a predictor's errors are on each row; what tables need of them."""

    square: np.ndarray  # (N, 3) sum of squared errors [N^2] of the bins whose true force is not zero
    count: np.ndarray  # (N, 3) how many bins these are
    total: np.ndarray  # (N, 3) predicted total force [N]
    true_total: np.ndarray  # (N, 3)
    distance: np.ndarray  # (N,) of the centres of pressure [mm], infinite where one of the two is not pressed
    seen: np.ndarray  # (N,) whether any force is predicted
    untouched: np.ndarray  # (N,)

    @classmethod
    def of(cls, predictions: Predictions, predictor: str = "network") -> RowErrors:
        """Return the errors of the network, a baseline, the `training mean` or `zero`."""
        constant = {"training mean": predictions.training_mean, "zero": np.zeros(3)}.get(predictor)
        baseline = predictor if predictor in predictions.baselines else None
        geometry = predictions.nx, predictions.ny, predictions.width_mm
        blocks = []
        for _, predicted, true in predictions.blocks(baseline):
            if constant is not None:
                predicted = np.broadcast_to(constant, true.shape)
            contact = true != 0
            gap = centre_of_pressure(predicted, *geometry) - centre_of_pressure(true, *geometry)
            blocks.append(
                (
                    np.where(contact, (predicted - true) ** 2, 0.0).sum(axis=1),
                    contact.sum(axis=1),
                    predicted.sum(axis=1),
                    true.sum(axis=1),
                    np.nan_to_num(np.hypot(*gap.T), nan=np.inf),
                    (predicted != 0).any(axis=(1, 2)),
                )
            )
        square, count, total, true_total, distance, seen = (np.concatenate(parts) for parts in zip(*blocks))
        return cls(square, count, total, true_total, distance, seen, predictions.untouched)

    def figures(self, rows: np.ndarray | slice = slice(None)) -> dict[str, float]:
        """Return the errors over some rows: RMSES of all axes and of each, total Fz [N], centre of pressure [mm].

        RMSES over all axes together is the formula as it is printed in Sferrazza et al. 2019. The centre of pressure is that
        of touched rows.
        """
        square, count = self.square[rows].sum(axis=0), self.count[rows].sum(axis=0)
        touched = ~self.untouched[rows]
        distance, error = self.distance[rows][touched], (self.total - self.true_total)[rows]
        rmses = np.sqrt(_ratio(square, count))
        return {
            "RMSES_N": float(np.sqrt(square.sum() / count.sum())) if count.any() else np.nan,
            **{f"RMSES_{axis}": float(value) for axis, value in zip(AXES, rmses)},
            "total_Fz_rms_N": _rms(error[:, 2]),
            "centre_of_pressure_median_mm": _quantile(distance, 0.5),
            "centre_of_pressure_p95_mm": _quantile(distance, 0.95),
            "untouched_Fz_rms_N": _rms(error[~touched, 2]),
        }


def baselines_table(predictions: Predictions) -> pd.DataFrame:
    """Return the network's errors next to those of what is simpler: what it must beat to be of use.

    Baselines on the same rows and inputs (`baselines`), the mean label of training, no force at all.

    Parameters
    ----------
    predictions : Predictions
        On test rows.

    Returns
    -------
    pandas.DataFrame
        A row for each predictor with the figures of RowErrors [N, mm].
    """
    names = ("network", *predictions.baselines, "training mean", "zero")
    rows = {name: RowErrors.of(predictions, name).figures() for name in names}
    return pd.DataFrame(rows.values(), index=pd.Index(rows, name="predictor")).reset_index()


# of the sensor's smaller width, from the nearest wall
WALL_SHARES = ((0.0, 0.2), (0.2, 0.35), (0.35, np.inf))


def errors_by_table(predictions: Predictions) -> pd.DataFrame:
    """Return the network's errors by depth, place, distance to training, session, phase and indenter: where it fails.

    Parameters
    ----------
    predictions : Predictions
        On test rows.

    Returns
    -------
    pandas.DataFrame
        by, class, rows, the figures of RowErrors [N, mm], and the share of rows whose total disagrees with inverse
        elasticity [-]. Classes without rows are left out.
    """
    errors, rows = RowErrors.of(predictions), []
    for by, name, chosen in _classes(predictions):
        if not chosen.any():
            continue
        row = {"by": by, "class": name, "rows": int(chosen.sum()), **errors.figures(chosen)}
        rows.append(row | {"disagreeing": _marked(predictions.disagreement[chosen])})
    return pd.DataFrame(rows)


def _classes(predictions: Predictions) -> Iterator[tuple[str, str, np.ndarray]]:
    """Yield kind and name of each class of rows, and which rows (N,) it has."""
    touched, depth = ~predictions.untouched, np.round(predictions.depth_mm, 3)
    yield "contact", "untouched", ~touched
    if not touched.any():
        return
    yield from _lengths("depth", depth, touched, 8)
    widths = predictions.width_mm
    share = np.minimum(predictions.position_mm, widths - predictions.position_mm).min(axis=1) / widths.min()
    for low, high in WALL_SHARES:
        end = " mm and more" if high == np.inf else f" to {high * widths.min():.3g} mm"
        yield "place", f"{low * widths.min():.3g}{end} from a wall", touched & (share >= low) & (share < high)
    away = np.round(predictions.nearest_training_mm, 2)
    yield from _lengths("nearest training site", away, touched, 4)
    for by in ("session", "phase", "indenter"):
        names = getattr(predictions, by)
        for name in np.unique(names[touched]):
            yield by, str(name), touched & (names == name)


def _lengths(
    by: str, length: np.ndarray, touched: np.ndarray, most: int
) -> Iterator[tuple[str, str, np.ndarray]]:
    """Yield classes of touched rows by a length (N,) [mm], each value its own where there are no more than `most`."""
    values = np.unique(length[touched])
    for group in np.array_split(values, min(len(values), most)):
        name = f"{group[0]:g} mm" if len(group) == 1 else f"{group[0]:g} to {group[-1]:g} mm"
        yield by, name, touched & (length >= group[0]) & (length <= group[-1])


CONTACT_N = 0.02  # a touch that is to be seen
LIGHT_N = 0.05


def reliability_table(predictions: Predictions) -> pd.DataFrame:
    """Return how far the network is to be trusted: zeros, contacts seen, light indentations, the centre, intervals.

    Fz of untouched images (rms); share of contacts of CONTACT_N and more that are seen; mean error of indentations up to
    LIGHT_N; the centre of pressure's distance (median, 95th percentile of touched rows). Of the bins that carry force, and
    of the totals of touched rows, the share in their 90 % intervals, and the intervals' mean half widths.

    Parameters
    ----------
    predictions : Predictions
        On test rows.

    Returns
    -------
    pandas.DataFrame
        quantity, value and unit.
    """
    errors = RowErrors.of(predictions)
    predicted, true, seen, distance = errors.total, errors.true_total, errors.seen, errors.distance
    touched, push = ~predictions.untouched, np.linalg.norm(true, axis=1)
    observable, light = push >= CONTACT_N, touched & (push <= LIGHT_N)
    rows = [
        ("Fz of untouched images, rms", _rms(predicted[~touched, 2]), "N"),
        (f"contacts of {CONTACT_N:g} N and more that are seen", _mean(seen[observable]), "1"),
        (f"mean error of Fz of indentations up to {LIGHT_N:g} N", _mean((predicted - true)[light, 2]), "N"),
        ("centre of pressure, median distance", _quantile(distance[touched], 0.5), "mm"),
        ("centre of pressure, 95th percentile", _quantile(distance[touched], 0.95), "mm"),
    ]
    rows += _coverage(predictions, touched) if predictions.has_intervals else []
    rows.append(
        ("rows whose total disagrees with inverse elasticity", _marked(predictions.disagreement), "1")
    )
    return pd.DataFrame(rows, columns=["quantity", "value", "unit"])


def _coverage(predictions: Predictions, touched: np.ndarray) -> list[tuple[str, float, str]]:
    """Return by kind and axis how many errors lie in their interval, and its mean half width.

    Of the bins' and totals' labels, and of the measured total force, whose intervals have the labels' uncertainty in them.
    """
    kinds = ("bins", "totals", "measured totals")
    held, width = ({kind: np.zeros(3) for kind in kinds} for _ in range(2))
    count = {kind: np.zeros(3) for kind in kinds}
    names = ("predicted_N", "true_N", "bin_half_N", "total_half_N", "total_half_true_N")
    for rows, predicted, true, of_bins, of_totals, of_true in predictions.columns(*names):
        predicted, true, on = predicted.astype(float), true.astype(float), touched[rows]
        total, measured = predicted.sum(axis=1), predictions.ft[rows]
        carries = np.broadcast_to((true != 0).any(axis=-1)[..., None], true.shape)
        pressed = np.broadcast_to(on[:, None], total.shape)
        for kind, off, half, where in (
            ("bins", predicted - true, of_bins, carries),
            ("totals", total - true.sum(axis=1), of_totals, pressed),
            ("measured totals", total - measured, of_true, pressed & np.isfinite(measured)),
        ):
            held[kind] += ((np.abs(off) <= half) & where).reshape(-1, 3).sum(axis=0)
            width[kind] += np.where(where, half, 0.0).reshape(-1, 3).sum(axis=0)
            count[kind] += where.reshape(-1, 3).sum(axis=0)
    quantities = (("share inside the 90 % interval", held, "1"), ("mean half width", width, "N"))
    return [
        (f"{kind}, {axis}: {what}", float(value), unit)
        for kind in kinds
        for what, sums, unit in quantities
        for axis, value in zip("xyz", _ratio(sums[kind], count[kind]))
    ]


def _marked(disagreement: np.ndarray) -> float:
    known = np.isfinite(disagreement)
    return _mean(disagreement[known] > 1)


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if len(values) else np.nan


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def _quantile(values: np.ndarray, share: float) -> float:
    return float(np.quantile(values, share, method="higher")) if len(values) else np.nan


def _ratio(total: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return total / count, NaN where nothing was counted."""
    return np.divide(total, count, out=np.full(np.shape(total), np.nan), where=count > 0)
