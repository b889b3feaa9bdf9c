"""Commands that make SYNTHETIC data."""

from __future__ import annotations

from pathlib import Path

from gelforge.cli.parsers.common import FRESH, study_command


def add(commands) -> None:
    """Add the commands of a virtual lab."""
    materials = study_command(
        commands,
        "virtual-materials",
        "factory.virtual_materials",
        "SYNTHETIC raw material tests of a virtual lab",
    )
    materials.add_argument("--material", help="one material; all of the virtual lab if not given")

    cell = study_command(
        commands, "virtual-cell", "factory.virtual_cell", "one cell of the virtual sensor's truth"
    )
    cell.add_argument("--cell", required=True, help="name of the cell in the plan")
    cell.add_argument("--out", type=Path, required=True, help="the cell's HDF5 file to write")
    cell.add_argument("--fresh", action="store_true", help=FRESH)

    session = study_command(
        commands, "virtual-session", "factory.virtual_session", "one SYNTHETIC session of a virtual lab"
    )
    session.add_argument("--session", required=True, help="name of the session in the virtual lab")
    session.add_argument("--workers", type=int, default=1, help="threads that draw images")
