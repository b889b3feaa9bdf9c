"""LeRobot, layout v3.0: an episode per indentation, forces and images as observations."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gelforge.dataset.exports.card import card
from gelforge.dataset.exports.export import Export, Options, library
from gelforge.dataset.exports.images import pixels
from gelforge.dataset.exports.parquet import write_files
from gelforge.dataset.exports.source import IMAGE, Source, Variable, wrench
from gelforge.dataset.schema import DatasetError
from gelforge.files import write_json, write_text
from gelforge.progress import tracked

VERSION = "v3.0"
# Of Parquet: LeRobot's DEFAULT_DATA_FILE_SIZE_IN_MB (lerobot/datasets/utils.py).
FILE_MB = 100
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
# LeRobot's DEFAULT_CHUNK_SIZE (lerobot/datasets/utils.py).
CHUNK_FILES = 1000
WRENCH = ["fx_N", "fy_N", "fz_N", "mx_Nmm", "my_Nmm", "mz_Nmm"]
# name in LeRobot, column of the rows, names of its entries
TAKEN = (
    ("observation.forces_3d", "force_distribution_N", None),
    ("observation.forces_3d_sigma", "force_sigma_N", None),
    ("observation.force_measured", "total_force_ft_N", WRENCH[:3]),
    ("observation.flow", "feature", None),
)
STATE = ["x_mm", "y_mm", "depth_mm"]
INDICES = {
    "timestamp": ("f4", "s", "frame_index / fps; indentations are quasi-static, the shards hold no times"),
    "frame_index": ("i8", "1", "number of the row within its episode"),
    "episode_index": ("i8", "1", "number of the episode"),
    "index": ("i8", "1", "number of the row"),
    "task_index": ("i8", "1", "number of the task in meta/tasks.parquet"),
}
USE = """\
```python
from lerobot.datasets.lerobot_dataset import LeRobotDataset

dataset = LeRobotDataset("gelforge/{study}", root="FOLDER")  # an episode is an indentation, or a site with its depths
row = dataset[0]
row["observation.forces_3d"]  # {label} [N]
```

