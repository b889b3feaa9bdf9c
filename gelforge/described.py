"""A study of blocks that somebody gives by their keys, by a section, or by a YAML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import chdir
from pathlib import Path
from typing import Any

from gelforge.config import Study, load_study, study_from
from gelforge.config.common import Section
from gelforge.config.variants import merged
from gelforge.shipped import EXAMPLES

Described = Section | Mapping[str, Any]  # a block of a study: its keys, or the section that they make


def paper_study() -> Study:
    """Return the article's sensor with its published laws, as config/paper.yaml among the examples describes it."""
    with chdir(EXAMPLES):
        return load_study("config/paper.yaml")


def described_study(
    study: Study | str | Path | None = None,
    sensor: Described | str | Path | None = None,
    indenter: Described | str | Path | None = None,
    materials: Mapping[str, Described] | None = None,
    mechanics: Described | None = None,
    sensitivities: Sequence[str] = (),
) -> Study:
    """Return a study whose blocks are those that are given, validated as a whole; without a study the article's.

    Each block replaces the study's own but `mechanics`, whose keys change the study's. Raises ConfigError.
    """
    base = paper_study() if study is None else study if isinstance(study, Study) else load_study(study)
    given = {"sensor": sensor, "indenter": indenter, "mechanics": mechanics}
    given = {key: _plain(block) for key, block in given.items() if block is not None}
    if materials is not None:
        given["materials"] = {name: _plain(material) for name, material in materials.items()}
    content = base.model_dump(mode="json", exclude={"variants", "synthesis"})
    changes = given.pop("mechanics", {}) | ({"sensitivities": list(sensitivities)} if sensitivities else {})
    content["mechanics"] = merged(content["mechanics"], changes)
    return study_from(content | given, "gelforge.press")


def _plain(block) -> Any:
    """Return a block's keys, or the path of its YAML file as text."""
    if isinstance(block, Section):
        return block.model_dump(mode="json")
    return str(block) if isinstance(block, str | Path) else dict(block)
