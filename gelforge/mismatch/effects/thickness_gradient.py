"""The layer under the skin grows thicker to one side: it was poured on a slope."""

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import gel_layers
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, as_vector, first_order, is_block, pair_of, solver


def present(study: Study) -> list[float]:
    """Return the gradient [mm/mm] that the base study has."""
    thickness = study.mechanics.effects.geometry.thickness.get(gel_layers(study)[-1])
    return thickness.gradient if thickness else [0.0, 0.0]


SOURCE = "width: 0.6 mm over a sensor of 30 mm (judgement); bounds: 3 mm over it"

EFFECT = Effect(
    name="thickness_gradient",
    family="geometry",
    parameters=tuple(amount("thickness_gradient", along, (-0.1, 0.1), SOURCE) for along in ("x", "y")),
    signature="softer on one side, harder on the other, in proportion to the distance from the middle; some lateral force",
    confused_with=("tilt", "ageing", "force_drift", "misregistration", "layer_thickness"),
    separated_by="random order (raster order makes time equal to place); small depths, where tilt alone loses contact",
    applies=is_block,
    **solver("thickness_gradient")
    | {
        "to_study": pair_of(
            "geometry",
            present,
            lambda study, both: {"thickness": {gel_layers(study)[-1]: {"gradient": both}}},
        ),
        "to_forces": first_order("thickness_gradient", "x", "y"),
        "turned": as_vector,
    },
)