`meta/info.json` names the splits as ranges of episodes: {splits}. Give `episodes=list(range(...))` to load one of them."""


def write(source: Source, folder: Path, options: Options) -> None:
    """Write rows, episodes, tasks, statistics and info.json; every file is finished."""
    if options.fps <= 0:
        raise DatasetError(f"--fps {options.fps:g}: frames per second are more than 0")
    variables = _variables(source)
    of_all = {name: _Statistics(variable) for name, variable in variables.items()}
    of_each: list[dict] = []
    blocks = _counted(_episodes(source, variables, options.fps), variables, of_all, of_each)
    files = write_files(blocks, variables, lambda n: folder / DATA.format(**_numbers(n)), FILE_MB * 1e6)
    _write_episodes(source, folder, files, of_each)
    _write_tasks(source, folder)
    write_json(
        folder / "meta" / "stats.json", {name: statistics.summary() for name, statistics in of_all.items()}
    )
    splits, start = {}, 0
    for split in source.counts:
        splits[split] = f"{start}:{start + len(source.of_split(split))}"
        start += len(source.of_split(split))
    info = _info(source, variables, options.fps, splits)
    # features in the order of the columns
    write_text(folder / "meta" / "info.json", json.dumps(info, indent=2) + "\n")
    use = USE.format(
        study=source.manifest["study"],
        label=source.variables["force_distribution_N"].shape,
        splits=", ".join(f"{name} {episodes}" for name, episodes in splits.items()),
    )
    lines = [f"| `{n}` | {list(v.shape) or ''} | {v.unit} | {v.description} |" for n, v in variables.items()]
    columns = "| feature | shape | unit | what |\n|---|---|---|---|\n" + "\n".join(lines)
    write_text(folder / "README.md", card(source, use, options, columns))


def _numbers(file: int) -> dict[str, int]:
    return {"chunk_index": file // CHUNK_FILES, "file_index": file % CHUNK_FILES}


def _variables(source: Source) -> dict[str, Variable]:
    variables = {name: source.variables[column] for name, column, _ in TAKEN if column in source.variables}
    if (
        wrench(np.zeros((1, *variables["observation.forces_3d"].shape)), np.zeros((1, 3)), source.sensor)
        is not None
    ):
        variables["observation.wrench"] = Variable(
            "f4",
            (6,),
            "N, N mm",
            "resultant on the sensor: total force, moment of the bins' forces about the middle of the sensor at z = 0",
        )
    variables["observation.state"] = Variable(
        "f4", (3,), "mm", "planned position x, y and depth of the indenter"
    )
    if source.images:
        variables["observation.images.tactile"] = source.variables[IMAGE]
    return variables | {name: Variable(kind, (), unit, text) for name, (kind, unit, text) in INDICES.items()}


def _episodes(source: Source, variables: dict[str, Variable], fps: float) -> Iterator[dict]:
    """Yield the rows of each indentation."""
    index = 0
    for number, press in enumerate(tracked(source.presses, "indentations exported")):
        rows = source.read([press])
        count = len(press.rows)
        block = {name: rows[column] for name, column, _ in TAKEN if name in variables}
        if "observation.wrench" in variables:
            block["observation.wrench"] = wrench(
                rows["force_distribution_N"], rows["total_force_fem_N"], source.sensor
            )
        block["observation.state"] = np.column_stack([rows["position_mm"], rows["depth_mm"]])
        if source.images:
            block["observation.images.tactile"] = rows[IMAGE]
        frame = np.arange(count)
        block |= {
            "timestamp": frame / fps,
            "frame_index": frame,
            "episode_index": np.full(count, number),
            "index": index + frame,
            "task_index": np.zeros(count, int),
        }
        index += count
        yield block


def _counted(
    blocks: Iterator[dict], variables: dict[str, Variable], of_all: dict, of_each: list[dict]
) -> Iterator[dict]:
    """Yield the blocks, adding each to the statistics of all; append those of its small columns to of_each."""
    for block in blocks:
        counted = {}
        for name, variable in variables.items():
            of_all[name].add(block[name])
            # of larger columns statistics by episode would outweigh the data
            if variable.kind == "image" or np.prod(variable.shape) <= 10:
                of_episode = _Statistics(variable)
                of_episode.add(block[name])
                counted[name] = of_episode.summary()
        of_each.append(counted)
        yield block


class _Statistics:
    """Least, most, mean and spread of a column, entry by entry; of an image by channel, as shares of its white.

    Values that are not numbers (a force that a test excluded) do not count; where none is a number all are 0.
    """

    def __init__(self, variable: Variable):
        self.image = variable.kind == "image"
        self.shape = (variable.shape[-1], 1, 1) if self.image else variable.shape or (1,)
        size = int(np.prod(self.shape))
        self.rows, self.known = 0, np.zeros(size)
        self.least, self.most = np.full(size, np.inf), np.full(size, -np.inf)
        self.mean, self.square = np.zeros(size), np.zeros(size)  # square: sum of squares about the mean

    def add(self, values) -> None:
        """Take in a block of rows."""
        self.rows += len(values)
        if self.image:
            shown = np.stack([pixels(content) for content in values])
            flat = shown.reshape(-1, shown.shape[-1]) / np.iinfo(shown.dtype).max
        else:
            flat = np.asarray(values, np.float64).reshape(len(values), -1)
        finite = np.isfinite(flat)
        self.least = np.minimum(self.least, np.where(finite, flat, np.inf).min(axis=0))
        self.most = np.maximum(self.most, np.where(finite, flat, -np.inf).max(axis=0))
        count = finite.sum(axis=0)
        mean = np.where(finite, flat, 0.0).sum(axis=0) / np.maximum(count, 1)
        square = np.where(finite, (flat - mean) ** 2, 0.0).sum(axis=0)
        # Chan, Golub & LeVeque 1983: sums of squares of two parts
        together, gap = np.maximum(self.known + count, 1), mean - self.mean
        self.square += square + gap**2 * self.known * count / together
        self.mean += gap * count / together
        self.known += count

    def summary(self) -> dict[str, list]:
        """Return min, max, mean, std and count as LeRobot writes them."""
        statistics = {
            "min": np.where(self.known, self.least, 0.0),
            "max": np.where(self.known, self.most, 0.0),
            "mean": self.mean,
            "std": np.sqrt(self.square / np.maximum(self.known, 1)),
        }
        return {name: value.reshape(self.shape).tolist() for name, value in statistics.items()} | {
            "count": [self.rows]
        }


def _write_episodes(source: Source, folder: Path, files: list[int], statistics: list[dict]) -> None:
    pa, pq = library("pyarrow"), library("pyarrow.parquet", "pyarrow")
    ends = np.cumsum([len(press.rows) for press in source.presses])
    rows = []
    for number, (press, file, end, summary) in enumerate(zip(source.presses, files, ends, statistics)):
        one = {
            "episode_index": number,
            "tasks": [_task(source)],
            "length": len(press.rows),
            "press": press.name,
            "split": press.split,
            "dataset_from_index": int(end) - len(press.rows),
            "dataset_to_index": int(end),
            "data/chunk_index": file // CHUNK_FILES,
            "data/file_index": file % CHUNK_FILES,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        rows.append(one | {f"stats/{n}/{k}": v for n, of in summary.items() for k, v in of.items()})
    path = folder / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    path.parent.mkdir(parents=True)
    pq.write_table(pa.Table.from_pylist(rows), path, compression="zstd")


def _task(source: Source) -> str:
    return f"press the sensor of study {source.manifest['study']}"


def _write_tasks(source: Source, folder: Path) -> None:
    library("pyarrow")
    import pandas as pd

    tasks = pd.DataFrame({"task_index": [0]}, index=pd.Index([_task(source)], name="task"))
    tasks.to_parquet(folder / "meta" / "tasks.parquet")


def _info(source: Source, variables: dict[str, Variable], fps: float, splits: dict[str, str]) -> dict:
    entries = {name: names for name, _, names in TAKEN}
    entries |= {"observation.wrench": WRENCH, "observation.state": STATE}
    features = {}
    for name, variable in variables.items():
        image = variable.kind == "image"
        kind = {"f4": "float32", "f8": "float64", "i8": "int64", "image": "image"}[variable.kind]
        names = ["height", "width", "channels"] if image else entries.get(name)
        features[name] = {"dtype": kind, "shape": list(variable.shape) or [1], "names": names}
    return {
        "codebase_version": VERSION,
        "robot_type": "gelforge",
        "total_episodes": len(source.presses),
        "total_frames": sum(source.counts.values()),
        "total_tasks": 1,
        "chunks_size": CHUNK_FILES,
        "data_files_size_in_mb": FILE_MB,
        "video_files_size_in_mb": 200,
        "fps": int(fps) if fps == int(fps) else fps,
        "splits": splits,
        "data_path": DATA,
        "video_path": None,
        "features": features,
    }


EXPORT = Export(
    "lerobot",
    "LeRobot v3.0 (`data/`, `meta/`), an episode per indentation: `LeRobotDataset(name, root=FOLDER)`",
    write,
)
