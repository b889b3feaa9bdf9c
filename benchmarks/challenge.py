"""The public benchmark: networks, baselines and anybody's own on fixed splits by orbit, sensor, shape, shear and camera.

usage: python benchmarks/challenge.py [--recorded results/benchmark] [--simulated results/simulated] [--data data/benchmark]
           [--entries study unet "kernel ridge" my_module:fit ...] [--tasks orbit sensor ...] [--seeds 1 2 3]
       (one thread; after `snakemake` with config/benchmark.yaml and config/simulated.yaml; networks are kept in
       results/trained, those of `transfer.py` and `networks.py` too)

All data is SYNTHETIC. `study` is the network of the task's own study: `unet`, or `unet_inverse` in simulation. An entry of
your own is a function fit(task, seed) -> predict; docs/learning.md says what it gets.
Prints a Markdown table for each task, medians over seeds, and writes all of them to --out as CSV.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import argparse  # noqa: E402
import sys  # noqa: E402
from collections.abc import Callable, Iterator  # noqa: E402
from dataclasses import dataclass  # noqa: E402
from functools import cached_property, partial  # noqa: E402
from importlib import import_module  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

sys.path.insert(0, str(Path(__file__).parent))
sys.path.append(str(Path.cwd()))  # where an entry's module is

import other_images  # noqa: E402
import transfer  # noqa: E402
from force_errors import force_errors  # noqa: E402
from kept import trained  # noqa: E402

from gelforge.cli.model.learning import inverse_elasticity  # noqa: E402
from gelforge.config import Learning, Study, load_study, load_virtual_lab  # noqa: E402
from gelforge.dataset.shard import ShardDataset  # noqa: E402
from gelforge.learning.basis.data import FEATURE, LABEL, measure_scaling, training_and_validation  # noqa: E402
from gelforge.learning.judging.baselines import fit_baselines, fit_inverse  # noqa: E402
from gelforge.learning.models.model_file import load_model  # noqa: E402

Predict = Callable[[np.ndarray], np.ndarray]  # features (n, 2 m) -> forces of bins (n, B, 3) [N]
BASELINES = ("ridge", "kernel ridge", "nearest neighbours")
COLUMNS = (FEATURE, LABEL, "cell", "press", "session", "untouched")


@dataclass(frozen=True)
class Rows:
    """Images and their labels."""

    feature: np.ndarray  # (n, 2 m): magnitudes [px] and directions [rad] of the flow by image region
    label: np.ndarray  # (n, B, 3) [N]
    untouched: np.ndarray  # (n,) whether nothing touches the sensor

    def of(self, chosen: np.ndarray) -> Rows:
        return Rows(self.feature[chosen], self.label[chosen], self.untouched[chosen])


@dataclass(frozen=True)
class Task:
    """What is learnt from, the files `shards`, and what is tested; `study` describes sensor and features."""

    name: str
    about: str
    study: Study
    shards: list[Path]
    test: Rows

    @property
    def grid(self) -> tuple:
        sensor = self.study.sensor
        return sensor.bins.nx, sensor.bins.ny, np.array([sensor.width_x_mm, sensor.width_y_mm])

    def split(self, seed: int) -> tuple[ShardDataset, np.ndarray, np.ndarray]:
        """Return the training set, and the numbers of its rows that train and that watch, by orbit."""
        rows = ShardDataset(self.shards, "train")
        study = self.study.model_copy(update={"seed": seed})
        return rows, *training_and_validation(rows, self.shards, study)

    def learnt_from(self, seed: int) -> tuple[Rows, Rows]:
        """Return rows that train and rows that watch, in memory."""
        rows, *parts = self.split(seed)
        return tuple(read(rows, index) for index in parts)


def read(rows: ShardDataset, index: np.ndarray) -> Rows:
    block = rows.read(index, (FEATURE, LABEL, "untouched"))
    return Rows(block[FEATURE], block[LABEL].astype(float), block["untouched"])


def network(task: Task, seed: int, learning: dict) -> Predict:
    described = Learning(**task.study.learning.model_dump(exclude_unset=True) | learning)
    study = task.study.model_copy(update={"learning": described, "seed": seed})
    return load_model(trained(study, task.shards)[0]).predict


def baseline(task: Task, seed: int, name: str) -> Predict:
    rows, training, validation = task.split(seed)
    scaling = measure_scaling(rows, training, "vector")
    return next(
        found.predict
        for found in fit_baselines(rows, training, validation, scaling, task.grid, seed)
        if found.name == name
    )


def inverse(task: Task, seed: int) -> Predict:
    """Return inverse elasticity with the gain and zeros that the rows which watch give."""
    rows, _, validation = task.split(seed)
    found = inverse_elasticity(task.study, task.shards)
    return fit_inverse(rows, validation, found, task.grid, seed).predict


def mean_label(task: Task, seed: int) -> Predict:
    mean = task.learnt_from(seed)[0].label.mean(axis=0)
    return lambda feature: np.broadcast_to(mean, (len(feature), *mean.shape))


def entry(name: str) -> Callable[[Task, int], Predict]:
    """Return the entry of a name: a network, a baseline, or module:function of anybody's own."""
    if name == "study":
        return partial(network, learning={})
    if name in ("unet", "unet_inverse", "cnn"):
        return partial(network, learning={"network": name})
    if name in BASELINES:
        return partial(baseline, name=name)
    if name == "inverse elasticity":
        return inverse
    if name == "mean":
        return mean_label
    module, colon, function = name.partition(":")
    if not colon:
        raise SystemExit(
            f"no entry {name!r}; give study, unet, unet_inverse, cnn, inverse elasticity, {', '.join(BASELINES)}, mean or "
            "module:function"
        )
    return getattr(import_module(module), function)


