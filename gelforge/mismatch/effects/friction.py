"""The coefficient of friction is another one than the study's."""

from gelforge.mismatch.model.solver_effects import solved

EFFECT = solved(
    "friction",
    "excess",
    (-1.0, 1.5),
    "width: coefficients of silicone on steel or plastic, dusted or clean, run from 0.2 to above 1 (judgement);"
    " bounds: mechanics.friction itself lies within 0 and 2",
    means=("friction differs", "friction is higher than simulated", "friction is lower than simulated"),
    signature="lateral force off the middle; a little more force at depth; saturates where everything sticks",
    separated_by="an indentation that shears the surface once it touches, or a lubricated ball",
    applies=lambda study: study.mechanics.friction > 0,  # a base without any: frictionless
)
