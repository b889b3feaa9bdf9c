"""Faults of inputs."""

from __future__ import annotations

import argparse

from benchmarks.fault_kinds.outcomes import Fault, report

KINDS: dict = {}  # name of the kind: what makes and judges its faults


def run(asked: argparse.Namespace) -> int:
    """Make the faults, print their table and return the exit status."""
    if asked.list:
        print("\n".join(KINDS))
        return 0
    faults: list[Fault] = []
    return report(faults, asked.verbose)
