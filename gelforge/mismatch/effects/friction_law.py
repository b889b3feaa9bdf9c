"""Friction falls with the contact pressure and is not Coulomb's."""

from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, has, solver

EFFECT = Effect(
    name="friction_law",
    family="contact",
    parameters=(
        amount(
            "friction_law", "exponent", (0.0, 0.99),
            "width: 1/3, Hertzian asperities (Schallamach 1952); bounds: 1 would keep the friction stress as pressure grows",
            sign=1,
        ),
    ),
    signature="lateral force off the middle falls behind the normal force at the deepest indentations",
    confused_with=("friction", "frictionless", "law_exponent"),
    separated_by="indentations that shear the surface at several depths",
    applies=lambda study: study.mechanics.friction > 0,
    **solver("friction_law", has("contact.pressure_exponent"), limit=(0.0, 0.99)),
)  # fmt: skip
