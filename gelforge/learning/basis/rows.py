"""A dataset's rows for PyTorch: what `gelforge.load_dataset` returns."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import numpy as np
import torch

from gelforge.dataset.exports.images import pixels
from gelforge.dataset.exports.source import IMAGE, SPLITS, Source, open_source
from gelforge.dataset.schema import DatasetError


class Rows(torch.utils.data.Dataset):
    """Rows of one split as dicts: tensors, and text as str; safe with worker processes, each opens the files for itself."""

    def __init__(self, source: Source, split: str, columns: Sequence[str]):
        presses = source.of_split(split)
        self.source, self.split, self.columns = source, split, tuple(columns)
        self.index = np.concatenate([np.empty(0, int), *(press.rows for press in presses)])  # (n,)

    def __repr__(self) -> str:
        return f"Rows of {self.split}: {len(self)} rows with {', '.join(self.columns)}"

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, number: int) -> dict:
        return self.__getitems__([number])[0]

    def __getitems__(self, numbers: list[int]) -> list[dict]:
        """Return several rows at once, as PyTorch's loader asks for them: one reading of the files instead of many."""
        block = self.source.read_rows(self.index[numbers], [name for name in self.columns if name != "split"])
        if IMAGE in block:
            block[IMAGE] = [pixels(content).transpose(2, 0, 1) for content in block[IMAGE]]
        rows = [{name: _value(values[i]) for name, values in block.items()} for i in range(len(numbers))]
        return [row | {"split": self.split} for row in rows] if "split" in self.columns else rows


def _value(value):
    return value if isinstance(value, str) else torch.as_tensor(np.ascontiguousarray(value))


def load_dataset(
    folder: str | Path, split: str | None = None, columns: Sequence[str] | None = None, images: bool = False
) -> Rows | dict[str, Rows]:
    """Return the rows of a split of a dataset's folder, or without a split those of train, validation and test by name.

    Parameters
    ----------
    folder : path
        The folder of the dataset, such as results/mine/dataset.
    split : str, optional
        train, validation or test; all three if not given.
    columns : sequence of str, optional
        Those to read; all if not given. Features are [px, rad], forces [N], positions [mm]; the card names every column.
    images : bool
        Rows hold `image` (C, H, W) uint8 too, read from where the manifest says they are.

    Returns
    -------
    Rows, or dict of str to Rows
        A map-style dataset of PyTorch: its items are dicts of tensors, and of text as str.

    Raises
    ------
    DatasetError
        A split or a column that does not exist, or a folder without a dataset.

    Examples
    --------
    >>> import gelforge as gf
    >>> rows = gf.load_dataset("results/mine/dataset", "train")  # doctest: +SKIP
    >>> rows[0]["force_distribution_N"].shape  # doctest: +SKIP
    """
    if not isinstance(folder, str | PathLike) or not (Path(folder) / "manifest.json").is_file():
        raise DatasetError(
            f"{folder}: no dataset with manifest.json; name the folder that a study's run has made, such as"
            " results/mine/dataset"
        )
    if isinstance(columns, str):
        columns = [columns]
    source = open_source(folder, images)
    known = list(source.variables)
    wanted = known if columns is None else list(columns)
    if unknown := sorted(set(wanted) - set(known)):
        raise DatasetError(f"{folder}: no columns {unknown}; it has {known}")
    if split is None:
        return {name: Rows(source, name, wanted) for name in SPLITS}
    if split not in SPLITS:
        raise DatasetError(f"{folder}: no split {split!r}; it has {', '.join(SPLITS)}")
    return Rows(source, split, wanted)
