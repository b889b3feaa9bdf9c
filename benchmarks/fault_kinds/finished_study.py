"""A finished run of config/test.yaml, and commands run on a copy of it, each in a process of its own."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.fault_kinds.forks import end_with
from benchmarks.fault_kinds.outcomes import LIMIT_S, Ended

ROOT = Path(__file__).parents[2]
USUAL = Path("results/faults/study")  # where the run is made, from the repository's root
STUDY, RESULTS = "config/test.yaml", Path("results/test")


def finished(folder: Path | None) -> Path:
    """Return the folder of a finished run; the usual one is made where it is not there, in some minutes."""
    folder = (folder or USUAL).absolute()
    if (folder / RESULTS / "report.html").is_file():
        return folder
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(ROOT / "Snakefile", folder)
    for name in ("workflow", "config", "data"):
        shutil.copytree(ROOT / name, folder / name, dirs_exist_ok=True)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    command = [sys.executable, "-m", "snakemake", "--cores", "1", "--configfile", STUDY]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"the study was not made: {done.stderr[-2000:]}")
    return folder


def copy_of(study: Path, target: Path) -> Path:
    """Return a copy of a finished run whose results are links: products are replaced, never written into."""
    shutil.rmtree(target, ignore_errors=True)
    (target / "out").mkdir(parents=True)
    for name in ("config", "data"):
        (target / name).symlink_to(study / name)
    shutil.copytree(study / "results", target / "results", copy_function=os.link)
    return target


def replaced(path: Path, content: bytes) -> None:
    """Put content in place of a file without touching others that share its bytes."""
    path.unlink(missing_ok=True)
    path.write_bytes(content)


def in_child(
    arguments: Sequence[str],
    folder: Path,
    limit_s: float = LIMIT_S,
    stop: signal.Signals = signal.SIGKILL,
    largest_file: int | None = None,
) -> Ended:
    """Return how a gelforge command ended in a folder, run in a fork of this process: nothing is imported anew.

    stop: the signal that it gets after limit_s; largest_file: bytes beyond which it can write no file.
    """
    read, write = os.pipe()
    child = os.fork()
    if not child:
        if largest_file is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))
        end_with(lambda: _run(arguments, folder, write))
    os.close(write)
    signal.signal(signal.SIGALRM, lambda *_: os.kill(child, stop))
    signal.setitimer(signal.ITIMER_REAL, limit_s, LIMIT_S)  # and again, should it hang
    with os.fdopen(read, "rb") as pipe:
        said = pipe.read().decode(errors="replace")
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    signal.setitimer(signal.ITIMER_REAL, 0)
    return Ended(None if status == -signal.SIGKILL and limit_s == LIMIT_S else status, said)


def _run(arguments: Sequence[str], folder: Path, output: int) -> int:
    os.chdir(folder)
    for number in (1, 2):
        os.dup2(output, number)
    from gelforge.cli import main

    return main(list(map(str, arguments)))
