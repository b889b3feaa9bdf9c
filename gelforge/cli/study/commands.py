"""Arguments of the commands for a study: init, examples, sensors, check, show, explain, unlock."""

from __future__ import annotations

from pathlib import Path

from gelforge.cli.common import add_command, add_study


def add(commands) -> None:
    """Add the commands for a study."""
    init = add_command(
        commands,
        "init",
        "study.init.init",
        "write a commented configuration and sample tables for a new study",
    )
    init.add_argument("study", help="name of the new study")
    init.add_argument(
        "--sensor", metavar="NAME", help="of this sensor, ready to run; `gelforge sensors` lists them"
    )

    add_command(
        commands,
        "examples",
        "study.init.examples",
        "write the example studies, the demo among them, and their data into this folder",
    )

    sensors = add_command(
        commands,
        "sensors",
        "study.shipped_sensors.sensors",
        "list the sensors that are shipped, or draw one cut through its middle",
    )
    sensors.add_argument("name", nargs="?", help="a shipped sensor, or a study's YAML file")
    sensors.add_argument("--out", type=Path, help="PNG to write; NAME.png if not given")

    check = add_command(
        commands,
        "check",
        "study.check.check",
        "check a study and its data, all errors at once; draw it; print cells, minutes and disk",
    )
    add_study(check, "study")
    check.add_argument("--picture", type=Path, help="PNG to write; results/<study>/check.png if not given")

    show = add_command(
        commands, "show", "study.show.show", "draw a label: a cell's or a shard's force distribution"
    )
    show.add_argument("path", type=Path, metavar="CELL_OR_SHARD", help="an HDF5 file")
    show.add_argument(
        "row", type=int, nargs="?", help="depth step of a cell or row of a shard; the last if not given"
    )
    show.add_argument(
        "--out", type=Path, help="PNG to write; named after the file, in the working directory, if not given"
    )

    explain = add_command(
        commands,
        "explain",
        "study.show.explain",
        "say where one row of a shard comes from, down to raw files",
    )
    explain.add_argument("path", type=Path, metavar="SHARD", help="a shard")
    explain.add_argument("row", type=int, help="row of the shard")

    add_command(
        commands,
        "unlock",
        "study.unlock.unlock",
        "after a run that was killed: end what it left computing and release its lock",
    )
