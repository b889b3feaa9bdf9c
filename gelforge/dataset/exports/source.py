"""What every format is written from: the rows of a finished dataset, press by press, in three splits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from gelforge.config import Learning, Sensor
from gelforge.dataset.exports.images import RowImages
from gelforge.dataset.manifest import check_shards, read_manifest
from gelforge.dataset.schema import DatasetError, columns
from gelforge.dataset.shard import ShardDataset
from gelforge.dataset.splits import split_training
from gelforge.files import file_sha256
from gelforge.indentation.sensor.unrolled import bin_points
from gelforge.progress import tracked

SPLITS = ("train", "validation", "test")
IMAGE, IMAGE_NAME = "image", "image_file"  # an image's content, and the name of its file (`image` in shards)
BYTES = {kind: np.dtype(kind).itemsize for kind in ("f4", "f8", "i4", "bool")} | {"text": 24}


@dataclass(frozen=True)
class Variable:
    """One column of the rows."""

    kind: str  # "f4", "f8", "i4", "bool", "text" or "image" (encoded PNG or JPEG)
    shape: tuple[int, ...]  # of one row; of an image height, width, channels
    unit: str
    description: str


@dataclass(frozen=True)
class Press:
    """Rows that belong together, in order: an indentation with its images; without images a site with its depths."""

    name: str
    split: str
    rows: np.ndarray  # (n,) numbers of the dataset's rows


@dataclass(frozen=True)
class Source:
    """A dataset whose shards are those of its manifest; indentations in the order train, validation, test."""

    folder: Path
    manifest: dict
    rows: ShardDataset
    variables: dict[str, Variable]
    presses: tuple[Press, ...]
    images: RowImages | None  # None: rows name their image files only

    @cached_property
    def sensor(self) -> Sensor:
        """The sensor that the labels belong to."""
        return Sensor.model_validate(self.manifest["settings"]["sensor"])

    @cached_property
    def manifest_sha256(self) -> str:
        """What distinguishes this dataset from any other."""
        return file_sha256(self.folder / "manifest.json")

    def of_split(self, split: str) -> tuple[Press, ...]:
        """Return the indentations of a split."""
        return tuple(press for press in self.presses if press.split == split)

    @property
    def counts(self) -> dict[str, int]:
        """The number of rows of each split that has any."""
        counts = {split: sum(len(press.rows) for press in self.of_split(split)) for split in SPLITS}
        return {split: count for split, count in counts.items() if count}

    def read(self, presses: Sequence[Press], names: Sequence[str] | None = None) -> dict:
        """Return the named columns (n, ...) of the rows of indentations; images as a list of encoded files."""
        names = list(self.variables) if names is None else list(names)
        block = self.read_rows(
            np.concatenate([press.rows for press in presses]), [n for n in names if n != "split"]
        )
        counts = [len(press.rows) for press in presses]
        block["split"] = np.repeat(np.array([press.split for press in presses], object), counts)
        return {name: block[name] for name in names}

    def read_rows(self, index: np.ndarray, names: Sequence[str]) -> dict:
        """Return the named columns (n, ...) of rows given by their numbers (n,), other than `split`."""
        stored = {name: {IMAGE_NAME: "image"}.get(name, name) for name in names if name != IMAGE}
        needed = ["session", "image"] if IMAGE in names else []
        columns = self.rows.read(index, list(dict.fromkeys([*stored.values(), *needed])))
        block: dict[str, np.ndarray | list] = {name: columns[column] for name, column in stored.items()}
        if IMAGE in names:
            assert self.images is not None  # else no variable is called so
            block[IMAGE] = [self.images.encoded(*of) for of in zip(columns["session"], columns["image"])]
        return block

    def blocks(self, presses: Sequence[Press], names: Sequence[str] | None = None) -> Iterator[dict]:
        """Yield the columns of indentations in blocks of whole indentations, about 64 rows each."""
        start, count = 0, 0
        for end, press in enumerate(tracked(presses, "indentations exported"), 1):
            count += len(press.rows)
            if count >= 64 or end == len(presses):
                yield self.read(presses[start:end], names)
                start, count = end, 0

    def sampled(self, limit_mb: float) -> Source:
        """Return a part of at most limit_mb, uncompressed: indentations drawn by the study's seed, of every split its share.

        Raises DatasetError where not even one indentation of each split has room.
        """
        # an image counts as its pixels
        row = sum(int(np.prod(v.shape)) * BYTES.get(v.kind, 1) for v in self.variables.values())
        # a tenth of the bytes is for what stands next to the rows
        left = 0.9 * limit_mb * 1e6 / row
        share = left / sum(self.counts.values())
        rng = np.random.default_rng(self.manifest["split"]["seed"])
        chosen: list[Press] = []
        for split in SPLITS:
            presses, room = self.of_split(split), share * self.counts.get(split, 0)
            order = rng.permutation(len(presses))
            total = np.cumsum([len(presses[i].rows) for i in order])
            kept = order[: max(1, int(np.searchsorted(total, room, side="right")))]
            chosen += [presses[i] for i in sorted(kept)]
        if sum(len(press.rows) for press in chosen) > left:
            raise DatasetError(
                f"--sample-mb {limit_mb:g}: no room for an indentation of each split, a row takes {row / 1e6:.3g} MB; allow"
                " more, or leave the images out"
            )
        return replace(self, presses=tuple(chosen))


def open_source(
    folder: str | Path,
    images: bool = False,
    data: str | Path | None = None,
    validation_fraction: float | None = None,
) -> Source:
    """Return the dataset of a folder, its shards checked against the manifest.

    Parameters
    ----------
    folder : str or Path
        results/<study>/dataset.
    images : bool
        Rows hold the content of the image files.
    data : str or Path, optional
        Where the recordings lie (`RowImages`).
    validation_fraction : float, optional
        Share of the training orbits that are the split `validation`: those that monitor the loss when the study's
        network is trained. None for the default.

    Returns
    -------
    Source
        Manifest, rows, and indentations in the order train, validation, test.

    Raises
    ------
    DatasetError
        For a folder without a dataset, shards that are not the manifest's, and images that do not exist.
    """
    folder = Path(folder)
    manifest = read_manifest(folder / "manifest.json")
    shards = [folder / shard["file"] for shard in manifest["shards"]]
    check_shards(shards, folder / "manifest.json")
    rows = ShardDataset(shards)
    if not len(rows):
        raise DatasetError(f"{folder}: the dataset has no rows; see failed sites in its README.md")
    labels_only = manifest["labels_only"]
    if images and labels_only:
        raise DatasetError(
            f"{folder}: the dataset holds labels only, there are no images; leave out --images"
        )
    pictures = RowImages(manifest["raw_files"], data) if images else None
    fraction = Learning().validation_fraction if validation_fraction is None else validation_fraction
    presses = _presses(rows, manifest, fraction)
    return Source(folder, manifest, rows, _variables(rows, labels_only, pictures), presses, pictures)


def _variables(rows: ShardDataset, labels_only: bool, images: RowImages | None) -> dict[str, Variable]:
    first = rows.read(np.array([0]), list(columns(labels_only)))
    variables = {
        {"image": IMAGE_NAME}.get(name, name): Variable(
            column.kind, first[name].shape[1:], column.unit, column.description
        )
        for name, column in columns(labels_only).items()
    }
    variables["split"] = replace(
        variables["split"], description="train, validation or test, by orbit: a site with its mirror images"
    )
    if images:
        shape = images.shape(first["session"][0], first["image"][0])
        variables[IMAGE] = Variable("image", shape, "1", "the image as taken, PNG or JPEG")
    return variables


def _presses(rows: ShardDataset, manifest: dict, fraction: float) -> tuple[Press, ...]:
    """Return the rows by indentation, or by site where there are labels only, in the order of splits and shards."""
    labels_only = manifest["labels_only"]
    keys = ["cell"] if labels_only else ["session", "press"]
    index = np.arange(len(rows))
    read = rows.read(index, [*dict.fromkeys([*keys, "cell", "split", "position_mm"])])
    split = _with_validation(read, manifest, fraction)
    rows_of: dict[tuple, list[int]] = {}
    for i, key in enumerate(zip(*(read[name] for name in keys))):
        rows_of.setdefault(key, []).append(i)
    presses = [
        Press("/".join(key), split[read["cell"][numbers[0]]], np.array(numbers))
        for key, numbers in rows_of.items()
    ]
    return tuple(sorted(presses, key=lambda press: SPLITS.index(press.split)))  # stable


def _with_validation(read: dict, manifest: dict, fraction: float) -> dict[str, str]:
    """Return the split of each site that has rows."""
    split = dict(zip(read["cell"], read["split"]))
    places = {c: xy for c, xy in zip(read["cell"], read["position_mm"]) if split[c] == "train"}
    orbits = {name: manifest["cells"][name].get("orbit", name) for name in places}
    settings = manifest["settings"]
    sensor = Sensor.model_validate(settings["sensor"])
    return split | split_training(places, orbits, sensor, fraction, settings["seed"])


def wrench(forces: np.ndarray, total: np.ndarray, sensor: Sensor) -> np.ndarray | None:
    """Return the resultant (n, 6) [N, N mm] of bin forces (n, B, 3) [N] and total force (n, 3): force, then moment.

    The moment is that of the bins' forces at their centres on the undeformed surface, about the point of the sensor's frame
    over the middle at z = 0; force on side faces is in the force and not in the moment. None: a surface from files, whose
    height at the bins is not known here.
    """
    if sensor.shape.kind == "surfaces":
        return None
    middle = np.array([sensor.width_x_mm / 2, sensor.width_y_mm / 2, 0])
    moment = np.cross(bin_points(sensor) - middle, forces).sum(axis=1, dtype=np.float64)
    return np.concatenate([total, moment], axis=1)
