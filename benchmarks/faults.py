"""What gelforge does with what is wrong: mutated inputs, damaged products, killed processes and full disks.

usage: python -m benchmarks.faults inputs   [--seed 1] [--count 2000]   mutated tables, YAML files and recordings
       python -m benchmarks.faults products [--seed 1] [--count 500]    damaged cells, shards, models, readings, tables
       python -m benchmarks.faults kills    [--seed 1] [--count 60]     SIGKILL, SIGTERM and a full disk at every stage
       python -m benchmarks.faults workflow                             shell text, killed runs, cancelled Slurm jobs
       python -m benchmarks.faults code                                 a spoilt line for each battery of tests

Run from the repository's root. Each prints a table for docs/results/faults.md and exits with 1 where a number is above what
is held to. The same seed gives the same faults; --only KIND runs one kind, --list prints the kinds.
"""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path

PARTS = {
    "inputs": 2000,
    "products": 500,
    "kills": 60,
    "workflow": 7,
    "code": 45,
}  # subcommand, a module of fault_kinds: faults by default


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parts = parser.add_subparsers(dest="part", required=True)
    for name, count in PARTS.items():
        one = parts.add_parser(name)
        one.add_argument("--seed", type=int, default=1)
        one.add_argument("--count", type=int, default=count, help="faults in all")
        one.add_argument("--only", help="one kind of fault")
        one.add_argument("--list", action="store_true", help="print the kinds and do nothing")
        if name not in ("inputs", "code"):
            one.add_argument(
                "--study", type=Path, help="folder of a finished run of config/test.yaml; else it is made"
            )
        one.add_argument("--verbose", action="store_true", help="print every fault with what came of it")
    asked = parser.parse_args()
    return import_module(f"benchmarks.fault_kinds.{asked.part}").run(asked)


if __name__ == "__main__":
    sys.exit(main())
