"""Mutated inputs: each file of a small study in turn is spoilt in one way, and the command that reads it is run.

What came of it:

- refused: an error exit and one line, or one for each error that a single fault makes, eight at most;
- unchanged: accepted, and what decides the labels is the same, to the digit;
- excluded: accepted, and the command says which values it leaves out, with the test that found them;
- meant: accepted with another result, where the mutant is a file that a person could have written so. No reader can tell
  it from an honest one: a key that is left out and has a default, a value within the range of a setting that is chosen
  freely (seed, friction, mesh, alpha; `yaml_mutants.CHOSEN`), a table or YAML file that ends earlier at the end of a row or
  key, a byte that makes another name or number, lateral forces of the other sign or a smaller size, x for y on a square
  sensor, a test that took a thousand times as long, a single value that is off by less than a tenth of its column's range
  (`table_mutants.NOISE`; a fit averages it), a reading of a material test that stands twice, presses counted in thousands,
  a sensor without a wall, the length of an indenter's shaft;
- changed: accepted with another result, although nobody can have meant the file: must not be;
- traceback, long message (a line above 2 kB, or more lines), hang (two minutes; a mutant takes a second): must not be;
- wrongly refused: a right neighbour of a fault (`people_mutants`) is not accepted: must not be.

What decides the labels is: of study, sensor, indenter and plan the digest of every cell's inputs; of a recording all
readings that are written for the join; of material tests the law, its covariance and the measured effects; of a mapping the
tests as read; of logs the readings of the session, to 2 um and 2 mN; of a surface its volume and size.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from benchmarks.fault_kinds import people_mutants, table_mutants, yaml_mutants
from benchmarks.fault_kinds.input_world import EXPORT, INPUTS, LOGS, SURFACE, Input, write_world
from benchmarks.fault_kinds.outcomes import LIMIT_S, LONGEST_MESSAGE, MOST_ERRORS, Fault, report
from benchmarks.fault_kinds.table_mutants import Mutant, Table


class Hang(BaseException):
    """A mutant took longer than LIMIT_S."""


LOG_ATOL = 2e-3  # mm and N, of readings at times that an epoch's stamps move by a microsecond

Command = Callable[[], int]  # returns the exit status and prints what it says


def _main(*arguments: str) -> Command:
    """Return a command of the command line."""

    def run() -> int:
        from gelforge.cli import main

        return main(list(arguments))

    return run


def _refusing(run: Callable[[], object]) -> Command:
    """Return a command that does what run does and says in one line what the package refuses, as the command line does."""

    def command() -> int:
        try:
            run()
        except ValueError as error:
            if not type(error).__module__.startswith("gelforge."):
                raise
            print(f"gelforge: {error}", file=sys.stderr)
            return 1
        return 0

    return command


def _plan() -> object:
    """Return the digests of all cells' inputs, each as if it were solved and not mirrored."""
    from gelforge.config import load_study
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.indentation.solving.inputs import inputs_digest
    from gelforge.mechanics.laws.models.neo_hooke import NeoHooke

    study = load_study("study.yaml")
    laws = {name: NeoHooke(0.02) for name in study.materials}  # parameters that are given count by themselves
    given = {name: material.model_dump(mode="json") for name, material in study.materials.items()}
    cells = {name: replace(cell, source=None, symmetry=None) for name, cell in plan_cells(study).items()}
    labels = {name: inputs_digest(study, laws, cell) for name, cell in sorted(cells.items())}
    return [labels, given, study.sessions, str(study.data)]


def _lab() -> object:
    from gelforge.config import load_virtual_lab

    return load_virtual_lab("lab.yaml").model_dump(mode="json")


def _readings(session: str) -> Callable[[], object]:
    return lambda: Path(f"out/{session}.csv").read_text().split("\n", 1)[1]  # the header holds checksums


def _law() -> object:
    law = json.loads(Path("out/gel/law.json").read_text())
    effects = json.loads(Path("out/gel/effects.json").read_text())
    return [law["parameters"], law["covariance"], effects["effects"]]


def _foreign() -> object:
    """Return the tests as read; a fit of them takes fifteen seconds, and another test runs the fit."""
    from gelforge.materials.readers.material_source import source_of

    source = source_of("foreign", Path("data/exports"), Path("mapping.yaml"))
    arrays = (
        None if a is None else a.tolist()
        for t in source.tests
        for a in (t.stretch, t.nominal_stress, t.time_s)
    )
    return list(arrays)


