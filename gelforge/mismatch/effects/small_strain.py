"""Deformation is taken as small where it is not.

A base of small strain gets finite strain with neo-Hookean laws of its moduli, which add no other nonlinearity
(`linear_elasticity` adds the fitted laws). A base of finite strain has nothing to be put right: no gel strains little.
"""

from gelforge.config import Mechanics, Study
from gelforge.indentation.effects.catalogue import CATALOGUE
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import ON, amount, first_order, inverted


def changes(mechanics: Mechanics) -> dict:
    """Return the keys of mechanics that bring finite strain."""
    return {
        "strain": "finite",
        "contact_normals": "current",
        "effects": {"material": {"linear_law": True}},
    }


def applies(study: Study) -> bool:
    """Whether the base takes deformation as small."""
    return study.mechanics.strain == "small"


EFFECT = Effect(
    name="small_strain",
    family="simplification",
    parameters=(amount("small_strain", "on", ON, "on or off: a choice of the study, no quantity", sign=1),),
    enters=CATALOGUE["small_strain"].enters,
    signature="nothing at small depth, growing with depth, most at the deepest indentations and near the wall",
    confused_with=("linear_elasticity", "law_exponent", "frame_compliance", "compressibility"),
    separated_by="the nominal model solved with and without finite strain; a ball of another radius at the same"
    " depth over height",
    to_study=inverted(changes),
    to_forces=first_order("small_strain"),
    applies=applies,
    binary=True,
)
