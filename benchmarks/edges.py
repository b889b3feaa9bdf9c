"""How well edges can be read at all: a network that is trained and tested on straight edges alone, for bins of both sizes.

usage: python benchmarks/edges.py [config/simulated.yaml] [--materials results/benchmark] [--steps 8000 16000]
       [--paths 14] [--tested 10] [--seed 1]
       (one thread; a CPU minute a solved edge, and a training of its steps; all is kept in results/edges)

All data is SYNTHETIC. Training rows are moved copies of solved edges. Test rows are other edges, solved with the same gel
and mesh and drawn with other particles. Prints a Markdown table for each length of training: RMSES over pressed bins, of the
study's bins and of bins twice as wide, on training rows and on test rows. Where the error on training rows no longer falls,
more training does not help.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import argparse  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
from force_errors import force_errors  # noqa: E402
from kept import trained  # noqa: E402
from transfer import laws_of, other_rows  # noqa: E402

from gelforge.config import Study, load_study  # noqa: E402
from gelforge.dataset.shard import ShardDataset  # noqa: E402
from gelforge.indentation.cells.cell_file import write_cell  # noqa: E402
from gelforge.learning.basis.data import FEATURE, LABEL  # noqa: E402
from gelforge.learning.models.model_file import Model, load_model  # noqa: E402
from gelforge.synthesis.draws import drawn_path, shard_count  # noqa: E402
from gelforge.synthesis.rows import solve, write_rows  # noqa: E402

FOLDER = Path("results/edges")
EDGES = {"own": 0.0, "ball": 0.0, "punch": 0.0, "pair": 0.0, "mesh": 0.0, "edge": 1.0}
SAMPLE = 1000  # training rows whose error is printed
SERIES = 4  # image series of each test edge: other particles


def edges_only(study: Study, paths: int, seed: int) -> Study:
    """Return a study whose synthesis presses edges alone."""
    synthesis = study.synthesis.model_dump() | {"paths": paths, "seed": seed}
    synthesis["shapes"] |= EDGES
    synthesis["classes"] |= {"straight": 0.0, "light": 0.0, "paths": 1.0}
    return study.with_values({"synthesis": synthesis})


def solved(study: Study, laws: dict, folder: Path) -> list[Path]:
    """Return the files of a study's solved edges, solved unless they are there."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{number:05d}.h5" for number in range(study.synthesis.paths)]
    for number, path in enumerate(files):
        if not path.is_file():
            one = drawn_path(study, number)
            write_cell(path, solve(one, laws))
            print(f"{path}: {one.study.indenter.words}", flush=True)
    return files


def wider(bins: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return forces (n, B, 3) [N] of nx by ny bins summed over two by two neighbours (n, B / 4, 3)."""
    nx, ny = shape
    return bins.reshape(-1, ny // 2, 2, nx // 2, 2, 3).sum(axis=(2, 4)).reshape(len(bins), -1, 3)


def errors(model: Model, rows: ShardDataset, chosen: np.ndarray, study: Study) -> dict[str, float]:
    """Return errors [mN] in the study's bins, in bins twice as wide, and of the total; and rms forces of pressed bins."""
    block = rows.read(chosen, (FEATURE, LABEL, "untouched"))
    true, said = block[LABEL].astype(float), model.predict(block[FEATURE])
    nx, ny = study.sensor.bins.nx, study.sensor.bins.ny
    widths = np.array([study.sensor.width_x_mm, study.sensor.width_y_mm])
    row = {}
    for times, one, label in ((1, said, true), (2, wider(said, (nx, ny)), wider(true, (nx, ny)))):
        name = f"{study.sensor.width_x_mm / nx * times:g} mm"
        found = force_errors(one, label, block["untouched"], (nx // times, ny // times, widths))
        row |= {f"bins of {name}, RMSES {axis}": found[f"RMSES {axis} [mN]"] for axis in "xyz"}
        pressed = label[..., 2][label[..., 2] != 0]
        row[f"bins of {name}, rms Fz"] = 1e3 * float(np.sqrt(np.mean(pressed**2)))
        row["total Fz"] = found["total Fz [mN]"]
    return row


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("study", nargs="?", type=Path, default=Path("config/simulated.yaml"))
    parser.add_argument("--materials", type=Path, default=Path("results/benchmark"))
    parser.add_argument("--steps", nargs="+", type=int, default=[8000, 16000])
    parser.add_argument("--paths", type=int, default=14)
    parser.add_argument("--tested", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    # the study whose materials are fitted, from which inverse elasticity takes them
    study = load_study(arguments.study).model_copy(update={"study": arguments.materials.name})
    laws = laws_of(arguments.materials, study)
    learnt = edges_only(study, arguments.paths, study.synthesis.seed)
    others = edges_only(study, arguments.tested, study.synthesis.seed + 1000)
    tested = ShardDataset(other_rows(others, laws, FOLDER / "tested", SERIES))
    presses = solved(learnt, laws, FOLDER / "solved")
    shards = [FOLDER / "rows" / f"{number:05d}.h5" for number in range(shard_count(learnt))]
    for number, path in enumerate(shards):
        if not path.is_file():
            path.parent.mkdir(parents=True, exist_ok=True)
            print(write_rows(learnt, number, presses, path), flush=True)
    training = ShardDataset(shards)
    sample = np.random.default_rng(arguments.seed).choice(len(training), SAMPLE, replace=False)
    table = {}
    for steps in arguments.steps:
        learning = learnt.learning.model_copy(update={"steps": steps})
        path, _ = trained(learnt.model_copy(update={"seed": arguments.seed, "learning": learning}), shards)
        model = load_model(path)
        table[f"{steps} steps, training rows"] = errors(model, training, np.sort(sample), study)
        table[f"{steps} steps, test rows"] = errors(model, tested, np.arange(len(tested)), study)
        print(f"{steps} steps: {table[f'{steps} steps, test rows']}", flush=True)
    print(
        f"\n{len(training)} training rows of {arguments.paths} edges, {len(tested)} rows of {arguments.tested} others, mN:\n"
    )
    print(pd.DataFrame(table).to_markdown(floatfmt=".3g"))


if __name__ == "__main__":
    main()
