"""The stage's scale is off: it goes deeper than it says, in proportion to the depth."""

from gelforge.mismatch.model.effect import Effect, Parameter
from gelforge.mismatch.model.solver_effects import per_depth


def to_forces(context, hyperparameters, force, theta):
    """Return the forces (R, 3) [N] at the depths that were really reached, to first order."""
    (growth,) = theta
    depth = context.observations.table["depth_mm"].to_numpy(float)
    return force + growth * depth[:, None] * per_depth(context)


EFFECT = Effect(
    name="depth_scale",
    family="kinematics",
    parameters=(Parameter("growth", "1", 0.01, (-0.1, 0.1), "width: an uncalibrated screw (judgement)"),),
    means=("the stage's scale is off",),
    signature="force times slope and depth: small at small depth, alike everywhere",
    separated_by="a dial gauge on the indenter's carriage",
    to_forces=to_forces,
)