def _import_logs() -> None:
    """Make a session of the logs and check it, as `import` does, without its page, which takes a second."""
    from gelforge.importing.importer import import_logs, write_imported
    from gelforge.recording.readings import read_recording

    session = Path("out/logs")
    session.mkdir(parents=True)
    write_imported(session, import_logs("logs.yaml", "logs"))
    found = read_recording(session).findings
    print("excluded" if found.of("excluded") else "")


def _logged() -> object:
    from gelforge.recording.readings import read_recording

    readings = read_recording(Path("out/logs")).readings
    held = readings[readings["phase"].isin(["load", "dwell"])]
    return held[["x_mm", "y_mm", "depth_mm", "fx_N", "fy_N", "fz_N"]].to_numpy()


def _same(found: object, control: object) -> bool:
    if isinstance(found, np.ndarray) and isinstance(control, np.ndarray):
        return found.shape == control.shape and np.allclose(
            found, control, rtol=0, atol=LOG_ATOL, equal_nan=True
        )
    return found == control


def _read_surface() -> int:
    """Read a surface; closed_surface knows no file and refuses with a plain ValueError, which the caller puts into words."""
    try:
        _body()
    except ValueError as error:
        print(f"gelforge: {error}", file=sys.stderr)
        return 1
    return 0


def _body() -> object:
    """Return volume and size of the closed surface."""
    from gelforge.indentation.sensor.indenter_shapes import read_triangles
    from gelforge.mechanics.indenters.closed_surface import closed_surface

    points, triangles = read_triangles(Path("ball.obj"))
    closed_surface(points, triangles, 0.2)
    a, b, c = points[triangles].transpose(1, 0, 2)
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
    return [round(volume, 3), np.ptp(points[np.unique(triangles)], axis=0).round(4).tolist()]


CHECK = _main("check", "study.yaml", "--picture", "out/p.png")
# by name: the commands that read a file, the quickest first, and what decides the labels
COMMANDS: dict[str, tuple[tuple[Command, ...], Callable[[], object]]] = {
    "plan": ((_main("plan", "--study", "study.yaml", "--out", "out/plan.csv"), CHECK), _plan),
    "lab": ((_main("check", "synthetic.yaml", "--picture", "out/p.png"),), _lab),
    "day": (
        (_main("readings", "--study", "study.yaml", "--session", "day", "--out", "out/day.csv"),),
        _readings("day"),
    ),
    "night": (
        (_main("readings", "--study", "study.yaml", "--session", "night", "--out", "out/night.csv"),),
        _readings("night"),
    ),
    "gel": ((_main("fit-law", "--study", "study.yaml", "--material", "gel", "--out", "out/gel"),), _law),
    # as `fit-law` and `characterise` read tests, without the fit, which takes fifteen seconds
    "foreign": ((_refusing(_foreign),), _foreign),
    "logs": ((_refusing(_import_logs),), _logged),
    "surface": ((_read_surface,), _body),
}


def tried(command: str, limit_s: int = int(LIMIT_S)) -> tuple[str, str, object]:
    """Return how a command ends in the working directory ("" where it is done), what it said, and its result."""
    commands, result = COMMANDS[command]
    shutil.rmtree("out", ignore_errors=True)
    said = io.StringIO()
    signal.signal(signal.SIGALRM, _alarm)
    signal.alarm(limit_s)
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            status = next((status for run in commands if (status := run())), 0)
            found = None if status else result()
    except Hang:
        return "hang", "", None
    except Exception:
        return "traceback", traceback.format_exc(), None
    finally:
        signal.alarm(0)
    text = said.getvalue()
    if not status:
        return "", text, found
    lines = [line for line in text.splitlines() if line.startswith("gelforge: ")]
    whole = text[text.find("gelforge: ") :].strip()
    wrong = (
        len(lines) != 1
        or whole.count("\n") >= MOST_ERRORS
        or len(max(whole.split("\n"), key=len)) > LONGEST_MESSAGE
    )
    return ("long message" if wrong else "refused"), whole or text, None


def _alarm(*_) -> None:
    raise Hang


def judged(kind: str, of: Input, mutant: Mutant, control: object) -> Fault:
    """Return what came of a mutant that lies in the place of its file."""
    how, said, found = tried(of.command)
    what = f"{of.path}: {mutant.what}"
    if how:
        return Fault(kind, what, "wrongly refused" if mutant.honest and how == "refused" else how, said)
    if _same(found, control):
        return Fault(kind, what, "unchanged", said)
    if "excluded" in said:
        return Fault(kind, what, "excluded", said)
    return Fault(kind, what, "meant" if mutant.can_be_meant else "changed", said)


