"""Tracer particles have sunk before the gel had cured: its bottom is stiffer, its top softer."""

from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, has, is_block, solver

EFFECT = Effect(
    name="particle_settling",
    family="geometry",
    parameters=(
        amount(
            "particle_settling", "sunk_share", (-1.0, 1.0),
            "width and bounds: half to all of the particles' concentration shifted (the sign is that of their density less"
            " the gel's)", whole=True,
        ),
    ),
    signature="a little softer at small depth, harder at large depth",
    confused_with=("law_exponent", "gel_stiffness", "layer_thickness"),
    separated_by="images: particles by depth in the gel; a slice of a spare gel",
    applies=lambda study: (
        is_block(study) and any(layer.particle_volume_fraction > 0 for layer in study.sensor.layers)
    ),
    **solver("particle_settling", has("material.particles.settling"), limit=(-1.0, 1.0)),
)  # fmt: skip
