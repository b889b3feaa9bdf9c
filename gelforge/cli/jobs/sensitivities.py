"""The job that solves how a site's forces follow each cause that a verdict may ask for."""

from __future__ import annotations

from pathlib import Path

from gelforge.cli.products import planned_cell
from gelforge.config import load_study


def sensitivities(study: Path, cell: str, laws: list[Path], out: Path) -> None:
    """Solve the derivatives of one site's forces and write them into a file."""
    from gelforge.mismatch.fem.site_slopes import slopes_of_site, write_site_slopes
    from gelforge.mismatch.pipeline.stage import solver_of

    described = load_study(study)
    planned = planned_cell(described, cell)
    solver = solver_of(described, out.parent, laws, None, 1, [])
    site = slopes_of_site(solver, planned)
    write_site_slopes(out, solver, site)
    missing = [f"{key}: {one}" for key, one in site.found.items() if isinstance(one, str)]
    print(f"{cell}: {len(site.found) - len(missing)} derivatives at {len(site.planned.depths_mm)} depths")
    for line in missing:
        print(f"no derivative along {line}")
