"""The commands and their arguments; standard library only."""

from __future__ import annotations

import argparse

from gelforge.cli.parsers import by_hand, cameras, live, studies, virtual, workflow

GROUPS = """\
a study            init, examples, check, show, explain, report, tables, adapt, unlock
by hand            import, press, characterise, verify, mismatch, mismatch-materials
live               export, predict, live
cameras            calibrate-camera, camera-pose
what the workflow runs
                   fit-law, plan, simulate, level, derive, sensitivities, simulate-session, readings, features, join,
                   manifest, agreement, train, evaluate
synthetic data     synthesise, virtual-materials, virtual-cell, virtual-session
"""


def parser() -> argparse.ArgumentParser:
    """Return the parser of every command."""
    from gelforge import __version__

    top = argparse.ArgumentParser(
        prog="gelforge",
        description="Force-distribution labels, datasets and models for soft, vision-based tactile sensors.",
        epilog=GROUPS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="version", version=__version__)
    commands = top.add_subparsers(metavar="COMMAND", required=True)
    for family in (studies, by_hand, cameras, live, workflow, virtual):
        family.add(commands)
    return top
