"""Shards: HDF5 files with one sample per row, written row block by row block and read lazily."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from gelforge.dataset.schema import FORMAT, DatasetError, columns
from gelforge.hdf5 import opened, writing

PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}  # of HDF5 datasets of numbers
JSON_ATTRIBUTES = ("cells", "failed_cells", "sessions")


class ShardWriter:
    """Appends blocks of rows; every column in every block."""

    def __init__(self, file: h5py.File, labels_only: bool, features: int, bins: int):
        self.file, self.rows = file, 0
        self.columns = columns(labels_only)
        for name, column in self.columns.items():
            sizes, text = column.sizes(features, bins), column.kind == "text"
            data = file.create_dataset(
                name,
                shape=(0, *sizes),
                maxshape=(None, *sizes),
                # one sample per chunk where a sample is large: a shuffled loader then reads only what it asks for
                chunks=(1 if sizes and np.prod(sizes) > 100 else 256, *sizes),
                dtype=h5py.string_dtype() if text else column.kind,
                **({} if text else PACKED),
            )
            data.attrs["units"], data.attrs["description"] = column.unit, column.description

    def append(self, block: dict[str, np.ndarray]) -> None:
        """Append a block of rows (n, ...) of every column."""
        count = len(block["cell"])
        for name in self.columns:
            data = self.file[name]
            data.resize(self.rows + count, axis=0)
            data[self.rows :] = block[name]
        self.rows += count


@contextmanager
def writing_shard(
    path: str | Path, attributes: dict, labels_only: bool, features: int, bins: int
) -> Iterator[ShardWriter]:
    """Yield a writer of a shard that appears under its name only when it is whole.

    Parameters
    ----------
    path : str or Path
        The file.
    attributes : dict
        May be filled until the block ends; those of JSON_ATTRIBUTES are stored as JSON text.
    labels_only : bool
        Rows have labels and no features.
    features : int
        Numbers of a row's features.
    bins : int
        Number of bins.

    Yields
    ------
    ShardWriter
        Takes rows.

    Raises
    ------
    FileError
        For a full disk.
    """
    with writing(path) as file:
        writer = ShardWriter(file, labels_only, features, bins)
        yield writer
        file.attrs["format"], file.attrs["labels_only"], file.attrs["rows"] = FORMAT, labels_only, writer.rows
        for name, value in sorted(attributes.items()):
            file.attrs[name] = json.dumps(value, sort_keys=True) if name in JSON_ATTRIBUTES else value


def _open(path: Path) -> h5py.File:
    return opened(path, FORMAT, f"build the shard again (snakemake -R {path})", DatasetError)


def shard_attributes(path: str | Path) -> dict:
    """Return the attributes of a shard.

    Parameters
    ----------
    path : str or Path
        A shard that `writing_shard` wrote.

    Returns
    -------
    dict
        Plain numbers and text; those of JSON_ATTRIBUTES decoded.

    Raises
    ------
    DatasetError
        For a file that is missing, damaged or no shard.
    """
    with _open(Path(path)) as file:
        attributes = {
            name: getattr(value, "tolist", lambda v=value: v)() for name, value in file.attrs.items()
        }
    return {
        name: json.loads(value) if name in JSON_ATTRIBUTES else value for name, value in attributes.items()
    }


def _values(data: h5py.Dataset, rows) -> np.ndarray:
    return data.asstr()[rows] if h5py.check_string_dtype(data.dtype) else data[rows]


class ShardDataset:
    """The rows of several shards, in their order, optionally of one split; knows nothing of any learning library.

    Files are opened when rows are first read in a process, so that it may be handed to worker processes.
    """

    def __init__(self, paths: Sequence[str | Path], split: str | None = None):
        self.paths = [Path(path) for path in paths]
        self.split = split
        self._files: dict[Path, h5py.File] = {}
        shard, row = [], []
        for number, path in enumerate(self.paths):
            with _open(path) as file:
                splits = _values(file["split"], slice(None))
            chosen = np.flatnonzero(splits == split) if split else np.arange(len(splits))
            shard.append(np.full(len(chosen), number, np.int32))
            row.append(chosen.astype(np.int32))
        self.shard = np.concatenate([np.empty(0, np.int32), *shard])  # (N,)
        self.row = np.concatenate([np.empty(0, np.int32), *row])  # (N,)

    def __len__(self) -> int:
        return len(self.row)

    def __getstate__(self):
        return {**self.__dict__, "_files": {}}

    def close(self) -> None:
        """Close the open files; the next reading opens them again."""
        for file in self._files.values():
            file.close()
        self._files = {}

    def read(self, index: np.ndarray, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Return the named columns (n, ...) of rows given by their numbers (n,), in the order asked for.

        Raises DatasetError for a column that a shard does not hold, as in a dataset of labels only.
        """
        index = np.asarray(index)
        order = np.lexsort((self.row[index], self.shard[index]))
        parts: dict[str, list[np.ndarray]] = {name: [] for name in names}
        for number in np.unique(self.shard[index]):
            rows = self.row[index[order]][self.shard[index[order]] == number]
            file = self._file(self.paths[number])
            once, back = np.unique(rows, return_inverse=True)
            contiguous = len(once) and once[-1] - once[0] + 1 == len(once)
            selection = slice(once[0], once[-1] + 1) if contiguous else once
            for name in names:
                if name not in file:
                    raise DatasetError(
                        f"{self.paths[number]}: no dataset {name!r}; it holds labels only, "
                        "add sessions with images to the study"
                    )
                parts[name].append(_values(file[name], selection)[back])
        columns_read = {}
        for name in names:
            joined = np.concatenate(parts[name])
            columns_read[name] = np.empty_like(joined)
            columns_read[name][order] = joined
        return columns_read

    def batches(self, names: Sequence[str], size: int = 256) -> Iterator[dict[str, np.ndarray]]:
        """Yield the named columns in blocks of at most size rows, in order."""
        for start in range(0, len(self), size):
            yield self.read(np.arange(start, min(start + size, len(self))), names)

    def _file(self, path: Path) -> h5py.File:
        if path not in self._files:
            self._files[path] = _open(path)
        return self._files[path]


def lineage(path: str | Path, row: int) -> dict:
    """Return where one row of a shard comes from: its label's site, its image and the files behind both.

    Parameters
    ----------
    path : str or Path
        The shard.
    row : int
        From 0.

    Returns
    -------
    dict
        The row's plain columns, with `label`, `study`, `synthetic` and, of a row with an image, `recording`.

    Raises
    ------
    DatasetError
        For a row that does not exist, and a file that is no whole shard.
    """
    attributes = shard_attributes(path)
    if not 0 <= row < attributes["rows"]:
        raise DatasetError(f"{path}: row {row} does not exist; rows are 0 to {attributes['rows'] - 1}")
    with _open(Path(path)) as file:
        known = {
            name: _values(file[name], row) for name in file if file[name].ndim == 1 or name == "position_mm"
        }
    plain = {name: value.tolist() if hasattr(value, "tolist") else value for name, value in known.items()}
    recording = {} if attributes["labels_only"] else dict(attributes["sessions"][plain["session"]])
    session_label = recording.pop("presses", None) or recording.pop("cells", {}).get(plain["cell"])
    label = session_label or attributes["cells"][plain["cell"]]
    plain.update(
        shard=str(path), row=row, synthetic=attributes["synthetic"], study=attributes["study"], label=label
    )
    if recording:
        plain["recording"] = recording
    return plain