def mutants(rng: np.random.Generator, contents: dict[str, bytes]) -> Iterator[tuple[str, Input, Mutant]]:
    """Yield kinds, inputs and mutants without end: all kinds in turn, each of a random input."""
    tables = [one for one in INPUTS if one.is_table]
    texts = [one for one in INPUTS if not one.is_table]
    while True:
        for name, mutate in table_mutants.MUTATIONS.items():
            of = tables[rng.integers(len(tables))]
            yield f"table: {name}", of, mutate(Table(contents[of.path], of), rng)
        for name, mutate in yaml_mutants.MUTATIONS.items():
            of = texts[rng.integers(len(texts))]
            mutant = mutate(yaml.safe_load(contents[of.path]), rng)
            if mutant is not None:
                yield f"YAML: {name}", of, mutant
        of, other = (INPUTS[k] for k in rng.choice(len(INPUTS), 2, replace=False))
        like = of.is_table and other.is_table and set(of.numbers) <= set(other.numbers)
        yield "file: another's", of, Mutant(contents[other.path], f"holds {other.path}", like)
        of = INPUTS[rng.integers(len(INPUTS))]
        noise = rng.integers(0, 256, int(rng.integers(0, 4000)), dtype=np.uint8).tobytes()
        yield "file: random bytes", of, Mutant(noise, f"holds {len(noise)} random bytes")
        yield "file: pipe, device, folder, nothing", INPUTS[rng.integers(len(INPUTS))], Mutant(b"", "")
        for name, mutate in people_mutants.LOGS.items():
            of = LOGS[rng.integers(2) if name != "counts" else 0]
            yield f"log: {name}", of, mutate(Table(contents[of.path], of), rng)
        for name, mutate in people_mutants.CURVES.items():
            yield f"curve: {name}", EXPORT, mutate(Table(contents[EXPORT.path], EXPORT), rng)
        yield "surface", SURFACE, people_mutants.surface(contents[SURFACE.path], rng)


SPECIAL = ("a pipe", "an endless device", "a folder", "nothing", "a link to itself")


def replace_by_special(path: Path, which: str) -> None:
    path.unlink()
    if which == "a pipe":
        os.mkfifo(path)
    elif which == "an endless device":
        path.symlink_to("/dev/zero")
    elif which == "a folder":
        path.mkdir()
    elif which == "a link to itself":
        path.symlink_to(path.name)


def remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        path.rmdir()
    else:
        path.unlink(missing_ok=True)


def run_all(
    seed: int, count: int, only: str | None = None, show: Callable[[Fault], None] = lambda fault: None
) -> list[Fault]:
    """Return what came of so many mutants. Raises RuntimeError where an untouched control is not accepted."""
    home, rng, faults = Path.cwd(), np.random.default_rng(seed), []
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            write_world(Path(folder))
            contents = {one.path: Path(one.path).read_bytes() for one in (*INPUTS, *LOGS, SURFACE)}
            controls: dict[str, object] = {}
            for number, (kind, of, mutant) in enumerate(mutants(rng, contents)):
                if number >= count:
                    return faults
                if only and only != kind:
                    continue
                if of.command not in controls:
                    how, said, controls[of.command] = tried(of.command, 0)  # the first compiles
                    if how:
                        raise RuntimeError(f"the untouched control of {of.command} ends with {how}: {said}")
                path = Path(of.path)
                if kind.startswith("file: pipe"):
                    which = SPECIAL[rng.integers(len(SPECIAL))]
                    mutant = Mutant(b"", f"is {which}", which == "nothing")
                    replace_by_special(path, which)
                else:
                    path.write_bytes(mutant.content)
                faults.append(judged(kind, of, mutant, controls[of.command]))
                show(faults[-1])
                remove(path)
                path.write_bytes(contents[of.path])
        finally:
            os.chdir(home)
    return faults


def run(asked: argparse.Namespace) -> int:
    """Make the mutants, print their table and return the exit status."""
    if asked.list:
        kinds = [f"table: {name}" for name in table_mutants.MUTATIONS]
        kinds += [f"YAML: {name}" for name in yaml_mutants.MUTATIONS]
        kinds += ["file: another's", "file: random bytes", "file: pipe, device, folder, nothing"]
        kinds += [f"log: {name}" for name in people_mutants.LOGS]
        print("\n".join([*kinds, *(f"curve: {name}" for name in people_mutants.CURVES), "surface"]))
        return 0

    def show(fault: Fault) -> None:
        if asked.verbose:
            print(f"{fault.outcome}: {fault.kind}: {fault.what}", file=sys.stderr, flush=True)

    return report(run_all(asked.seed, asked.count, asked.only, show))
