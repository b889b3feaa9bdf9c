"""Rows of shards for training: scaling from training rows only, and shuffled batches in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch

from gelforge.config import Study
from gelforge.dataset.shard import ShardDataset, shard_attributes
from gelforge.dataset.splits import split_training
from gelforge.learning.basis.scaling import ModelError, Scaling, input_flow
from gelforge.learning.basis.turns import flow_centre, image_on_sensor

FEATURE, LABEL = "feature", "force_distribution_N"
BLOCK_ROWS = 64  # consecutive rows that are read together; about one site
BLOCK = 256  # rows in memory while a network predicts; no result depends on it
BUFFER_ROWS = 16384  # rows in memory while training: 290 MB of the paper's features and labels


def subset(rows: ShardDataset, cells: set[str]) -> np.ndarray:
    """Return the numbers (n,) of the rows that belong to some sites, in order."""
    parts, start = [np.empty(0, np.int64)], 0
    for block in rows.batches(("cell",), 8192):
        parts.append(start + np.flatnonzero([name in cells for name in block["cell"]]))
        start += len(block["cell"])
    return np.concatenate(parts)


def positions_of(rows: ShardDataset) -> dict[str, np.ndarray]:
    """Return the position (2,) [mm] of each site that rows belong to, by its name, sorted."""
    places: dict[str, np.ndarray] = {}
    for block in rows.batches(("cell", "position_mm"), 8192):
        places |= dict(zip(block["cell"], block["position_mm"]))
    return dict(sorted(places.items()))


def orbits_of(shards: Sequence[str | Path]) -> dict[str, str]:
    """Return the orbit of each site of shards: the first of the sites that are its mirror images."""
    cells = {name: about for path in shards for name, about in shard_attributes(path)["cells"].items()}
    return {name: about.get("orbit", name) for name, about in cells.items()}


def training_and_validation(
    rows: ShardDataset, shards: Sequence[str | Path], study: Study
) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of the rows that train and of those that only monitor the loss, by orbit."""
    places = positions_of(rows)
    known = orbits_of(shards)
    orbit = {name: known.get(name, name) for name in places}
    split = split_training(places, orbit, study.sensor, study.learning.validation_fraction, study.seed)
    sides = ({cell for cell, name in split.items() if name == side} for side in ("train", "validation"))
    training, validation = (subset(rows, cells) for cells in sides)
    return training, validation


def images_of_presses(rows: ShardDataset, index: np.ndarray) -> np.ndarray:
    """Return for each of the rows index (n,) the number of its group: the images of an indentation in one state."""
    groups: dict[tuple, int] = {}
    images = []
    for start in range(0, len(index), 8192):
        block = rows.read(index[start : start + 8192], ("session", "press", "depth_mm", "total_force_fem_N"))
        # at one depth of a path that moves sideways every state has another force
        forces = map(tuple, block["total_force_fem_N"].tolist())
        keys = zip(block["session"], block["press"], block["depth_mm"].tolist(), forces)
        images.append([groups.setdefault(key, len(groups)) for key in keys])
    return np.concatenate([np.empty(0, int), *map(np.array, images)]).astype(int)


def one_of_each_press(rows: ShardDataset, index: np.ndarray) -> np.ndarray:
    """Return the first image of each indentation and depth among the rows index (n,), untouched ones too, in order."""
    return index[np.unique(images_of_presses(rows, index), return_index=True)[1]]


