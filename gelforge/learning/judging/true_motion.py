"""Predictions from the true motion of a virtual lab's particles, written next to those from its images."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import h5py
import numpy as np

from gelforge.dataset.shard import ShardDataset
from gelforge.learning.basis.data import BLOCK, FEATURE
from gelforge.learning.models.model_file import Model
from gelforge.virtual_lab.true_presses import TruePress

MOST_LEARNT = 300  # training indentations that show what the flow makes of true motion: 12 seconds, measured
# Keeps regions that hardly move from a map of their noise. Measured: 1e-2 gives the same parts of the error.
RIDGE_PX2 = 1e-3

Recorded = tuple[str, str, str]  # session, press, cell
DESCRIPTIONS = {
    "bin_force_N": ("N", "true force on the virtual sensor (N, B, 3)"),
    "contact_point_bin_N": ("N", "how much of it the error of the contact point makes (N, B, 3)"),
    "predicted_N": ("N", "force predicted from the true motion as the flow shows it (N, B, 3)"),
    "flow_px": ("px", "true motion, rms over the regions (N)"),
    "flow_off_px": ("px", "flow of the image less true motion, rms over the regions (N)"),
}


@dataclass(frozen=True)
class Truth:
    """What a virtual lab knows of its recordings."""

    presses: Callable[[Iterable[Recorded]], Iterator[tuple[tuple[str, str], TruePress]]]
    mm_per_px: float  # in the middle of the image, at the particles' mean height


@dataclass(frozen=True)
class FlowMap:
    """What the flow of images makes of true motion: of each region, a linear map of the motion around it.

    A search over patches smooths, and particles of several heights share a region. A network learns that from its training
    rows; it is no error of what it says.
    """

    weights: np.ndarray  # (m, 2 n, 2): n regions around each

    @classmethod
    def fit(cls, true: np.ndarray, seen: np.ndarray) -> FlowMap:
        """Return the map of least squares from features (N, 2 m) of true motion to those of the images."""
        x, y = _around(components(true)), components(seen)
        here = np.zeros((x.shape[2], 2))
        here[x.shape[2] // 2 - 1 : x.shape[2] // 2 + 1] = np.eye(2)  # the region itself
        gram = np.einsum("nrf,nrg->rfg", x, x) + (RIDGE_PX2 * max(len(x), 1)) * np.eye(x.shape[2])
        off = np.einsum("nrf,nrk->rfk", x, y - x @ here)
        return cls(here + np.linalg.solve(gram, off))

    def __call__(self, true: np.ndarray) -> np.ndarray:
        """Return features (N, 2 m) float32 as images show those of true motion (N, 2 m) in the mean."""
        return features(np.einsum("nrf,rfk->nrk", _around(components(true)), self.weights))


def components(feature: np.ndarray) -> np.ndarray:
    """Return the flow (N, m, 2) [px], u right and v down, of features (N, 2 m)."""
    magnitude, direction = np.split(np.asarray(feature, float), 2, axis=1)
    return np.stack([magnitude * np.cos(direction), magnitude * np.sin(direction)], axis=-1)


def features(flow: np.ndarray) -> np.ndarray:
    """Return features (N, 2 m) float32 of flow (N, m, 2) [px]."""
    u, v = np.moveaxis(flow, -1, 0)
    return np.concatenate([np.hypot(u, v), np.arctan2(v, u)], axis=1).astype(np.float32)


def _around(flow: np.ndarray) -> np.ndarray:
    """Return the flow (N, m, 2 n) of each region and those around it, row by row; the border's own again beyond it."""
    side, span = round(flow.shape[1] ** 0.5), 3
    padded = np.pad(flow.reshape(-1, side, side, 2), ((0, 0), (1, 1), (1, 1), (0, 0)), mode="edge")
    parts = [padded[:, j : j + side, i : i + side] for j in range(span) for i in range(span)]
    return np.concatenate(parts, axis=-1).reshape(len(flow), side * side, -1)


def write_truth(
    file: h5py.File, model: Model, rows: ShardDataset, learnt: ShardDataset, truth: Truth
) -> None:
    """Write a group `truth` of every row: true force, prediction from true motion, how far the flow is off.

    learnt: training rows of the same virtual sensor, which show what its flow makes of true motion; without any all that the
    flow does to it counts as error. Untouched rows are zero; where no row is touched nothing is written.
    """
    recorded = _recorded(rows, np.arange(len(rows)))
    true = dict(truth.presses(press for press in recorded if press))
    if not true:
        return
    names, to_images = list(true), _flow_map(learnt, truth)
    exact = np.stack([true[name].feature for name in names])
    shown = to_images(exact) if to_images else exact
    predicted = np.concatenate([model.predict(shown[i : i + BLOCK]) for i in range(0, len(shown), BLOCK)])
    number = {name: i for i, name in enumerate(names)}
    group, bins = file.create_group("truth"), predicted.shape[1]
    group.attrs["mm_per_px"] = truth.mm_per_px
    for name, (unit, description) in DESCRIPTIONS.items():
        packing = {"chunks": (1, bins, 3), "compression": "gzip", "compression_opts": 1, "shuffle": True}
        per_bin = name.endswith("_N")
        shape = (len(rows), bins, 3) if per_bin else (len(rows),)
        data = group.create_dataset(name, shape, "f4", **(packing if per_bin else {}))
        data.attrs["units"], data.attrs["description"] = unit, description
    for start in range(0, len(rows), BLOCK):
        index = np.arange(start, min(start + BLOCK, len(rows)))
        touched = np.array([i for i in index if recorded[i]], int)
        if not len(touched):
            continue
        press = np.array([number[recorded[i][:2]] for i in touched])
        off = components(rows.read(touched, [FEATURE])[FEATURE]) - components(exact[press])
        group["bin_force_N"][touched] = [true[names[p]].bin_force_N for p in press]
        group["contact_point_bin_N"][touched] = [true[names[p]].contact_point_bin_N for p in press]
        group["predicted_N"][touched] = predicted[press]
        group["flow_px"][touched] = _rms(components(exact[press]))
        group["flow_off_px"][touched] = _rms(off)


def _rms(flow: np.ndarray) -> np.ndarray:
    """Return the root mean square length (N,) over the regions of flow (N, m, 2)."""
    return np.sqrt((flow**2).sum(axis=-1).mean(axis=-1))


def _recorded(rows: ShardDataset, index: np.ndarray) -> list[Recorded | None]:
    """Return session, press and cell of rows, None of untouched ones."""
    block = rows.read(index, ["session", "press", "cell", "untouched"])
    named = zip(block["session"], block["press"], block["cell"])
    return [None if untouched else press for press, untouched in zip(named, block["untouched"])]


def _flow_map(learnt: ShardDataset, truth: Truth) -> FlowMap | None:
    """Return the map from true motion to the flow of training images, one image of each of MOST_LEARNT indentations."""
    if not len(learnt):
        return None
    first = {press: row for row, press in enumerate(_recorded(learnt, np.arange(len(learnt)))) if press}
    chosen = np.unique(np.linspace(0, len(first) - 1, min(MOST_LEARNT, len(first))).astype(int))
    presses = [list(first)[k] for k in chosen]
    if not presses:
        return None
    true = dict(truth.presses(presses))
    seen = learnt.read(np.array([first[press] for press in presses]), [FEATURE])[FEATURE]
    return FlowMap.fit(np.stack([true[press[:2]].feature for press in presses]), seen)
