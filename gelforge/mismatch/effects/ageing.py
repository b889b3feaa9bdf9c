"""The gel stiffens or softens with its age."""

from gelforge.mismatch.model.solver_effects import circumstance

EFFECT = circumstance(
    "ageing",
    "width: a silicone that goes on curing changes by a per cent a day in its first weeks (judgement);"
    " bounds: ten times that",
    "ageing_per_day",
    "reference_age_days",
    "age_days",
    means=(
        "the material changes with age",
        "the material stiffens with age",
        "the material softens with age",
    ),
    signature="all forces of a session in proportion, from session to session with the sensor's age",
    separated_by="the same indentation in every session, at one temperature, with dead weights on the force sensor"
    " next to it",
)
