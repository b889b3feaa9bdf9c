"""The job that fits the constitutive model of a material."""

from __future__ import annotations

from pathlib import Path

from gelforge.config import ConfigError, load_study


def fit_law(study: Path, material: str, out: Path) -> None:
    """Write the law of a material, its curves, tables and measured effects."""
    from gelforge.materials.characterise import characterise

    described = load_study(study)
    if material not in described.materials:
        raise ConfigError(f"{study}: no material {material!r}; it has {sorted(described.materials)}")
    characterise(material, described.materials[material], out, described.study)
