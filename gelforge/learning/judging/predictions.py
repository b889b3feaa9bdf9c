"""Predictions of the held-out cells, by the network and by the baselines, and of rows it was trained on, next to labels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import torch

from gelforge.config import Study
from gelforge.dataset.ranges import label_ranges
from gelforge.dataset.schema import COLUMNS, DatasetError
from gelforge.dataset.shard import ShardDataset, shard_attributes
from gelforge.dataset.splits import nearest_mm
from gelforge.files import file_sha256
from gelforge.hdf5 import opened, writing
from gelforge.learning.basis.data import (
    BLOCK,
    FEATURE,
    LABEL,
    at_most,
    measure_scaling,
    one_of_each_press,
    positions_of,
    training_and_validation,
)
from gelforge.learning.judging.baselines import Baseline, InverseBaseline, fit_baselines, fit_inverse
from gelforge.learning.judging.true_motion import Truth, write_truth
from gelforge.learning.models.model_file import Model, load_model
from gelforge.learning.models.views import check_same_images, views_of
from gelforge.progress import tracked

FORMAT = "gelforge-predictions-5"
TRAINING_ROWS = 2000  # at most, whose error stands next to that of test rows
KEPT = (
    *("cell", "session", "press", "image_index", "position_mm", "depth_mm", "total_force_ft_N"),
    *("untouched", "phase", "total_force_fem_sigma_N"),
)


@dataclass(frozen=True)
class LearningSets:
    """The shards that a network learns from and those that test it."""

    learnt: Sequence[str | Path]  # their rows of the split train
    tested: Sequence[str | Path]
    split: str | None = "test"  # None: all rows of tested, where nothing was learnt from them

    @classmethod
    def of(cls, shards: Sequence[str | Path]) -> LearningSets:
        """Return the two sides of one dataset's split."""
        return cls(shards, shards)


def predict_test_rows(
    model_path: str | Path,
    sets: LearningSets,
    study: Study,
    out: str | Path,
    threads: int = 2,
    truth: Truth | None = None,
) -> int:
    """Write the predictions of every row that tests, the network's and the baselines'.

    The network's of rows that it was trained on are written too: one image of each indentation, at most TRAINING_ROWS. The
    baselines are fitted here, on the rows that the network was trained on.

    Parameters
    ----------
    model_path : str or Path
        model.pt.
    sets : LearningSets
        Shards and their splits.
    study : Study
        Sensor, features and learning.
    out : str or Path
        HDF5 file.
    threads : int
        Of PyTorch.
    truth : Truth, optional
        Of the recordings, where a virtual lab made them.

    Returns
    -------
    int
        Number of rows.

    Raises
    ------
    ModelError
        For a model that is damaged or of other features.
    """
    torch.set_num_threads(threads)
    model = load_model(model_path)
    rows, learnt = ShardDataset(sets.tested, sets.split), ShardDataset(sets.learnt, "train")
    if not len(rows):
        raise DatasetError(
            f"{sets.tested[0]}: no test row in {len(sets.tested)} shards; give the study more sites"
        )
    check_same_images(model, study.features.regions, views_of(sets.tested))
    bins, nx = model.scaling.output_mean.shape[0], model.settings["bins"]["nx"]
    grid = nx, bins // nx, np.array(model.settings["sensor_width_mm"])
    with writing(out) as file:
        file.attrs["format"], file.attrs["synthetic"] = FORMAT, model.settings["synthetic"]
        file.attrs["model_sha256"] = file_sha256(model_path)
        file.attrs["bins_nx"], file.attrs["bins_ny"], file.attrs["sensor_width_mm"] = grid
        for name, values in (
            ("training_mean_N", training_mean(learnt)),
            ("label_range_N", label_ranges(sets.tested)),
        ):
            _create(file, name, values.shape, "f8", "N")[...] = values
        _write_rows(file, rows, model, bins)
        sides = training_and_validation(learnt, learnt.paths, study)
        _write_training_rows(file, learnt, sides[0], model, study.seed)
        trained = np.array(list(positions_of(learnt).values()))
        away = nearest_mm(file["position_mm"][()], trained, study.sensor)
        _create(file, "nearest_training_mm", away.shape, "f8", "mm")[...] = away
        for baseline in _baselines(learnt, *sides, model, grid, study.seed):
            _write_baseline(file, rows, baseline, bins)
        if truth:
            both = [path for path in sets.learnt if path in sets.tested]
            write_truth(file, model, rows, ShardDataset(both, "train"), truth)
    return len(rows)


