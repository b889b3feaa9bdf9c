"""Where a study's shards lie, and what its labels and readings are compared from."""

from __future__ import annotations

from pathlib import Path

from gelforge.config import Study


def shard_paths(study: Study) -> list[Path]:
    """Return the files of every shard of the plan, in order."""
    from gelforge.indentation.planning.plan import plan_cells

    count = -(-len(plan_cells(study)) // study.dataset.cells_per_shard)
    return [study.results_folder / "dataset" / f"shard-{i:05d}.h5" for i in range(count)]


def agreement_inputs(study: Study, laws: dict) -> tuple[dict, dict]:
    """Return what the digests of the study's cells and of its sessions' tables are under its present settings and laws."""
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.indentation.solving.inputs import inputs_digest
    from gelforge.recording.readings import raw_digest

    cells = {name: inputs_digest(study, laws, cell) for name, cell in plan_cells(study).items()}
    return cells, {name: raw_digest(study.session_folder(name)) for name in study.sessions}
