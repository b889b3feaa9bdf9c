"""The gel is stiffer or softer than its law: batch, cure, tracer particles."""

from gelforge.mismatch.model.solver_effects import solved

EFFECT = solved(
    "gel_stiffness",
    "growth",
    (-0.8, 4.0),
    "width: scatter of soft silicones by batch, mixing ratio and cure (judgement); particles of 2 % by volume add"
    " 5 % (Eshelby 1957, 1 / (1 - 5 phi / 2)); bounds: still a gel",
    means=(
        "the gel differs in stiffness",
        "the gel is {share} stiffer than simulated",
        "the gel is {share} softer than simulated",
    ),
    signature="force in proportion at every place and depth, less near the wall; the more so the thinner the skin",
    separated_by="dead weights on the force sensor; a material test of the batch; images, whose flow no gain changes",
)
