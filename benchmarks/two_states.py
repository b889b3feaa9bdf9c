"""Two states of this repository, each in a folder of its own, and what commands cost in them: CPU seconds and memory."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
THREADS = {name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}
PR_SET_CHILD_SUBREAPER = 36
LOOK_S = 0.05  # between two looks whether a command has ended


@dataclass(frozen=True)
class Cost:
    """What a command took: CPU and wall seconds and the largest process; status 124: it was ended at the limit."""

    status: int
    cpu_s: float
    wall_s: float
    memory_MB: float
    printed: str


def state_before(reference: str, folder: Path) -> Path:
    """Write the files of a tag or commit into a folder and return it. Raises CalledProcessError for an unknown one."""
    folder.mkdir()
    archive = subprocess.run(["git", "-C", str(ROOT), "archive", reference], capture_output=True, check=True)
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive.stdout, check=True)
    return folder


def state_now(folder: Path) -> Path:
    """Copy the present files, edited ones too, into a folder and return it."""
    listed = subprocess.run(
        ["git", "-C", str(ROOT), "ls-files", "-co", "--exclude-standard", "-z"],
        capture_output=True,
        check=True,
    )
    for name in filter(None, listed.stdout.decode().split("\0")):
        if (ROOT / name).is_file() or (ROOT / name).is_symlink():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)
    return folder


def cost_of(command: list[str], state: Path, limit_s: float) -> Cost:
    """Run a Python module with arguments in a state's folder, by this interpreter, one thread a process; return its cost.

    What it leaves running when it ends, as a fork server, is waited for and counts too.
    """
    _adopt_orphans()
    others = _children()
    environment = {name: value for name, value in os.environ.items() if not name.startswith("SNAKEMAKE")}
    environment |= THREADS | {"PYTHONPATH": str(state)}
    log = state / "command.log"
    start = time.monotonic()
    with open(log, "w", encoding="utf-8") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", *command], cwd=state, env=environment, stdout=file, stderr=file
        )
        status, used = _ended(process.pid, start + limit_s)
    wall = time.monotonic() - start
    every = [used]
    while left := _children() - others:
        every += [os.wait4(child, 0)[2] for child in left]
    return Cost(
        status,
        sum(one.ru_utime + one.ru_stime for one in every),
        wall,
        max(one.ru_maxrss for one in every) / 1024,
        log.read_text(encoding="utf-8", errors="replace"),
    )


def _adopt_orphans() -> None:
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def _ended(process: int, deadline: float) -> tuple[int, object]:
    """Return exit status and use of a process; past the deadline it is ended, in order as by Ctrl-C."""
    late = False
    while True:
        found, status, used = os.wait4(process, os.WNOHANG)
        if found:
            return 124 if late else os.waitstatus_to_exitcode(status), used
        if not late and time.monotonic() > deadline:
            late = True
            os.kill(process, 15)
        time.sleep(LOOK_S)


def _children() -> set[int]:
    """Return the ids of this process's children, those that its threads began too."""
    lists = Path("/proc/self/task").glob("*/children")
    return {int(child) for listed in lists for child in listed.read_text().split()}
