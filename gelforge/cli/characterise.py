"""`gelforge characterise`: anybody's test files to a law, its figure and its tables."""

from __future__ import annotations

from pathlib import Path

from gelforge.characterisation.by_hand import characterise_tests, read_tests
from gelforge.report.material_figure import material_figure


def characterise_command(
    sources: list[Path],
    mapping: Path | None,
    laws: str,
    out: Path,
    loss: str = "linear",
    bootstrap: int = 0,
    workers: int = 1,
) -> None:
    """Write law.json, tables, curves and figure of each material in folders or files; print what was chosen and why.

    laws: names with commas between; bootstrap: refits for the intervals beside the sandwich covariance, 0 for none.
    """
    materials = read_tests(sources, mapping)
    for material in materials:
        folder = out / material.name if len(materials) > 1 else out
        names = [name.strip() for name in laws.split(",") if name.strip()]
        characterised = characterise_tests(material, names, folder, loss, bootstrap, workers)
        figure = material_figure(folder / "law.json", folder / "curves.csv", characterised.other_laws)
        for suffix in ("png", "svg"):
            figure.savefig(folder / f"material.{suffix}", dpi=130)
        print(characterised.summary)
        print(f"written to {folder}\n")
