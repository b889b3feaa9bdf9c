"""A network trained in simulation alone, on recordings and on another virtual sensor, before and after a few presses.

usage: python benchmarks/transfer.py [results/simulated] [--recorded results/benchmark] [--others 24]
       [--seeds 1 2 3] [--unseen-edges]
       (one thread; after `snakemake --configfile config/simulated.yaml`; the other sensor is solved once,
       ten CPU seconds an indentation, and kept in results/simulated/other_sensor; trained networks are kept
       in results/trained, and an interrupted training goes on)

All data is SYNTHETIC. The other sensor has a gel 12 % stiffer, another mesh, particles, camera and light than the training
set, and is pressed by unseen shapes too: a wedge from a file, and edges with --unseen-edges, which
leaves edges out of the training rows. Prints Markdown tables, medians over seeds: errors of bins and totals before and after
20 presses of that sensor with its total force measured, and which rows the check of totals marks. Two rows say where errors
on recordings come from: the error once forces are scaled by the best gain, and errors on the same indentations simulated.
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

from gelforge.config import Study, load_study  # noqa: E402
from gelforge.dataset.shard import ShardDataset, shard_attributes  # noqa: E402
from gelforge.indentation.cells.cell_file import read_cell  # noqa: E402
from gelforge.learning.basis.data import FEATURE, LABEL  # noqa: E402
from gelforge.learning.judging.evaluation import CONTACT_N, LIGHT_N  # noqa: E402
from gelforge.learning.models.model_file import Model, load_model  # noqa: E402
from gelforge.learning.training.adaptation import Presses, adapt, measured_presses, press_names  # noqa: E402
from gelforge.materials.fitting.law_file import read_law  # noqa: E402
from gelforge.mechanics.laws.models.ogden import Ogden  # noqa: E402
from gelforge.synthesis.draws import drawn_path, shard_count, site_places  # noqa: E402
from gelforge.synthesis.images import series_features  # noqa: E402
from gelforge.synthesis.rows import SERIES_ROWS, solve, write_rows, write_solved  # noqa: E402
from gelforge.synthesis.straight import StraightPresses  # noqa: E402

STIFFER = 1.12
NOISE_N = np.array(
    [0.008, 0.008, 0.015]
)  # of the other sensor's force readings, as in the benchmark study's virtual lab
PRESSES = 20
WRONG = 0.15, 0.05  # a total that is off by more than this share and by more than this many N
OTHERS = 24  # indentations of the other sensor
WEDGE = Path("config/indenters/wedge.stl")


def other_study(study: Study, count: int) -> Study:
    """Return the study of the other sensor's indentations: other draws, shapes, mesh, camera and light."""
    drawn = study.synthesis
    shapes = drawn.shapes.model_copy(update={"mesh": 3.0, "edge": 3.0, "files": [WEDGE]})
    views = drawn.views.model_copy(update={"brightness_share": 0.3})
    mesh = study.mechanics.mesh.model_copy(update={"near_mm": 0.36, "far_mm": 1.3})
    changed = {"seed": drawn.seed + 1000, "paths": count, "shapes": shapes, "views": views}
    mechanics = study.mechanics.model_copy(update={"mesh": mesh})
    return study.model_copy(update={"synthesis": drawn.model_copy(update=changed), "mechanics": mechanics})


def laws_of(results: Path, study: Study) -> dict:
    return {name: read_law(results / "materials" / name / "law.json").law for name in study.materials}


def stiffer(laws: dict, study: Study) -> dict:
    """Return the laws with the gel's (the layer with particles) stiffer."""
    gel = next(layer.material for layer in study.sensor.layers if layer.particle_volume_fraction > 0)
    law = laws[gel]
    return laws | {gel: Ogden(tuple(STIFFER * mu for mu in law.mu), law.alpha)}


def other_rows(study: Study, laws: dict, folder: Path, series: int = 1) -> list[Path]:
    """Return the shards of a study's paths as they are, each drawn in some image series; solved or kept."""
    paths = []
    for number in range(study.synthesis.paths):
        paths.append(folder / f"{number:05d}.h5")
        if not paths[-1].is_file():
            folder.mkdir(parents=True, exist_ok=True)
            one = drawn_path(study, number)
            cell = solve(one, laws)
            print(
                f"{one.planned.name}: {one.study.indenter.words}, {len(cell.arrays['depth_mm'])} steps",
                flush=True,
            )
            write_solved(study, one, cell, paths[-1], study.synthesis.seed, series)
    return paths


def solved_others(results: Path, count: int = OTHERS) -> list[Path]:
    """Return the shards of the other sensor of a finished study of simulated sensors, solved or kept in its folder."""
    study = load_study(results / "study.yaml")
    laws = stiffer(laws_of(results, study), study)
    return other_rows(other_study(study, count), laws, results / "other_sensor")


