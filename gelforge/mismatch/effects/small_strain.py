"""Deformation is taken as small where it is not.

A base of small strain gets finite strain with neo-Hookean laws of its moduli, which add no other nonlinearity
(`linear_elasticity` adds the fitted laws). A base of finite strain has nothing to be put right: no gel strains little.
"""

from gelforge.mismatch.effects.linear_elasticity import changes
from gelforge.mismatch.model.solver_effects import simplification

EFFECT = simplification(
    "small_strain",
    lambda mechanics, hyperparameters: changes(mechanics, linear_law=True),
    means=("strains are large and simulated as small",),
    signature="nothing at small depth, growing with depth, most at the deepest indentations and near the wall",
    separated_by="the nominal model solved with and without finite strain; a ball of another radius at the same"
    " depth over height",
    applies=lambda study: study.mechanics.strain == "small",
)
