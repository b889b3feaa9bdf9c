"""The sites of a study's plan by name, and where their cells lie."""

from __future__ import annotations

from pathlib import Path

from gelforge.config import ConfigError, Study


def cell_path(study: Study, name: str) -> Path:
    return study.results_folder / "cells" / f"{name}.h5"


def site_path(study: Study, name: str) -> Path:
    return study.results_folder / "solved_sites" / f"{name}.h5"


def planned_cell(study: Study, name: str):
    """Return a cell of the plan by name."""
    from gelforge.indentation.planning.plan import plan_cells

    cells = plan_cells(study)
    if name not in cells:
        raise ConfigError(
            f"cell {name!r} is not in the plan of study {study.study}; its {len(cells)} cells begin with "
            f"{', '.join(list(cells)[:3])}"
        )
    return cells[name]


def print_outcome(cell: str, result, how: str) -> None:
    """Say in the log what became of a cell, and whether it was solved now."""
    reason = f" {result.attributes['reason']}" if result.attributes["reason"] else ""
    print(f"{cell}: {result.attributes['status']}{reason}; {how}")