def rows_without(results: Path, kind: str) -> list[Path]:
    """Return shards of training rows drawn from all solved presses but those of a kind; made once and kept."""
    study = load_study(results / "study.yaml")
    sites = len(site_places(study))
    solved = sorted((results / "synthetic" / "solved").glob("*.h5"))
    kept = solved[:sites] + [p for k, p in enumerate(solved[sites:]) if drawn_path(study, k).kind != kind]
    shards = [results / f"without_{kind}" / f"{k:05d}.h5" for k in range(shard_count(study))]
    for number, path in enumerate(shards):
        if not path.is_file():
            path.parent.mkdir(parents=True, exist_ok=True)
            print(write_rows(study, number, kept, path), flush=True)
    return shards


def simulated_again(results: Path, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return features (n, 2 m) and labels (n, B, 3) [N] of straight presses (n, 3) [mm], drawn as training rows are.

    places: position and depth of each; those outside the solved ones are left out. The camera is the described one, as that
    of the recordings.
    """
    study = load_study(results / "study.yaml")
    exact = {"focal_share": 0.0, "centre_px": 0.0, "rotation_deg": 0.0}
    views = study.synthesis.views.model_copy(update=exact)
    study = study.model_copy(update={"synthesis": study.synthesis.model_copy(update={"views": views})})
    solved = sorted((results / "synthetic" / "solved").glob("*.h5"))[: len(site_places(study))]
    straight = StraightPresses(study, [read_cell(path) for path in solved])
    presses = [straight.at(at[:2], at[2]) for at in places if straight.reaches(at[:2], at[2])]
    features = []
    for first in range(
        0, len(presses), SERIES_ROWS
    ):  # each series has particles, camera and light of its own
        drawn = presses[first : first + SERIES_ROWS]
        rng = np.random.default_rng([study.synthesis.seed, 2, first])
        features += list(series_features(study, drawn, f"again-{first}", rng))[1:]
    return np.stack(features), np.stack([press.bins(study.sensor) for press in presses])


class Rows:
    """Rows that test, in memory, with their classes."""

    def __init__(self, paths: list[Path], split: str | None = None):
        rows = ShardDataset(paths, split)
        names = (FEATURE, LABEL, "phase", "cell", "untouched", "position_mm", "depth_mm")
        block = rows.read(np.arange(len(rows)), names)
        kinds = {n: a.get("kind", "") for p in paths for n, a in shard_attributes(p)["cells"].items()}
        self.feature, self.label = block[FEATURE], block[LABEL].astype(float)
        self.kind = np.array([kinds[name] for name in block["cell"]])
        self.phase, self.cell, self.untouched = block["phase"], block["cell"], block["untouched"]
        self.place = np.column_stack([block["position_mm"], block["depth_mm"]])  # (n, 3) [mm]

    def errors(self, model: Model, chosen: np.ndarray, grid: tuple) -> dict[str, float]:
        """Return errors [mN, mm] over some rows, and shares inside the intervals."""
        said, true = model.predict(self.feature[chosen]), self.label[chosen]
        touched, error = ~self.untouched[chosen], said - true
        row, total = force_errors(said, true, ~touched, grid), error.sum(axis=1)
        push = np.linalg.norm(true.sum(axis=1), axis=1)
        wrong = np.abs(total[:, 2]) > np.maximum(WRONG[0] * push, WRONG[1])
        marked = model.disagreement(self.feature[chosen], said) > 1
        row["rows"] = len(said)
        row["wrong totals [%]"], row["marked [%]"] = 100 * wrong.mean(), 100 * marked.mean()
        row["of wrong totals marked [%]"] = 100 * marked[wrong].mean() if wrong.any() else np.nan
        observable, light = push >= CONTACT_N, touched & (push <= LIGHT_N)
        row["seen of 20 mN and more [%]"] = 100 * said[observable].any(axis=(1, 2)).mean()
        row["mean error up to 50 mN [mN]"] = 1e3 * total[light, 2].mean() if light.any() else np.nan
        if model.intervals:
            inside = np.abs(total) <= model.intervals.of_totals(said)
            bins = np.abs(error) <= model.intervals.of_bins(said)
            row["totals in 90 % [%]"] = 100 * inside[touched].mean()
            row["bins in 90 % [%]"] = 100 * bins[(true != 0).any(axis=-1)].mean()
        return row

    def presses(self, chosen: np.ndarray, rng: np.random.Generator) -> Presses:
        """Return the rows as presses of a force sensor: true totals with its noise."""
        total = self.label[chosen].sum(axis=1)
        return Presses(
            self.feature[chosen], total + NOISE_N * rng.standard_normal(total.shape), self.cell[chosen]
        )


def on_recordings(
    model: Model,
    tested: Rows,
    again: tuple[np.ndarray, np.ndarray],
    readings: Presses,
    seed: int,
    grid: tuple,
) -> dict[str, float]:
    """Return a model's errors on recorded rows against labels, and of totals against readings before and after presses.

    again: features and labels of the same presses, simulated.
    """
    row = tested.errors(model, np.ones(len(tested.cell), bool), grid)
    said = model.predict(tested.feature)
    gain = (said[..., 2] * tested.label[..., 2]).sum() / (said[..., 2] ** 2).sum()
    row["best gain of z"] = gain
    row["RMSES z at that gain [mN]"] = rmses_z(said * gain, tested.label, tested.untouched, grid)
    feature, label = again
    row["RMSES z, simulated [mN]"] = rmses_z(model.predict(feature), label, np.zeros(len(label), bool), grid)
    names = np.random.default_rng(seed).permutation(np.unique(readings.press.astype(str)))
    few, rest = (np.isin(readings.press.astype(str), part) for part in (names[:PRESSES], names[PRESSES:]))
    after = adapt(model, readings.of(few))[0]
    for when, one in (("before", model), ("after", after)):
        error = one.predict(readings.feature[rest]).sum(axis=1) - readings.measured[rest]
        row[f"against readings {when}, total Fz [mN]"] = 1e3 * np.sqrt((error[:, 2] ** 2).mean())
    return row


def rmses_z(said: np.ndarray, true: np.ndarray, untouched: np.ndarray, grid: tuple) -> float:
    return force_errors(said, true, untouched, grid)["RMSES z [mN]"]


def on_other(model: Model, other: Rows, seed: int, grid: tuple) -> dict[str, dict[str, float]]:
    """Return a model's errors on the other sensor by class of rows, before and after presses of other indentations."""
    rng = np.random.default_rng(seed)
    cells = rng.permutation(np.unique(other.cell[~other.untouched]))
    first = cells[:PRESSES]  # one row of each: deepest load step
    few = np.array([np.flatnonzero((other.cell == c) & (other.phase == "load"))[-1] for c in first])
    rest = ~np.isin(other.cell, first)
    after = adapt(model, other.presses(few, rng))[0]
    classes = {
        "all": np.ones(len(rest), bool),
        "a wedge from a file": other.kind == "mesh",
        "edges": other.kind == "edge",
        "balls": np.isin(other.kind, ("own", "ball")),
        "sheared steps": other.phase == "shear",
        "sheared steps of balls": np.isin(other.kind, ("own", "ball")) & (other.phase == "shear"),
    }
    found = {}
    for name, chosen in classes.items():
        for when, one, rows in (("before", model, chosen), ("after", after, chosen & rest)):
            if (rows & ~other.untouched).any():
                found[f"{name}, {when}"] = other.errors(one, rows, grid)
    return found


def middle_and_range(rows: list[dict[str, float]]) -> pd.DataFrame:
    """Return the median, least and greatest of figures over seeds."""
    found = pd.DataFrame(rows)
    return pd.DataFrame({"median": found.median(), "least": found.min(), "greatest": found.max()})


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="?", type=Path, default=Path("results/simulated"))
    parser.add_argument("--recorded", type=Path, default=Path("results/benchmark"))
    parser.add_argument("--others", type=int, default=OTHERS)
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3])
    parser.add_argument("--unseen-edges", action="store_true", help="no edge among the training rows")
    arguments = parser.parse_args()
    study, recorded = (load_study(path / "study.yaml") for path in (arguments.results, arguments.recorded))
    unseen = arguments.unseen_edges
    simulated = (
        rows_without(arguments.results, "edge")
        if unseen
        else sorted((arguments.results / "synthetic").glob("*.h5"))
    )
    shards = sorted((arguments.recorded / "dataset").glob("shard-*.h5"))
    other = Rows(solved_others(arguments.results, arguments.others))
    tested = Rows(shards, "test")
    rows = ShardDataset(shards, "test")
    readings = measured_presses(rows, press_names(rows))
    again = simulated_again(arguments.results, np.unique(tested.place[~tested.untouched], axis=0))
    bins = study.sensor.bins
    grid = bins.nx, bins.ny, np.array([study.sensor.width_x_mm, study.sensor.width_y_mm])
    on_rows: dict[str, list] = {"trained on recordings": [], "trained in simulation": []}
    on_sensor: dict[str, list] = {name: [] for name in on_rows}
    for seed in arguments.seeds:
        for name, described, learnt in (
            ("trained on recordings", recorded, shards),
            ("trained in simulation", study, simulated),
        ):
            seeded = described.model_copy(update={"seed": seed})
            path, seconds = trained(seeded, learnt)
            model = load_model(path)
            row = on_recordings(model, tested, again, readings, seed, grid) | {"training CPU [s]": seconds}
            on_rows[name].append(row)
            on_sensor[name].append(on_other(model, other, seed, grid))
            print(f"{name}, seed {seed}: {on_rows[name][-1]}", flush=True)
    print(f"\n{len(ShardDataset(simulated))} simulated rows; recorded test rows of {arguments.recorded}:\n")
    print(
        pd.concat({n: middle_and_range(rows) for n, rows in on_rows.items()}, axis=1).to_markdown(
            floatfmt=".3g"
        )
    )
    for name, runs in on_sensor.items():
        classes = dict.fromkeys(c for run in runs for c in run)
        table = {c: pd.DataFrame([run[c] for run in runs if c in run]).median() for c in classes}
        print(f"\n{name}, on another sensor, before and after {PRESSES} presses:\n")
        print(pd.DataFrame(table).T.to_markdown(floatfmt=".3g"))


if __name__ == "__main__":
    main()
