"""Predictions of the held-out cells, and the tables that are recomputed from them alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import torch

from gelforge.dataset.schema import COLUMNS, DatasetError
from gelforge.dataset.shard import ShardDataset
from gelforge.files import file_sha256
from gelforge.hdf5 import opened, writing
from gelforge.learning.data import FEATURE, LABEL
from gelforge.learning.model_file import load_model
from gelforge.learning.reliability import centre_of_pressure

FORMAT = "gelforge-predictions-2"
BLOCK = 256  # rows in memory at a time
AXES = ("x_N", "y_N", "z_N")
KEPT = ("cell", "session", "press", "image_index", "position_mm", "depth_mm", "total_force_ft_N", "untouched")


# -------------------------------------------------------------------------------------------- predictions
def predict_test_rows(
    model_path: str | Path, shards: Sequence[str | Path], out: str | Path, threads: int = 2
) -> int:
    """Write the predictions of every row of the test split and return how many there are."""
    torch.set_num_threads(threads)
    model = load_model(model_path)
    rows = ShardDataset(shards, "test")
    if not len(rows):
        raise DatasetError(f"{shards[0]}: no test row in {len(shards)} shards; give the study more cells")
    bins, nx = model.scaling.output_mean.shape[0], model.settings["bins"]["nx"]
    with writing(out) as file:
        file.attrs["format"], file.attrs["synthetic"] = FORMAT, model.settings["synthetic"]
        file.attrs["model_sha256"] = file_sha256(model_path)
        file.attrs["bins_nx"], file.attrs["bins_ny"] = nx, bins // nx
        file.attrs["sensor_width_mm"] = model.settings["sensor_width_mm"]
        half = ("bin_half_N",) if model.intervals else ()
        for name in ("predicted_N", "true_N", *half):
            _create(file, name, (len(rows), bins, 3), "f4", "N", _DESCRIPTIONS[name], chunks=(1, bins, 3))
        if model.intervals:
            _create(file, "total_half_N", (len(rows), 3), "f8", "N", _DESCRIPTIONS["total_half_N"])
        for name in KEPT:
            column = COLUMNS[name]
            kind = h5py.string_dtype() if column.kind == "text" else column.kind
            _create(file, name, (len(rows), *column.sizes(0, bins)), kind, column.unit, column.description)
        mean = training_mean(ShardDataset(shards, "train"))
        _create(file, "training_mean_N", mean.shape, "f8", "N", _DESCRIPTIONS["training_mean_N"])[...] = mean
        ranges = label_ranges(shards)
        _create(file, "label_range_N", ranges.shape, "f8", "N", _DESCRIPTIONS["label_range_N"])[...] = ranges
        start = 0
        for block in rows.batches((FEATURE, LABEL, *KEPT), BLOCK):
            stop = start + len(block["cell"])
            predicted = model.predict(block[FEATURE])
            file["predicted_N"][start:stop] = predicted
            if model.intervals:
                file["bin_half_N"][start:stop] = model.intervals.of_bins(predicted)
                file["total_half_N"][start:stop] = model.intervals.of_totals(predicted)
            file["true_N"][start:stop] = block[LABEL]
            for name in KEPT:
                file[name][start:stop] = block[name]
            start = stop
    return len(rows)


_DESCRIPTIONS = {
    "predicted_N": "force distribution predicted by the network (N, B, 3)",
    "true_N": "force distribution of the finite-element model, the label (N, B, 3)",
    "bin_half_N": "half width of the 90 % interval of each bin's force (N, B, 3)",
    "total_half_N": "half width of the 90 % interval of the total force (N, 3)",
    "training_mean_N": "mean label over the touched training rows (B, 3)",
    "label_range_N": "range of all labels: per bin and in total; least and greatest; axis (2, 2, 3)",
}


def _create(
    file: h5py.File, name: str, shape, kind, unit: str, description: str, chunks=None
) -> h5py.Dataset:
    compression = (
        {"compression": "gzip", "compression_opts": 1, "shuffle": True, "chunks": chunks} if chunks else {}
    )
    data = file.create_dataset(name, shape, kind, **compression)
    data.attrs["units"], data.attrs["description"] = unit, description
    return data


def training_mean(rows: ShardDataset) -> np.ndarray:
    """Return the mean label (B, 3) [N] over touched rows, a block at a time."""
    total, count = 0.0, 0
    for block in rows.batches((LABEL, "untouched"), BLOCK):
        touched = ~block["untouched"]
        total = total + block[LABEL][touched].sum(axis=0, dtype=np.float64)
        count += int(touched.sum())
    if not count:
        raise DatasetError("no touched training row; give the study more cells")
    return total / count


class Predictions:
    """A predictions file, read a block at a time; the small columns are attributes of their own."""

    def __init__(self, path: str | Path):
        self.path = Path(path)
        with self._open() as file:
            self.model_sha256 = str(file.attrs["model_sha256"])
            self.nx, self.ny = int(file.attrs["bins_nx"]), int(file.attrs["bins_ny"])
            self.width_mm = np.array(file.attrs["sensor_width_mm"])
            self.untouched, self.ft = file["untouched"][()], file["total_force_ft_N"][()]
            self.has_intervals = "bin_half_N" in file
            self.training_mean, self.label_range = file["training_mean_N"][()], file["label_range_N"][()]

    def check_model(self, model_path: str | Path) -> None:
        """Raise DatasetError for predictions of another model than this file's; a file that is not there says nothing."""
        if Path(model_path).is_file() and file_sha256(model_path) != self.model_sha256:
            raise DatasetError(
                f"{self.path}: predictions of another model than {model_path}; evaluate it again (snakemake -R {self.path})"
            )

    def blocks(self) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """Yield rows, predicted and true distributions (n, B, 3) [N]."""
        with self._open() as file:
            for start in range(0, len(self.untouched), BLOCK):
                rows = slice(start, min(start + BLOCK, len(self.untouched)))
                yield rows, file["predicted_N"][rows].astype(float), file["true_N"][rows].astype(float)

    def halves(self) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """Yield rows, half widths of the intervals of bins (n, B, 3) and of totals (n, 3) [N]; nothing without intervals."""
        with self._open() as file:
            for start in range(0, len(self.untouched) if self.has_intervals else 0, BLOCK):
                rows = slice(start, min(start + BLOCK, len(self.untouched)))
                yield rows, file["bin_half_N"][rows].astype(float), file["total_half_N"][rows]

    def _open(self) -> h5py.File:
        remedy = f"evaluate the model again (snakemake -R {self.path})"
        return opened(self.path, FORMAT, remedy, DatasetError)