def at_most(index: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Return the rows index (n,), or a number of them drawn by seed, in order."""
    return np.sort(np.random.default_rng(seed).permutation(index)[:count])


def lie_of_images(rows: ShardDataset, index: np.ndarray, width_mm: np.ndarray) -> tuple[str, bool]:
    """Return how images lie on the sensor, by the deepest quarter of the rows index (n,); see image_on_sensor."""
    if not len(index):
        return "identity", False
    depth = np.concatenate([b["depth_mm"] for b in _columns(rows, index, ("depth_mm",))])
    deep = index[depth >= max(np.quantile(depth, 0.75), 1e-9)]
    if not len(deep):
        return "identity", False
    centre, position = [np.empty((0, 2))], [np.empty((0, 2))]
    for block in _columns(rows, deep, (FEATURE, "position_mm")):
        flow = input_flow(block[FEATURE], "vector")
        flow = flow.reshape(len(flow), 2, -1)
        centre.append(flow_centre(flow, round(flow.shape[-1] ** 0.5)))
        position.append(block["position_mm"])
    return image_on_sensor(np.concatenate(centre), np.concatenate(position), width_mm)


def _columns(
    rows: ShardDataset, index: np.ndarray, names: tuple[str, ...]
) -> Iterator[dict[str, np.ndarray]]:
    for start in range(0, len(index), 256):
        yield rows.read(index[start : start + 256], names)


def measure_scaling(
    rows: ShardDataset, index: np.ndarray, form: str, turn: str = "identity", centred: bool = True
) -> Scaling:
    """Return the scaling measured on the rows numbered by index (n,), in two passes of bounded memory.

    A second pass around the mean instead of a difference of large sums keeps the variance exact. Without centring nothing
    prefers a place or a direction: zero means, and one scale for both components of the flow and of the horizontal force.
    """
    if not len(index):
        raise ModelError("no training rows; give the study more sites or a smaller dataset.test_fraction")
    mean = [np.zeros(()), np.zeros(())]
    for flow, label in _blocks(rows, index, form, turn):
        mean = [m + v.sum(axis=0, dtype=np.float64) / len(index) for m, v in zip(mean, (flow, label))]
    mean = mean if centred else [0.0 * m for m in mean]
    square = [np.zeros(()), np.zeros(())]
    for flow, label in _blocks(rows, index, form, turn):
        parts = zip(square, (flow, label), mean)
        square = [s + ((v - m) ** 2).sum(axis=0) / len(index) for s, v, m in parts]  # (F,), (B, 3)
    half = len(mean[0]) // 2
    input_square = np.array([square[0][:half].mean(), square[0][half:].mean()])
    output_square = square[1].mean(axis=0)
    if not centred:
        input_square[:] = input_square.mean()
        output_square[:2] = output_square[:2].mean()
    input_scale, output_scale = np.sqrt(input_square), np.sqrt(output_square)
    if not (input_scale > 0).all() or not (output_scale > 0).all():
        raise ModelError(
            f"training rows do not vary (input scale {input_scale.tolist()}, output scale {output_scale.tolist()} N); "
            "check the images and the labels"
        )
    scales = (np.asarray(v, np.float32) for v in (mean[0], input_scale, mean[1], output_scale))
    return Scaling(form, turn, *scales)


def _blocks(
    rows: ShardDataset, index: np.ndarray, form: str, turn: str
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    for block in _columns(rows, index, (FEATURE, LABEL)):
        yield input_flow(block[FEATURE], form, turn), block[LABEL].astype(np.float64)


class Batches:
    """Shuffled batches of scaled inputs and targets, the same for the same seed and number of the pass.

    Where all rows fit into the buffer they are read once and shuffled freely. Otherwise every pass draws blocks of
    consecutive rows in random order until the buffer is full, shuffles the buffer and empties it, and so on. Where rows
    belong to groups (n,), a pass takes one row of each, another one the next time. more (rows, M): inputs that follow the
    flow's, by the rows' numbers.
    """

    def __init__(
        self,
        rows: ShardDataset,
        index: np.ndarray,
        scaling: Scaling,
        size: int,
        seed: int,
        buffer_rows: int = BUFFER_ROWS,
        groups: np.ndarray | None = None,
        more: np.ndarray | None = None,
    ):
        self.rows, self.index, self.scaling, self.size, self.seed = rows, index, scaling, size, seed
        self.buffer_rows, self.groups, self.more = buffer_rows, groups, more
        self._whole: tuple[torch.Tensor, torch.Tensor] | None = None

    def of_pass(self, number: int) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        """Yield inputs (n, F) and targets (n, 3 B) of one pass; the order depends on seed and number only."""
        rng = np.random.default_rng([self.seed, number])
        for inputs, targets, chosen in self._buffers(rng, self._drawn(rng)):
            order = torch.from_numpy(rng.permutation(chosen))
            for start in range(0, len(order), self.size):
                batch = order[start : start + self.size]
                yield inputs[batch], targets[batch]

    def in_order(self) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        """Yield all rows once, unshuffled."""
        if not len(self.index):
            return
        if len(self.index) <= self.buffer_rows:
            self._whole = self._whole or self._read(self.index)
            yield from zip(*(part.split(self.size) for part in self._whole))
            return
        for start in range(0, len(self.index), self.size):
            yield self._read(self.index[start : start + self.size])

    def _drawn(self, rng: np.random.Generator) -> np.ndarray:
        """Return the places in index of a pass's rows, in order."""
        if self.groups is None:
            return np.arange(len(self.index))
        shuffled = rng.permutation(len(self.index))
        return np.sort(shuffled[np.unique(self.groups[shuffled], return_index=True)[1]])

    def _buffers(
        self, rng: np.random.Generator, drawn: np.ndarray
    ) -> Iterator[tuple[torch.Tensor, torch.Tensor, np.ndarray]]:
        """Yield inputs and targets in memory, and which of them belong to the pass."""
        if len(self.index) <= self.buffer_rows:
            if self._whole is None:
                self._whole = self._read(self.index)
            yield *self._whole, drawn
            return
        blocks = np.array_split(drawn, -(-len(drawn) // BLOCK_ROWS))
        order = rng.permutation(len(blocks))
        per_buffer = max(1, self.buffer_rows // BLOCK_ROWS)
        for start in range(0, len(order), per_buffer):
            taken = np.concatenate([blocks[i] for i in order[start : start + per_buffer]])
            read = self._read(self.index[taken])
            yield *read, np.arange(len(read[0]))

    def _read(self, index: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
        block = self.rows.read(index, (FEATURE, LABEL))
        inputs = self.scaling.inputs(block[FEATURE])
        if self.more is not None:
            inputs = np.concatenate([inputs, self.more[index]], axis=1)
        return torch.from_numpy(inputs), torch.from_numpy(self.scaling.targets(block[LABEL]))
