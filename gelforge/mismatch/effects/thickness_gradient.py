"""The layer under the skin grows thicker to one side: it was poured on a slope."""

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import gel_layers
from gelforge.mismatch.model.solver_effects import as_vector, is_block, solved


def present(study: Study) -> list[float]:
    """Return the gradient [mm/mm] that the base study has."""
    thickness = study.mechanics.effects.geometry.thickness.get(gel_layers(study)[-1])
    return thickness.gradient if thickness else [0.0, 0.0]


EFFECT = solved(
    "thickness_gradient",
    ("x", "y"),
    (-0.1, 0.1),
    "width: 0.6 mm over a sensor of 30 mm (judgement); bounds: 3 mm over it",
    present,
    keys=lambda study, both: {"geometry": {"thickness": {gel_layers(study)[-1]: {"gradient": both}}}},
    means=("the gel is thicker on one side",),
    signature="softer on one side, harder on the other, in proportion to the distance from the middle; some lateral force",
    separated_by="random order (raster order makes time equal to place); small depths, where tilt alone loses contact",
    turned=as_vector,
    applies=is_block,
)