# ------------------------------------------------------------------------------------------------- tables
def rmse_table(predictions: Predictions) -> pd.DataFrame:
    """Return RMSE, RMSES, RMSET_FEM and RMSET_FT [N] per axis (Sferrazza et al. 2019, section V-B, table 3).

    RMSE over all bins and rows; RMSES over the entries whose true force is not zero; RMSET over the rows' total forces,
    against the sum of the true bins (FEM) or the readings (FT).
    """
    squares = {name: np.zeros(3) for name in ("RMSE", "RMSES", "RMSET_FEM", "RMSET_FT")}
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
    rows_ = [(name, *np.sqrt(_ratio(squares[name], counts[name]))) for name in squares]
    return pd.DataFrame(rows_, columns=["error", *AXES])


def label_ranges(shards: Sequence[str | Path]) -> np.ndarray:
    """Return the least and greatest true force (2, 2, 3) [N] of all rows: per bin and in total, least and greatest, axis."""
    low, high = np.full((2, 3), np.inf), np.full((2, 3), -np.inf)
    for block in ShardDataset(shards).batches((LABEL,), BLOCK):
        label = block[LABEL].astype(float)
        total = label.sum(axis=1)
        low = np.minimum(low, [label.min(axis=(0, 1)), total.min(axis=0)])
        high = np.maximum(high, [label.max(axis=(0, 1)), total.max(axis=0)])
    if not np.isfinite(low).all():
        raise DatasetError(
            "no label at all; every cell of the study failed, see the shards' attribute failed_cells"
        )
    return np.stack([low, high], axis=1)


def force_ranges_table(ranges: np.ndarray) -> pd.DataFrame:
    """Return the ranges of label_ranges (2, 2, 3) [N] as a table (Sferrazza et al. 2019, table 4)."""
    columns = [f"{axis}_{end}_N" for axis in "xyz" for end in ("min", "max")]
    rows = [(name, *ranges[i].T.ravel()) for i, name in enumerate(("force per bin", "total force"))]
    return pd.DataFrame(rows, columns=["quantity", *columns])


def baselines_table(predictions: Predictions) -> pd.DataFrame:
    """Return what the network must beat: the same errors of itself, of the training-mean map and of no force at all.

    Total Fz: rms error over the range of the true total Fz, all held-out rows. RMSES over all axes together, which is
    the formula as it is printed in Sferrazza et al. 2019, and per axis as in rmse_table. Centre of pressure: median
    distance [mm] over the touched rows; a row predicted as not pressed counts as infinitely far. The last row, `limit`,
    is what is asked of the network: it is half the training mean's RMSES.
    """
    maps: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "network": lambda predicted: predicted,
        "training mean": lambda predicted: np.broadcast_to(predictions.training_mean, predicted.shape),
        "zero": np.zeros_like,
    }
    rows = [(name, *_errors(predictions, of)) for name, of in maps.items()]
    sparse = ["RMSES_N", *(f"RMSES_{axis}" for axis in AXES)]
    columns = ["predictor", "total_Fz_rms_over_range", *sparse, "centre_of_pressure_median_mm"]
    table = pd.DataFrame(rows, columns=columns)
    half = 0.5 * table.loc[table["predictor"] == "training mean", "RMSES_N"].item()
    table.loc[len(table)] = ["limit", 0.15, half, np.nan, np.nan, np.nan, 2.0]
    return table


