"""What decides a cell's numbers, as one digest."""

from __future__ import annotations

from gelforge.config import Study
from gelforge.files import digest, source_digest
from gelforge.indentation.plan import PlannedCell
from gelforge.mechanics.laws import Ogden


def inputs_digest(study: Study, laws: dict[str, Ogden], planned: PlannedCell) -> str:
    """Return the digest of everything that decides a cell's numbers: settings, laws, position, depths, sources."""
    materials = {layer.material for layer in study.sensor.layers}
    return digest(
        {
            "sensor": study.sensor.model_dump(mode="json"),
            "indenter": study.indenter.model_dump(mode="json"),
            "mechanics": study.mechanics.model_dump(mode="json"),
            "laws": {name: [laws[name].mu, laws[name].alpha] for name in materials},
            "cell": [planned.x_mm, planned.y_mm, planned.depths_mm, planned.source, planned.symmetry],
            "sources": source_digest("mechanics", "indentation"),
        }
    )
