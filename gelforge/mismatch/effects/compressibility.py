"""The layers give way in volume: bubbles, or a bulk modulus below that of the study."""

from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, has_none_of, solver

EFFECT = Effect(
    name="compressibility",
    family="material",
    parameters=(
        amount(
            "compressibility", "excess", (0.0, 0.5),
            "width: Poisson's ratio 0.49 in place of nearly 0.5; bounds: 0.5 is Poisson's ratio 0.29, a foam", sign=1,
        ),
    ),
    signature="softer, the more so the wider the contact over the height: at depth and near the wall",
    confused_with=("frame_compliance", "law_exponent", "elastic_base", "base_bending"),
    separated_by="a smaller ball, whose contact is not confined; images, as the surface beside the ball rises less",
    applies=has_none_of("material.bulk_to_shear", "material.poissons_ratio"),
    **solver("compressibility"),
)  # fmt: skip