@dataclass(frozen=True)
class World:
    """The finished studies that the tasks are made of."""

    recorded_results: Path
    simulated_results: Path
    data: Path

    @cached_property
    def recorded(self) -> tuple[Study, list[Path]]:
        folder = self.recorded_results
        return load_study(folder / "study.yaml"), sorted((folder / "dataset").glob("shard-*.h5"))

    @cached_property
    def drawn(self) -> tuple[Study, list[Path]]:
        folder = self.simulated_results
        return load_study(folder / "study.yaml"), sorted((folder / "synthetic").glob("*.h5"))

    @cached_property
    def recorded_test(self) -> Rows:
        rows = ShardDataset(self.recorded[1], "test")
        return read(rows, np.arange(len(rows)))

    @cached_property
    def other(self) -> tuple[Rows, np.ndarray, np.ndarray]:
        """Rows of another virtual sensor, with the kind of indenter and the phase of each."""
        found = transfer.Rows(transfer.solved_others(self.simulated_results))
        return Rows(found.feature, found.label, found.untouched), found.kind, found.phase

    def seen_by(self, kind: str) -> Rows:
        """Return the benchmark study's test presses as another camera sees them."""
        study, lab = self.recorded[0], load_virtual_lab(self.recorded[0].virtual_lab)
        cells, label = other_images.test_presses(study, self.recorded_results, self.data)
        feature = other_images.images(study, lab, cells, other_images.kinds(lab.camera)[kind], 0)
        return Rows(feature, label, np.zeros(len(label), bool))

    def tasks(self, names: list[str]) -> Iterator[Task]:
        for name in names:
            yield getattr(self, f"_{name.replace('-', '_')}")(name)

    def _orbit(self, name: str) -> Task:
        return Task(
            name,
            "sites, and their mirror images, that nothing was learnt of",
            *self.recorded,
            self.recorded_test,
        )

    def _sensor(self, name: str) -> Task:
        about = "learnt from simulated sensors, tested on recordings of another: gel 12 % stiffer, other mesh, particles"
        return Task(name, about, *self.drawn, self.recorded_test)

    def _shape(self, name: str) -> Task:
        rows, kind, _ = self.other
        study, _ = self.drawn
        about = "learnt without edges, tested on edges and a wedge from a file, pressed into another sensor"
        touched = np.isin(kind, ("edge", "mesh")) & ~rows.untouched
        return Task(
            name, about, study, transfer.rows_without(self.simulated_results, "edge"), rows.of(touched)
        )

    def _shear(self, name: str) -> Task:
        rows, _, phase = self.other
        return Task(
            name, "steps of another sensor that move sideways", *self.drawn, rows.of(phase == "shear")
        )

    def _camera(self, name: str) -> Task:
        seen = self.seen_by("camera moved (1 %, 2 px, 0.5 deg)")
        return Task(
            name, "learnt from recordings, tested on images of a camera that was moved", *self.recorded, seen
        )

    def _camera_remapped(self, name: str) -> Task:
        about = "the same, with the camera's pose known and its images remapped"
        return Task(name, about, *self.recorded, self.seen_by("the same, remapped"))


TASKS = ("orbit", "sensor", "shape", "shear", "camera", "camera-remapped")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recorded", type=Path, default=Path("results/benchmark"))
    parser.add_argument("--simulated", type=Path, default=Path("results/simulated"))
    parser.add_argument(
        "--data", type=Path, default=Path("data/benchmark"), help="with the virtual lab's truth"
    )
    parser.add_argument("--entries", nargs="+", default=["study", "inverse elasticity", *BASELINES, "mean"])
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=list(TASKS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3])
    parser.add_argument("--out", type=Path, default=Path("results/challenge.csv"))
    arguments = parser.parse_args()
    entries = {name: entry(name) for name in arguments.entries}
    found, learnt = [], {}
    for task in World(arguments.recorded, arguments.simulated, arguments.data).tasks(arguments.tasks):
        for name, fit in entries.items():
            for seed in arguments.seeds:
                key = (
                    name,
                    seed,
                    tuple(task.shards),
                )  # tasks that learn from the same files share what was learnt
                predict = learnt[key] = learnt.get(key) or fit(task, seed)
                row = force_errors(
                    np.asarray(predict(task.test.feature)), task.test.label, task.test.untouched, task.grid
                )
                found.append({"task": task.name, "entry": name, "seed": seed, **row})
                print(
                    f"{task.name}, {name}, seed {seed}: RMSES z {row['RMSES z [mN]']:.3g} mN",
                    file=sys.stderr,
                    flush=True,
                )
        table = pd.DataFrame([row for row in found if row["task"] == task.name])
        medians = table.drop(columns=["task", "seed"]).groupby("entry", sort=False).median()
        print(f"\n**{task.name}**: {task.about} ({len(task.test.feature)} images)\n")
        print(medians.to_markdown(floatfmt=".3g"), flush=True)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(found).to_csv(arguments.out, index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
