"""Networks that benchmarks train: kept by what decides them, so that several benchmarks share one training."""

from __future__ import annotations

import json
import time
from pathlib import Path

from gelforge.cli.model.learning import inverse_elasticity
from gelforge.config import Study
from gelforge.files import digest, source_digest
from gelforge.learning.training.train import Run, model_settings, train

KEPT = Path("results/trained")


def trained(study: Study, shards: list[Path], folder: Path = KEPT) -> tuple[Path, float]:
    """Return the file of a study's network, trained on one thread unless it is kept, and its training's CPU seconds.

    An interrupted training goes on; its seconds are those of its last run.
    """
    decides = [
        model_settings(study, shards),
        source_digest("learning/basis", "learning/networks", "learning/training"),
    ]
    path = folder / f"{digest(decides)}.pt"
    cost = path.with_suffix(".json")
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        inverse = inverse_elasticity(study, shards)
        started = time.process_time()
        train(study, shards, path, path.with_suffix(".csv"), Run(threads=1), inverse)
        cost.write_text(json.dumps({"cpu_s": time.process_time() - started}))
    return path, json.loads(cost.read_text())["cpu_s"]
