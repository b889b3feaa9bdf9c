"""Jobs of the dataset: shards, their manifest, agreement with what was measured, and simulated training rows."""

from __future__ import annotations

from pathlib import Path

from gelforge.cli.products import (
    agreement_inputs,
    cell_path,
    feature_path,
    image_sessions,
    own_labels,
    read_laws,
    session_of,
    shard_paths,
)
from gelforge.config import ConfigError, load_study


def join(study: Path, shard: int, out: Path) -> None:
    """Write one shard: a fixed chunk of the plan, every cell checked against the present settings and laws."""
    from gelforge.dataset.join import join_shard
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.indentation.solving.inputs import inputs_digest
    from gelforge.recording.features import features_digest

    described = load_study(study)
    planned, size = plan_cells(described), described.dataset.cells_per_shard
    chunk = list(planned)[shard * size : (shard + 1) * size]
    if not chunk:
        raise ConfigError(
            f"shard {shard}: the plan's {len(planned)} cells fill {-(-len(planned) // size)} shards of {size}"
        )
    laws = read_laws(described)
    features = {name: feature_path(described, name) for name in image_sessions(described)}
    cells = {name: cell_path(described, name) for name in chunk}
    of_cells = {name: inputs_digest(described, laws, planned[name]) for name in chunk}
    of_features = {
        name: features_digest(described.session_folder(name), session_of(described, name), described.features)
        for name in features
    }
    labels = own_labels(described, {name: planned[name] for name in chunk}, laws)
    rows = join_shard(described, chunk, cells, features, out, of_cells, of_features, labels)
    print(f"{out}: {rows} rows" + ("" if features else " (labels only: the study has no images)"))


def manifest(study: Path) -> None:
    """Write manifest, checksums, card and Croissant description next to the shards."""
    from gelforge.dataset.manifest import describe_dataset

    described = load_study(study)
    features = {name: feature_path(described, name) for name in image_sessions(described)}
    describe_dataset(described, shard_paths(described), features, described.results_folder / "dataset")


def agreement(study: Path, out: Path) -> None:
    """Write total forces, simulated next to measured, one row per press."""
    from gelforge.dataset.agreement import agreement_table, write_agreement
    from gelforge.files import digest
    from gelforge.indentation.planning.plan import plan_cells

    described = load_study(study)
    recorded = {name: described.results_folder / "recordings" / f"{name}.csv" for name in described.sessions}
    planned = plan_cells(described)
    cells = {name: cell_path(described, name) for name in planned}
    laws = read_laws(described)
    digests, raw = agreement_inputs(described, laws)
    labels = own_labels(described, planned, laws)
    table = agreement_table(recorded, cells, labels, digests, raw)
    write_agreement(out, table, digest([digests, raw]))
