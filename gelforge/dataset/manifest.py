"""What stands next to the shards: manifest with checksums and provenance, card, Croissant description, SHA256SUMS."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from gelforge import __version__
from gelforge.config import Study
from gelforge.config.basis.variants import merged
from gelforge.dataset.card import card, croissant
from gelforge.dataset.join import shard_settings_digest
from gelforge.dataset.schema import DatasetError
from gelforge.dataset.shard import ShardDataset, shard_attributes
from gelforge.files import digest, file_sha256, read_product_json, write_json, write_product_json, write_text

FORMAT = "gelforge-dataset-1"
SUMS = "SHA256SUMS"


def describe_dataset(
    study: Study, shards: Sequence[str | Path], feature_files: Mapping[str, str | Path], folder: str | Path
) -> dict:
    """Write manifest.json, README.md, croissant.json and SHA256SUMS into the dataset's folder.

    The same shards, features and raw files give the same bytes.

    Parameters
    ----------
    study : Study
        Sensor, plan and split.
    shards : sequence of str or Path
        All shards.
    feature_files : mapping of str to str or Path
        Features of each session.
    folder : str or Path
        The dataset's folder.

    Returns
    -------
    dict
        The manifest.
    """
    folder = Path(folder)
    manifest = make_manifest(study, shards, feature_files)
    write_product_json(folder / "manifest.json", manifest)
    write_text(folder / "README.md", card(study, manifest))
    write_json(folder / "croissant.json", croissant(study, manifest))
    named = [*(Path(path).name for path in shards), "manifest.json", "README.md", "croissant.json"]
    write_text(folder / SUMS, "".join(f"{file_sha256(folder / name)}  {name}\n" for name in named))
    return manifest


def make_manifest(
    study: Study, shards: Sequence[str | Path], feature_files: Mapping[str, str | Path]
) -> dict:
    """Return the dataset's files, sites, sessions, raw files and settings, each with its SHA-256 or digest."""
    attributes = [shard_attributes(path) for path in shards]
    _check_one_dataset(shards, attributes)
    for name, expected in (("study", study.study), ("settings_digest", shard_settings_digest(study))):
        if attributes and attributes[0][name] != expected:
            raise DatasetError(
                f"{shards[0]}: {name} is {attributes[0][name]!r}, expected {expected!r} of this study; build the shard again"
                f" (snakemake -R {shards[0]})"
            )
    cells = {name: cell for one in attributes for name, cell in one["cells"].items()}
    failed = {name: reason for one in attributes for name, reason in one["failed_cells"].items()}
    sessions: dict[str, dict] = {}
    for one in attributes:
        for name, session in one["sessions"].items():
            sessions[name] = merged(sessions.get(name, {}), session)
    for session, path in feature_files.items():
        sessions.setdefault(session, {})["features_sha256"] = file_sha256(path)
    rows = {split: len(ShardDataset(shards, split)) for split in ("train", "test")}
    return {
        "format": FORMAT,
        "code_version": __version__,
        "study": study.study,
        "synthetic": any(one["synthetic"] for one in attributes),
        "labels_only": all(one["labels_only"] for one in attributes),
        "rows": {**rows, "all": sum(rows.values())},
        "split": {"by": "orbit", "seed": study.seed, "test_fraction": study.dataset.test_fraction},
        "settings": study.dataset_settings,
        "settings_digest": digest(study.dataset_settings),
        "shards": [_file(path, rows=int(one["rows"])) for path, one in zip(shards, attributes)],
        "cells": cells,
        "failed_cells": failed,
        "sessions": sessions,
        "raw_files": [_file(path, whole_path=True) for path in raw_files(study)],
    }


def raw_files(study: Study) -> Iterable[Path]:
    """Return the raw files of a study in order: material tests, then recordings; hidden files are not among them."""
    folders = [material.tests for material in study.materials.values() if material.tests]
    folders += [study.session_folder(session) for session in study.sessions]
    paths = {path for folder in folders for path in Path(folder).rglob("*") if path.is_file()}
    files = sorted(path for path in paths if not path.name.startswith("."))
    files += [material.file for material in study.materials.values() if material.file]
    return files + ([study.plan.file] if study.plan.file else [])


def verify(folder: str | Path) -> list[str]:
    """Return the names in SHA256SUMS whose file is missing or has changed, as `sha256sum -c` would."""
    folder = Path(folder)
    wrong = []
    for line in (folder / SUMS).read_text(encoding="utf-8").splitlines():
        expected, name = line.split("  ", 1)
        if not (folder / name).is_file() or file_sha256(folder / name) != expected:
            wrong.append(name)
    return wrong


def read_manifest(path: str | Path) -> dict:
    """Return a dataset's manifest.

    Parameters
    ----------
    path : str or Path
        manifest.json.

    Returns
    -------
    dict
        Shards with their SHA-256, raw files, settings and failed sites.

    Raises
    ------
    DatasetError
        For a file that is missing, damaged or no manifest.
    """
    path = Path(path)
    manifest = read_product_json(path, f"build the dataset again (snakemake -R {path})", DatasetError)
    if manifest.get("format") != FORMAT:
        raise DatasetError(
            f"{path}: format {manifest.get('format')!r}, expected {FORMAT!r}; build the dataset again"
        )
    return manifest


def check_shards(shards: Sequence[str | Path], manifest: str | Path) -> None:
    """Refuse a shard that is not the one that the manifest lists; without a manifest nothing is known.

    Parameters
    ----------
    shards : sequence of str or Path
        Shards to be read.
    manifest : str or Path
        manifest.json.

    Raises
    ------
    DatasetError
        Names shard and remedy.
    """
    if not Path(manifest).is_file():
        return
    listed = {shard["file"]: shard["sha256"] for shard in read_manifest(manifest)["shards"]}
    for path in map(Path, shards):
        if path.is_file() and listed.get(path.name) != file_sha256(path):
            raise DatasetError(
                f"{path}: not the shard that {manifest} lists; build both again (snakemake -R {path})"
            )


def _file(path: str | Path, whole_path: bool = False, **more) -> dict:
    path = Path(path)
    name = path.as_posix() if whole_path else path.name
    return {"file": name, "bytes": path.stat().st_size, "sha256": file_sha256(path), **more}


def _check_one_dataset(shards: Sequence[str | Path], attributes: Sequence[dict]) -> None:
    """Raise DatasetError for shards of different studies or settings, or a site in two of them."""
    seen: dict[str, str | Path] = {}
    for path, one in zip(shards, attributes):
        for name in ("study", "settings_digest", "split_seed", "test_fraction", "labels_only"):
            if one[name] != attributes[0][name]:
                raise DatasetError(
                    f"{path}: {name} is {one[name]!r}, but {attributes[0][name]!r} in {shards[0]}; build the dataset again"
                )
        for cell in one["cells"]:
            if cell in seen:
                raise DatasetError(f"{path}: site {cell} is also in {seen[cell]}; build the dataset again")
            seen[cell] = path
