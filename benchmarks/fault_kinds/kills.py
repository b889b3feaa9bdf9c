"""SIGKILL, SIGTERM and a full disk at every stage: what is left, and what the same command makes of it afterwards.

A limit on the size of files stands for the full disk: writing fails in the same places, and no other program suffers.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np

from benchmarks.fault_kinds.finished_study import RESULTS, STUDY, copy_of, finished, in_child

READ = (
    "gelforge.cli.jobs.sites",
    "gelforge.learning.training.train",
    "gelforge.report.page",
    "gelforge.indentation.solving.companion",
)
KINDS = ("SIGKILL", "SIGTERM", "full disk")
COLUMNS = (
    "ended by it",
    "damaged products",
    "tracebacks",
    "other result afterwards",
    "files left afterwards",
)


@dataclass(frozen=True)
class Stage:
    """A command of the workflow and what it writes within the study's folder."""

    arguments: tuple[str, ...]
    made: tuple[str, ...]

    @property
    def name(self) -> str:
        return self.arguments[0]


def stage(command: str, *arguments: str, made: Sequence[str]) -> Stage:
    return Stage((command, "--study", STUDY, *arguments), tuple(str(RESULTS / name) for name in made))


def to_file(command: str, name: str, *arguments: str) -> Stage:
    return stage(command, *arguments, "--out", str(RESULTS / name), made=[name])


LAWS = tuple(str(RESULTS / "materials" / name / "law.json") for name in ("ecoflex_gel", "elastosil_25_1"))
GEL = str(RESULTS / "materials/ecoflex_gel")
STAGES = (
    stage("fit-law", "--material", "ecoflex_gel", "--out", GEL, made=["materials/ecoflex_gel/law.json"]),
    to_file("plan", "plan.csv"),
    to_file("simulate", "cells/x0_y0.h5", "--cell", "x0_y0", "--laws", *LAWS),
    to_file("readings", "recordings/morning.csv", "--session", "morning"),
    to_file("features", "features/evening.h5", "--session", "evening"),
    to_file("join", "dataset/shard-00000.h5", "--shard", "0"),
    stage("manifest", made=["dataset/manifest.json"]),
    to_file("agreement", "agreement.csv"),
    stage(
        "train",
        *("--model", str(RESULTS / "model/model.pt"), "--loss", str(RESULTS / "model/loss.csv")),
        made=["model/model.pt", "model/loss.csv"],
    ),
    to_file("evaluate", "model/predictions.h5", "--model", str(RESULTS / "model/model.pt")),
    stage("tables", made=["tables/rmse.csv", "tables/rmse_gt.csv"]),
)


def run(asked: argparse.Namespace) -> int:
    """Disturb every stage, print the table of what came of it and return the exit status."""
    if asked.list:
        print("\n".join(KINDS))
        return 0
    study = finished(asked.study)
    for name in READ:
        import_module(name)
    kinds = [asked.only] if asked.only else list(KINDS)
    rng, rows = np.random.default_rng(asked.seed), []
    with tempfile.TemporaryDirectory(dir=study, prefix="faults-") as scratch:
        used = STAGES[: asked.count]
        whole = {one: undisturbed(one, study, Path(scratch) / "whole") for one in used}
        try:
            for number in range(asked.count):
                one, kind = STAGES[number % len(STAGES)], kinds[number // len(STAGES) % len(kinds)]
                found = disturbed(one, kind, study, Path(scratch) / "disturbed", *whole[one], rng)
                rows.append((kind, found))
                if asked.verbose or any(found[1:]):
                    print(one.name, kind, dict(zip(COLUMNS, found)), file=sys.stderr)
        except KeyboardInterrupt:
            print(f"interrupted after {len(rows)} of {asked.count}", file=sys.stderr)
    print("| fault | " + " | ".join(["number", *COLUMNS]) + " |")
    print("|---|" + "---:|" * (len(COLUMNS) + 1))
    for kind in (*kinds, "all"):
        counted = [found for of, found in rows if kind in (of, "all")]
        print(f"| {kind} | {len(counted)} | " + " | ".join(str(sum(c)) for c in zip(*counted)) + " |")
    return int(any(any(found[1:]) for _, found in rows))


def undisturbed(one: Stage, study: Path, folder: Path) -> tuple[list[bytes], float]:
    """Return what a stage writes, and its seconds."""
    copy_of(study, folder)
    began = time.perf_counter()
    ended = in_child(one.arguments, folder)
    if ended.status:
        raise SystemExit(f"undisturbed: {one.name} ended with {ended.status}: {ended.said}")
    return [(folder / name).read_bytes() for name in one.made], time.perf_counter() - began


def disturbed(
    one: Stage,
    kind: str,
    study: Path,
    folder: Path,
    whole: list[bytes],
    seconds: float,
    rng: np.random.Generator,
) -> tuple[bool, ...]:
    """Return what COLUMNS name of one disturbed run, and of the same command once more."""
    copy_of(study, folder)
    for name in one.made:
        (folder / name).unlink()
    before = {path.relative_to(folder) for path in (folder / "results").rglob("*")}
    if kind == "full disk":
        size = int(rng.uniform(0, 1) * max(map(len, whole)))
        ended = in_child(one.arguments, folder, largest_file=size)
    else:
        ended = in_child(one.arguments, folder, rng.uniform(0.02, 1.0) * seconds, signal.Signals[kind])
    damaged = any(
        (folder / name).is_file() and (folder / name).read_bytes() != content
        for name, content in zip(one.made, whole)
    )
    again = in_child(one.arguments, folder)
    same = not again.status and [(folder / name).read_bytes() for name in one.made] == whole
    after = {path.relative_to(folder) for path in (folder / "results").rglob("*")}
    left = {path for path in after - before if ".tmp" in path.name or "checkpoint" in path.name}
    return bool(ended.status), damaged, "Traceback" in ended.said, not same, bool(left)
