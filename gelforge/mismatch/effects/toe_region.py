"""A soft thin part on top: dust, a film, an uncured skin."""

from gelforge.config import Study
from gelforge.mismatch.effect import Effect
from gelforge.mismatch.solver_effects import amount, is_block, solver


def present(study: Study) -> float:
    """Return the excess compliance that the base study has."""
    return 1 / study.mechanics.effects.geometry.toe.factor - 1


EFFECT = Effect(
    name="toe_region",
    family="contact",
    parameters=(
        amount(
            "toe_region", "excess_compliance", (0.0, 900.0),
            "width: the topmost 0.1 mm ten times as soft as the skin (judgement); bounds: a thousandth of its stiffness",
            sign=1,
        ),
    ),
    signature="as if touched later, by a depth that soon stays the same: the more of the force the smaller the depth",
    confused_with=("contact_zero", "skin_stiffness"),
    separated_by="many small depths below 0.3 mm, before and after the surface is cleaned",
    applies=is_block,
    **solver("toe_region", present, limit=(0.0, 900.0)),
)  # fmt: skip
