"""`gelforge show` and `gelforge explain`: a label as a picture, and where a row comes from."""

from __future__ import annotations

import json
from pathlib import Path


def show(path: Path, row: int | None, out: Path | None) -> None:
    """Draw the label of a cell's depth or a shard's row."""
    from gelforge.report.figures.simulation.label_figure import label_figure

    target = out or Path(f"{path.stem}{'' if row is None else f'-{row}'}.png")
    label_figure(path, row).savefig(target, dpi=110)
    print(target)


def explain(path: Path, row: int) -> None:
    """Print where one row of a shard comes from."""
    from gelforge.dataset.shard import lineage

    print(json.dumps(lineage(path, row), indent=2, default=str))
