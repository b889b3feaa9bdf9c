"""`gelforge characterise`: fits a constitutive model to test files; its figure and tables, and the effects they measure."""

from __future__ import annotations

from pathlib import Path

from gelforge.config import Fitting, section_from
from gelforge.materials.characterise import characterise_source
from gelforge.materials.readers.material_source import read_sources
from gelforge.report.figures.measurements.material_figure import material_figure


def characterise_command(
    sources: list[Path],
    mapping: Path | None,
    laws: str,
    out: Path,
    choose: str = "aicc",
    loss: str = "linear",
    bootstrap: int = 0,
    workers: int = 1,
) -> None:
    """Write the results of each material in folders or files; print what was chosen, why, and what was measured.

    laws: names with commas between; bootstrap: refits for the intervals next to the sandwich covariance, 0 for none.
    """
    names = [name.strip() for name in laws.split(",") if name.strip()]
    keys = {"laws": names, "choose": choose, "loss": loss, "bootstrap": bootstrap}
    fitting = section_from(Fitting, keys, "gelforge characterise")
    materials = read_sources(sources, mapping)
    for material in materials:
        folder = out / material.name if len(materials) > 1 else out
        characterised = characterise_source(material, fitting, folder, workers, law_needed=False)
        if characterised.comparison:
            figure = material_figure(folder / "law.json", folder / "curves.csv", characterised.other_laws)
            for suffix in ("png", "svg"):
                figure.savefig(folder / f"material.{suffix}", dpi=130)
        print(characterised.summary)
        print(f"written to {folder}\n")
