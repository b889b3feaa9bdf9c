"""A study's virtual lab, and where the truth lies that it has made."""

from __future__ import annotations

from pathlib import Path

from gelforge.config import ConfigError, Study, load_virtual_lab


def virtual_lab_of(study: Study, path: Path):
    """Return the study's virtual lab, or say that it has none."""
    if study.virtual_lab is None:
        raise ConfigError(f"{path}: the study has no virtual_lab; name its YAML file to make synthetic data")
    lab = load_virtual_lab(study.virtual_lab)
    if study.mirrors_cells and not lab.mechanics.effects.has_symmetry_of_square:
        raise ConfigError(
            f"{study.virtual_lab}: its mechanics.effects have a place, a direction or an order, but {path} mirrors cells"
            f" (plan.symmetry: {study.plan.symmetry}); use symmetry: none"
        )
    return lab


def truth_folder(study: Study) -> Path:
    """Return where the cells of the study's virtual sensor lie."""
    return study.data_folder / "virtual_truth" / "cells"
