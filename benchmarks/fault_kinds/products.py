"""Damaged products: what the next stage says, or whether its result is the same."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np

from benchmarks.fault_kinds.damage import EXCHANGED, KINDS
from benchmarks.fault_kinds.finished_study import RESULTS, STUDY, copy_of, finished, in_child
from benchmarks.fault_kinds.outcomes import Fault, report

READ = (
    "gelforge.cli.jobs.dataset",
    "gelforge.learning.training.train",
    "gelforge.report.page",
    "gelforge.dataset.join",
)


@dataclass(frozen=True)
class Reader:
    """A command that reads a product, and the files that it makes of it; none: what it prints counts."""

    arguments: tuple[str, ...]
    made: tuple[str, ...] = ()


def of_study(command: str, *arguments: str, made: Sequence[str] = ()) -> Reader:
    return Reader((command, "--study", STUDY, *arguments), tuple(made))


def to_file(command: str, name: str, *arguments: str) -> Reader:
    return of_study(command, *arguments, "--out", f"out/{name}", made=[f"out/{name}"])


def tables() -> Reader:
    names = ("material", "force_ranges", "rmse_gt", "rmse", "baselines", "errors_by")
    return of_study("tables", made=[f"{RESULTS}/tables/{name}.csv" for name in names])


def join(shard: int) -> Reader:
    return to_file("join", f"shard-{shard}.h5", "--shard", str(shard))


LAWS = [f"{RESULTS}/materials/{name}/law.json" for name in ("ecoflex_gel", "elastosil_25_1")]
AGREEMENT = to_file("agreement", "agreement.csv")
EVALUATE = to_file("evaluate", "predictions.h5", "--model", f"{RESULTS}/model/model.pt")
TRAIN = of_study(
    "train", "--model", "out/model.pt", "--loss", "out/loss.csv", made=["out/model.pt", "out/loss.csv"]
)
MANIFEST = of_study("manifest", made=[f"{RESULTS}/dataset/manifest.json"])


def shown(path: str) -> Reader:
    return Reader(("show", path, "--out", "out/label.png"), ("out/label.png",))


def readers(path: Path, cells: Sequence[str]) -> list[Reader]:
    """Return the commands that read a product, by its path within a study's folder; cells: all, in order of the plan."""
    name, kind = str(path), path.parts[len(RESULTS.parts)]
    if kind == "cells":
        mirror = to_file("simulate", "mirrored.h5", "--cell", "x2_y0", "--laws", *LAWS)
        own = [mirror] if path.stem == "x0_y0" else []
        return [join(cells.index(path.stem) // 4), AGREEMENT, shown(name), *own]
    return {
        "materials": [tables(), join(0), AGREEMENT],
        "recordings": [AGREEMENT],
        "features": [join(0), join(1)],
        "dataset": [TRAIN, shown(str(RESULTS / "dataset" / "shard-00000.h5"))]
        if path.suffix == ".json"
        else [MANIFEST, TRAIN, EVALUATE, Reader(("explain", name, "3")), shown(name)],
        "model": [tables()] if path.suffix == ".h5" else [EVALUATE],
        "agreement.csv": [tables()],
    }[kind]


PRODUCTS = (
    "cells/*.h5",
    "cells/*.h5",
    "materials/*/law.json",
    "recordings/morning.csv",
    "recordings/evening.csv",
    "features/*.h5",
    "dataset/shard-*.h5",
    "dataset/manifest.json",
    "model/model.pt",
    "model/predictions.h5",
    "agreement.csv",
)


def run(asked: argparse.Namespace) -> int:
    """Damage products, print the table of what came of it and return the exit status."""
    if asked.list:
        print("\n".join(KINDS))
        return 0
    study = finished(asked.study)
    for name in READ:
        import_module(name)
    kinds = [asked.only] if asked.only else list(KINDS)
    rng, faults = np.random.default_rng(asked.seed), []
    with tempfile.TemporaryDirectory(dir=study, prefix="faults-") as scratch:
        untouched = Untouched(study, Path(scratch) / "untouched")
        try:
            while len(faults) < asked.count:
                kind = kinds[len(faults) % len(kinds)]
                if fault := one(study, Path(scratch) / "damaged", kind, rng, untouched):
                    faults.append(fault)
        except KeyboardInterrupt:
            print(f"interrupted after {len(faults)} of {asked.count}", file=sys.stderr)
    return report(faults, asked.verbose)


def planned_cells(folder: Path) -> list[str]:
    """Return the study's cells in the order of its plan."""
    lines = (folder / RESULTS / "plan.csv").read_text().splitlines()[1:]
    return list(dict.fromkeys(line.split(",")[0] for line in lines))


class Untouched:
    """What each command makes of undamaged products."""

    def __init__(self, study: Path, scratch: Path):
        self.study, self.scratch, self.known = study, scratch, {}

    def result(self, reader: Reader) -> list[bytes]:
        if reader not in self.known:
            folder = copy_of(self.study, self.scratch)
            ended = in_child(reader.arguments, folder)
            if ended.status:
                raise SystemExit(
                    f"undamaged: {' '.join(reader.arguments)} ended with {ended.status}: {ended.said}"
                )
            self.known[reader] = made(reader, folder, ended.said)
        return self.known[reader]


def made(reader: Reader, folder: Path, said: str) -> list[bytes]:
    return [(folder / name).read_bytes() for name in reader.made] or [said.encode()]


def one(
    study: Path, scratch: Path, kind: str, rng: np.random.Generator, untouched: Untouched
) -> Fault | None:
    """Return one fault of a kind with what came of it, None where the draw does not apply to its product."""
    pattern = PRODUCTS[int(rng.integers(len(PRODUCTS)))]
    damage = KINDS[kind][int(rng.integers(len(KINDS[kind])))]
    folder = copy_of(study, scratch)
    paths = sorted((folder / RESULTS).glob(pattern))
    path = paths[int(rng.integers(len(paths)))]
    whole = path.read_bytes()
    what = damage(path, rng)
    if not what or path.read_bytes() == whole:
        return None
    name = path.relative_to(folder)
    choice = readers(name, planned_cells(folder))
    if kind in EXCHANGED:  # these two show the file that is named, whatever it is
        choice = [reader for reader in choice if reader.arguments[0] not in ("show", "explain")]
    reader = choice[int(rng.integers(len(choice)))]
    expected = untouched.result(reader)
    ended = in_child(reader.arguments, folder)
    words = f"{name}: {what}: {reader.arguments[0]}"
    if outcome := ended.complaint:
        return Fault(kind, words, outcome, ended.said)
    if ended.status:
        return Fault(kind, words, "refused", ended.said)
    same = made(reader, folder, ended.said) == expected
    return Fault(kind, words, "unchanged" if same else "changed", ended.said)
