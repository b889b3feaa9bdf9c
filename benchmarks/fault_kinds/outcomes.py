"""What came of a fault: how a command ended and what it said, counted by kind as a Markdown table."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

LONGEST_MESSAGE = 2048  # bytes
MOST_ERRORS = 8  # lines of one fault: what `check` lists of a file of another kind, and what follows
LIMIT_S = 120.0  # a command of a small study that takes longer hangs

# outcomes that are right: refused in one line, the same result as without the fault, or made anew
RIGHT = ("refused", "unchanged")
# of inputs also: left out and told, or a file that a person could have meant (see inputs.py)
RIGHT_OF_INPUTS = ("excluded", "meant")
# outcomes that must not be
WRONG = ("changed", "traceback", "long message", "hang", "wrongly refused")


@dataclass(frozen=True)
class Fault:
    """One fault with what came of it."""

    kind: str
    what: str  # e.g. the file and the bit
    outcome: str  # one of RIGHT or WRONG
    said: str = ""


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    status: int | None  # None: it was still running after LIMIT_S
    said: str  # standard error and output

    @property
    def complaint(self) -> str:
        """Return what is wrong with how it ended whatever it was given: "" if nothing."""
        if self.status is None:
            return "hang"
        if "Traceback (most recent call last)" in self.said:
            return "traceback"
        if self.status and len(self.said.encode()) > LONGEST_MESSAGE:
            return "long message"
        return ""


def gelforge(arguments: Sequence[str], folder: Path, limit_s: float = LIMIT_S, **environment: str) -> Ended:
    """Return how a gelforge command ended in a folder, on one thread."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    root = str(Path(__file__).parents[2])
    paths = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH", ""))))
    try:
        done = subprocess.run(
            [sys.executable, "-m", "gelforge", *map(str, arguments)],
            cwd=folder,
            env=os.environ | threads | {"PYTHONPATH": paths} | environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=limit_s,
        )
    except subprocess.TimeoutExpired:
        return Ended(None, "")
    return Ended(done.returncode, (done.stderr + done.stdout).decode(errors="replace"))


def table(faults: Sequence[Fault]) -> str:
    """Return outcomes by kind as a Markdown table, with a last row of sums."""
    found = {fault.outcome for fault in faults}
    names = [*RIGHT, *(name for name in RIGHT_OF_INPUTS if name in found), *WRONG]
    kinds = list(dict.fromkeys(fault.kind for fault in faults))
    lines = ["| " + " | ".join(["kind", "faults", *names]) + " |", "|---|" + "---:|" * (len(names) + 1)]
    for kind in [*kinds, "all"]:
        counted = Counter(fault.outcome for fault in faults if kind in (fault.kind, "all"))
        lines.append(
            f"| {kind} | {sum(counted.values())} | " + " | ".join(str(counted[n]) for n in names) + " |"
        )
    return "\n".join(lines)


def report(faults: Sequence[Fault], verbose: bool = False) -> int:
    """Print the table and every fault whose outcome must not be; return the exit status."""
    wrong = [fault for fault in faults if fault.outcome in WRONG]
    for fault in faults if verbose else wrong:
        print(f"{fault.outcome}: {fault.kind}: {fault.what}: {fault.said.strip()[-300:]}", file=sys.stderr)
    print(table(faults))
    return 1 if wrong else 0
