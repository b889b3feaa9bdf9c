"""The gel stiffens or softens with temperature."""

from gelforge.mismatch.model.solver_effects import circumstance

EFFECT = circumstance(
    "temperature",
    "width: rubber elasticity gives 1/296 per kelvin (entropy), crosslinks that relax more (judgement);"
    " bounds: ten times it",
    "stiffening_per_K",
    "reference_temperature_C",
    "temperature_C",
    means=("the material changes with temperature",),
    signature="all forces of a session in proportion, from session to session with the room's temperature",
    separated_by="the same presses on one day at two temperatures ten kelvin apart",
)
