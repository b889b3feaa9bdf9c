"""Rows of shards for training: scaling from training rows only, and shuffled batches in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from gelforge.dataset.shard import ShardDataset
from gelforge.learning.network import ModelError, Scaling, input_flow

FEATURE, LABEL = "feature", "force_distribution_N"
BLOCK_ROWS = 64  # consecutive rows that are read together; about one cell
BUFFER_ROWS = 16384  # rows in memory while training: 290 MB of the paper's features and labels


class TactileRows(torch.utils.data.Dataset):
    """Rows of shards as (feature, label) tensors; safe with worker processes, each opens the files for itself."""

    def __init__(self, rows: ShardDataset):
        self.rows = rows

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: int) -> tuple[torch.Tensor, torch.Tensor]:
        return tuple(values[0] for values in self.__getitems__([index], stack=True))

    def __getitems__(self, indices: list[int], stack: bool = False):
        """Return a batch at once, as PyTorch's loader asks for it: one reading of the files instead of many."""
        block = self.rows.read(np.asarray(indices), (FEATURE, LABEL))
        pair = torch.from_numpy(block[FEATURE]), torch.from_numpy(block[LABEL])
        return pair if stack else list(zip(*pair))


def subset(rows: ShardDataset, cells: set[str]) -> np.ndarray:
    """Return the numbers (n,) of the rows that belong to some cells, in order."""
    parts, start = [np.empty(0, np.int64)], 0
    for block in rows.batches(("cell",), 8192):
        parts.append(start + np.flatnonzero([name in cells for name in block["cell"]]))
        start += len(block["cell"])
    return np.concatenate(parts)


def positions_of(rows: ShardDataset) -> dict[str, np.ndarray]:
    """Return the position (2,) [mm] of each cell that rows belong to, by its name, sorted."""
    places: dict[str, np.ndarray] = {}
    for block in rows.batches(("cell", "position_mm"), 8192):
        places |= dict(zip(block["cell"], block["position_mm"]))
    return dict(sorted(places.items()))


def measure_scaling(rows: ShardDataset, index: np.ndarray, form: str) -> Scaling:
    """Return the scaling measured on the rows numbered by index (n,), in two passes of bounded memory.

    A second pass around the mean instead of a difference of large sums keeps the variance exact.
    """
    if not len(index):
        raise ModelError("no training rows; give the study more cells or a smaller dataset.test_fraction")
    mean = [0.0, 0.0]
    for flow, label in _blocks(rows, index, form):
        mean = [m + v.sum(axis=0, dtype=np.float64) / len(index) for m, v in zip(mean, (flow, label))]
    square = [0.0, 0.0]
    for flow, label in _blocks(rows, index, form):
        square = [
            s + ((v - m) ** 2).sum(axis=0) / len(index) for s, v, m in zip(square, (flow, label), mean)
        ]  # (F,), (B, 3)
    half = len(mean[0]) // 2
    input_scale = np.sqrt([square[0][:half].mean(), square[0][half:].mean()])
    output_scale = np.sqrt(square[1].mean(axis=0))
    if not (input_scale > 0).all() or not (output_scale > 0).all():
        raise ModelError(
            f"training rows do not vary (input scale {input_scale.tolist()}, output scale {output_scale.tolist()} N); "
            "check the images and the labels"
        )
    return Scaling(form, *(np.asarray(v, np.float32) for v in (mean[0], input_scale, mean[1], output_scale)))


def _blocks(rows: ShardDataset, index: np.ndarray, form: str) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    for start in range(0, len(index), 256):
        block = rows.read(index[start : start + 256], (FEATURE, LABEL))
        yield input_flow(block[FEATURE], form), block[LABEL].astype(np.float64)


class Batches:
    """Shuffled batches of scaled inputs and targets, the same for the same seed and epoch.

    Where all rows fit into the buffer they are read once and shuffled freely. Otherwise every epoch draws blocks of
    consecutive rows in random order until the buffer is full, shuffles the buffer and empties it, and so on.
    """

    def __init__(
        self,
        rows: ShardDataset,
        index: np.ndarray,
        scaling: Scaling,
        size: int,
        seed: int,
        buffer_rows: int = BUFFER_ROWS,
    ):
        self.rows, self.index, self.scaling, self.size, self.seed = rows, index, scaling, size, seed
        self.buffer_rows = buffer_rows
        self._whole: tuple[torch.Tensor, torch.Tensor] | None = None

    def epoch(self, epoch: int) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        """Yield inputs (n, F) and targets (n, 3 B) of one epoch; the order depends on seed and epoch only."""
        rng = np.random.default_rng([self.seed, epoch])
        for inputs, targets in self._buffers(rng):
            order = torch.from_numpy(rng.permutation(len(inputs)))
            for start in range(0, len(order), self.size):
                chosen = order[start : start + self.size]
                yield inputs[chosen], targets[chosen]

    def in_order(self) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        """Yield all rows once, unshuffled."""
        if not len(self.index):
            return
        if len(self.index) <= self.buffer_rows:
            inputs, targets = next(self._buffers(np.random.default_rng(0)))
            yield from zip(inputs.split(self.size), targets.split(self.size))
            return
        for start in range(0, len(self.index), self.size):
            yield self._read(self.index[start : start + self.size])

    def _buffers(self, rng: np.random.Generator) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        if len(self.index) <= self.buffer_rows:
            if self._whole is None:
                self._whole = self._read(self.index)
            yield self._whole
            return
        blocks = np.array_split(self.index, -(-len(self.index) // BLOCK_ROWS))
        order = rng.permutation(len(blocks))
        per_buffer = max(1, self.buffer_rows // BLOCK_ROWS)
        for start in range(0, len(order), per_buffer):
            yield self._read(np.concatenate([blocks[i] for i in order[start : start + per_buffer]]))

    def _read(self, index: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
        block = self.rows.read(index, (FEATURE, LABEL))
        return torch.from_numpy(self.scaling.inputs(block[FEATURE])), torch.from_numpy(
            self.scaling.targets(block[LABEL])
        )
