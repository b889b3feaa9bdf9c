"""The layers give way in volume: bubbles, or a bulk modulus below that of the study."""

from gelforge.mismatch.model.solver_effects import has_none_of, solved

EFFECT = solved(
    "compressibility",
    "excess",
    (0.0, 0.5),
    "width: Poisson's ratio 0.49 in place of nearly 0.5; bounds: 0.5 is Poisson's ratio 0.29, a foam",
    means=("the gel is more compressible than simulated",),
    signature="softer, the more so the wider the contact over the height: at depth and near the wall",
    separated_by="a smaller ball, whose contact is not confined; images, as the surface next to the ball rises less",
    applies=has_none_of("material.bulk_to_shear", "material.poissons_ratio"),
)
