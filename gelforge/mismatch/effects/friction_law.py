"""Friction falls with the contact pressure and is not Coulomb's."""

from gelforge.mismatch.model.solver_effects import has, solved

EFFECT = solved(
    "friction_law",
    "exponent",
    (0.0, 0.99),
    "width: 1/3, Hertzian asperities (Schallamach 1952); bounds: 1 would keep the friction stress as pressure grows",
    present=has("contact.pressure_exponent"),
    means=("friction depends on the contact pressure",),
    signature="lateral force off the middle falls behind the normal force at the deepest indentations",
    separated_by="indentations that shear the surface at several depths",
    applies=lambda study: study.mechanics.friction > 0,
)
