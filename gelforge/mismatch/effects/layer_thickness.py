"""The layer under the skin is thicker or thinner than drawn, all over."""

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import gel_layers
from gelforge.mismatch.model.solver_effects import is_block, solved


def present(study: Study) -> float:
    """Return the change of thickness [mm] that the base study has."""
    thickness = study.mechanics.effects.geometry.thickness.get(gel_layers(study)[-1])
    return thickness.change_mm if thickness else 0.0


EFFECT = solved(
    "layer_thickness",
    "change",
    (-1.5, 1.5),
    "width: a gel poured by weight, its meniscus included (judgement); bounds: a third of a usual layer",
    present=present,
    means=(
        "the gel's thickness differs",
        "the gel is {size} thicker than assumed",
        "the gel is {size} thinner than assumed",
    ),
    signature="softer if thicker, nearly in proportion, more at depth and less near the wall",
    separated_by="a calliper, or the depth at which a thin pin meets the base; a second ball of another radius",
    applies=is_block,
)