def _errors(predictions: Predictions, of: Callable[[np.ndarray], np.ndarray]) -> tuple[float, ...]:
    """Return rms of total Fz over its range, RMSES, RMSES of x, y, z [N] and the centre of pressure's distance [mm]."""
    geometry = predictions.nx, predictions.ny, predictions.width_mm
    square, count, error_z, true_z, distance = np.zeros(3), np.zeros(3), [], [], []
    for rows, predicted, true in predictions.blocks():
        judged, contact = of(predicted), true != 0
        square += np.where(contact, (judged - true) ** 2, 0.0).sum(axis=(0, 1))
        count += contact.sum(axis=(0, 1))
        error_z.append((judged - true)[..., 2].sum(axis=1))
        true_z.append(true[..., 2].sum(axis=1))
        gap = centre_of_pressure(judged, *geometry) - centre_of_pressure(true, *geometry)
        distance.append(np.nan_to_num(np.hypot(*gap.T), nan=np.inf)[~predictions.untouched[rows]])
    error, spread, far = np.concatenate(error_z), np.ptp(np.concatenate(true_z)), np.concatenate(distance)
    return (
        np.sqrt(np.mean(error**2)) / spread if spread > 0 else np.nan,
        float(np.sqrt(_ratio(square.sum(keepdims=True), count.sum(keepdims=True)))[0]),
        *np.sqrt(_ratio(square, count)),
        float(np.median(far)) if len(far) else np.nan,
    )


CONTACT_N = 0.02  # a touch that is to be seen
LIGHT_N = 0.05


def reliability_table(predictions: Predictions) -> pd.DataFrame:
    """Return how far the network is to be trusted: zeros, contacts seen, light presses, the centre, intervals.

    quantity, value, unit: Fz of untouched images (rms); share of contacts of CONTACT_N and more that are seen; mean error of
    presses up to LIGHT_N; the centre of pressure's distance (median, 95th percentile of touched rows); how many of the bins
    that carry force, and of the totals of touched rows, lie in their 90 % intervals, and the intervals' mean half widths.
    """
    geometry = predictions.nx, predictions.ny, predictions.width_mm
    parts: dict[str, list] = {name: [] for name in ("predicted", "true", "seen", "distance")}
    for _, predicted, true in predictions.blocks():
        parts["predicted"].append(predicted.sum(axis=1))
        parts["true"].append(true.sum(axis=1))
        parts["seen"].append(np.abs(predicted).max(axis=(1, 2)) > 0)
        gap = centre_of_pressure(predicted, *geometry) - centre_of_pressure(true, *geometry)
        parts["distance"].append(np.nan_to_num(np.hypot(*gap.T), nan=np.inf))
    predicted, true, seen, distance = (np.concatenate(parts[name]) for name in parts)
    touched, push = ~predictions.untouched, np.linalg.norm(true, axis=1)
    felt, light = push >= CONTACT_N, touched & (push <= LIGHT_N)
    rows = [
        ("Fz of untouched images, rms", _rms(predicted[~touched, 2]), "N"),
        (f"contacts of {1e3 * CONTACT_N:g} mN and more that are seen", _mean(seen[felt]), "1"),
        (f"mean error of Fz of presses up to {1e3 * LIGHT_N:g} mN", _mean((predicted - true)[light, 2]), "N"),
        ("centre of pressure, median distance", _quantile(distance[touched], 0.5), "mm"),
        ("centre of pressure, 95th percentile", _quantile(distance[touched], 0.95), "mm"),
    ]
    rows += _coverage(predictions, touched) if predictions.has_intervals else []
    return pd.DataFrame(rows, columns=["quantity", "value", "unit"])


def _coverage(predictions: Predictions, touched: np.ndarray) -> list[tuple[str, float, str]]:
    held = {name: np.zeros(3) for name in ("bins", "totals")}
    width, count = {name: np.zeros(3) for name in held}, dict.fromkeys(held, 0)
    for (rows, predicted, true), (_, of_bins, of_totals) in zip(predictions.blocks(), predictions.halves()):
        error, carries, on = np.abs(predicted - true), (true != 0).any(axis=-1), touched[rows]
        total = np.abs((predicted - true).sum(axis=1))
        for name, off, half, where in (("bins", error, of_bins, carries), ("totals", total, of_totals, on)):
            held[name] += (off[where] <= half[where]).sum(axis=0)
            width[name] += half[where].sum(axis=0)
            count[name] += int(where.sum())
    return [
        (f"{name}, {axis}: {what}", float(_ratio(sums[name], np.full(3, float(count[name])))[i]), unit)
        for name in held
        for what, sums, unit in (
            ("share inside the 90 % interval", held, "1"),
            ("mean half width", width, "N"),
        )
        for i, axis in enumerate("xyz")
    ]


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if len(values) else np.nan


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def _quantile(values: np.ndarray, share: float) -> float:
    return float(np.quantile(values, share, method="higher")) if len(values) else np.nan


def _ratio(total: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return total / count, NaN where nothing was counted."""
    return np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)
