"""The files of constitutive models that a study has fitted, each checked to be its own."""

from __future__ import annotations

from pathlib import Path

from gelforge.config import Study
from gelforge.laws_of_study import law_path


def read_laws(study: Study) -> dict:
    """Return the study's laws [MPa] by material."""
    return {law.material: law.law for law in own_laws(study)}


def own_laws(study: Study) -> list:
    """Return the study's laws with what is known of them, in the order of its materials."""
    return [study_law(study, law_path(study, material), material) for material in study.materials]


def study_laws(study: Study, paths: list[Path]) -> dict:
    """Return by material the laws of files, with what is known of them; each layer's material must be among them."""
    from gelforge.materials.fitting.law_file import LawFileError

    read = {law.material: law for law in (study_law(study, path) for path in paths)}
    missing = sorted({layer.material for layer in study.sensor.layers} - read.keys())
    if missing:
        raise LawFileError(
            f"{', '.join(map(str, paths))}: no constitutive model of {missing} among those of {sorted(read)}; run"
            " the material stage again"
        )
    return read


def study_law(study: Study, path: Path, material: str | None = None):
    """Return a law after checking that it is that of a material (None: of any) of this study, made for no other study."""
    from gelforge.materials.fitting.law_file import LawFileError, read_law

    law = read_law(path)
    expected = [material] if material else study.materials
    if law.material not in expected or law.study not in ("", study.study):
        raise LawFileError(
            f"{path}: the constitutive model of {law.material!r} of study {law.study!r}, expected"
            f" {material or sorted(study.materials)}"
            f" of study {study.study!r}; run the material stage again (snakemake -R {path})"
        )
    return law