def _write_rows(file: h5py.File, rows: ShardDataset, model: Model, bins: int) -> None:
    """Write what the network says of every row, next to the labels and what is known of the row."""
    for name in ("predicted_N", "true_N", *(INTERVALS_OF_BINS if model.intervals else ())):
        _create(file, name, (len(rows), bins, 3), "f4", "N", chunks=(1, bins, 3))
    for name in INTERVALS_OF_TOTALS if model.intervals else ():
        _create(file, name, (len(rows), 3), "f8", "N")
    _create(file, "disagreement", (len(rows),), "f8", "1")
    for name in KEPT:
        column = COLUMNS[name]
        kind = h5py.string_dtype() if column.kind == "text" else column.kind
        _create(file, name, (len(rows), *column.sizes(0, bins)), kind, column.unit, column.description)
    _create(file, "indenter", (len(rows),), h5py.string_dtype(), "1")
    cells = {name: about for path in rows.paths for name, about in shard_attributes(path)["cells"].items()}
    start = 0
    blocks = rows.batches((FEATURE, LABEL, *KEPT), BLOCK)
    for block in tracked(blocks, f"blocks of {BLOCK} rows predicted", -(-len(rows) // BLOCK)):
        place = slice(start, start + len(block["cell"]))
        predicted = model.predict(block[FEATURE])
        file["predicted_N"][place], file["true_N"][place] = predicted, block[LABEL]
        file["disagreement"][place] = model.disagreement(block[FEATURE], predicted)
        file["indenter"][place] = [_indenter(cells[name]) for name in block["cell"]]
        if model.intervals:
            file["bin_half_N"][place] = model.intervals.of_bins(predicted)
            file["bin_half_true_N"][place] = model.intervals.of_true_bins(predicted)
            file["total_half_N"][place] = model.intervals.of_totals(predicted)
            file["total_half_true_N"][place] = model.intervals.of_true_totals(predicted)
        for name in KEPT:
            file[name][place] = block[name]
        start = place.stop


def _indenter(about: dict) -> str:
    """Return what pressed a cell: the kind of shape where many were drawn, else the indenter."""
    return about.get("kind") or about.get("indenter") or ""


def _write_training_rows(
    file: h5py.File, rows: ShardDataset, training: np.ndarray, model: Model, seed: int
) -> None:
    """Write what the network says of rows among those that it was trained on (n,), next to the labels."""
    index = at_most(one_of_each_press(rows, training), TRAINING_ROWS, seed)
    shape = len(index), *model.scaling.output_mean.shape
    for name in (OF_TRAINING["predicted"], OF_TRAINING["true"]):
        _create(file, name, shape, "f4", "N", chunks=(1, *shape[1:]))
    for start in range(0, len(index), BLOCK):
        block = rows.read(index[start : start + BLOCK], (FEATURE, LABEL))
        place = slice(start, start + len(block[LABEL]))
        file[OF_TRAINING["predicted"]][place] = model.predict(block[FEATURE])
        file[OF_TRAINING["true"]][place] = block[LABEL]


def _baselines(
    rows: ShardDataset, training: np.ndarray, validation: np.ndarray, model: Model, grid: tuple, seed: int
) -> Iterator[Baseline | InverseBaseline]:
    """Yield the baselines, with the network's inputs and targets, or the flow's components where it has others."""
    scaling = model.scaling
    if scaling.form != "vector":
        scaling = measure_scaling(rows, training, "vector", centred=False)
    yield from fit_baselines(rows, training, validation, scaling, grid, seed)
    if model.inverse:
        yield fit_inverse(rows, validation, model.inverse, grid, seed)


def _write_baseline(
    file: h5py.File, rows: ShardDataset, baseline: Baseline | InverseBaseline, bins: int
) -> None:
    name = f"baselines/{baseline.name}"
    data = _create(file, name, (len(rows), bins, 3), "f4", "N", baseline.settings, chunks=(1, bins, 3))
    start = 0
    for block in rows.batches((FEATURE,), BLOCK):
        data[start : start + len(block[FEATURE])] = baseline.predict(block[FEATURE])
        start += len(block[FEATURE])


INTERVALS_OF_BINS = ("bin_half_N", "bin_half_true_N")
INTERVALS_OF_TOTALS = ("total_half_N", "total_half_true_N")
OF_TRAINING = {"predicted": "training/predicted_N", "true": "training/true_N"}
_DESCRIPTIONS = {
    "predicted_N": "force distribution predicted by the network (N, B, 3)",
    "true_N": "force distribution of the finite-element model, the label (N, B, 3)",
    "bin_half_N": "half width of the 90 % interval of each bin's label (N, B, 3)",
    "bin_half_true_N": "the same of the true force: with the label's own uncertainty (N, B, 3)",
    "total_half_N": "half width of the 90 % interval of the label's total (N, 3)",
    "total_half_true_N": "the same of the true total force: with the label's own uncertainty (N, 3)",
    "indenter": "the indenter in words, or the kind of a drawn one (N)",
    "nearest_training_mm": "distance to the nearest training site, or to one of its mirror images (N)",
    "disagreement": "how far the total is from that of inverse elasticity, beyond 1 marked; NaN: not known (N)",
    OF_TRAINING["predicted"]: "force distribution predicted of rows that trained the network (M, B, 3)",
    OF_TRAINING["true"]: "their labels (M, B, 3)",
    "training_mean_N": "mean label over the touched training rows (B, 3)",
    "label_range_N": "range of all labels: per bin and in total; least and greatest; axis (2, 2, 3)",
}


def _create(
    file: h5py.File, name: str, shape, kind, unit: str, description: str = "", chunks=None
) -> h5py.Dataset:
    compression = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "chunks": chunks}
    data = file.create_dataset(name, shape, kind, **(compression if chunks else {}))
    data.attrs["units"], data.attrs["description"] = unit, description or _DESCRIPTIONS[name]
    return data


def training_mean(rows: ShardDataset) -> np.ndarray:
    """Return the mean label (B, 3) [N] over touched rows, a block at a time."""
    total, count = np.zeros(()), 0
    for block in rows.batches((LABEL, "untouched"), BLOCK):
        touched = ~block["untouched"]
        total = total + block[LABEL][touched].sum(axis=0, dtype=np.float64)
        count += int(touched.sum())
    if not count:
        raise DatasetError("no touched training row; give the study more sites")
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
            self.position_mm, self.depth_mm = file["position_mm"][()], file["depth_mm"][()]
            self.nearest_training_mm = file["nearest_training_mm"][()]
            self.session, self.disagreement = file["session"].asstr()[()], file["disagreement"][()]
            self.phase, self.indenter = (file[name].asstr()[()] for name in ("phase", "indenter"))
            self.has_intervals = "bin_half_N" in file
            self.has_truth = "truth" in file
            self.mm_per_px = float(file["truth"].attrs["mm_per_px"]) if self.has_truth else np.nan
            self.baselines = sorted(file["baselines"])
            self.training_mean, self.label_range = file["training_mean_N"][()], file["label_range_N"][()]

    def check_model(self, model_path: str | Path) -> None:
        """Raise DatasetError for predictions of another model than this file's; a file that is not there says nothing."""
        if Path(model_path).is_file() and file_sha256(model_path) != self.model_sha256:
            raise DatasetError(
                f"{self.path}: predictions of another model than {model_path}; evaluate it again (snakemake -R {self.path})"
            )

    def blocks(self, baseline: str | None = None) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """Yield rows, predicted and true distributions (n, B, 3) [N]; the network's, or those of a baseline."""
        name = f"baselines/{baseline}" if baseline else "predicted_N"
        for rows, predicted, true in self.columns(name, "true_N"):
            yield rows, predicted.astype(float), true.astype(float)

    def blocks_of_training(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield predicted and true distributions (n, B, 3) [N] of rows that trained the network."""
        for _, predicted, true in self.columns(OF_TRAINING["predicted"], OF_TRAINING["true"]):
            yield predicted.astype(float), true.astype(float)

    def columns(self, *names: str) -> Iterator[tuple]:
        """Yield rows and named datasets of them, a block at a time."""
        with self._open() as file:
            count = len(file[names[0]])
            for start in range(0, count, BLOCK):
                rows = slice(start, min(start + BLOCK, count))
                yield rows, *(file[name][rows] for name in names)

    def _open(self) -> h5py.File:
        remedy = f"evaluate the model again (snakemake -R {self.path})"
        return opened(self.path, FORMAT, remedy, DatasetError)
