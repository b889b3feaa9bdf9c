"""Tracer particles have sunk before the gel had cured: its bottom is stiffer, its top softer."""

from gelforge.mismatch.model.solver_effects import has, is_block, solved

EFFECT = solved(
    "particle_settling",
    "sunk_share",
    (-1.0, 1.0),
    "width and bounds: half to all of the particles' concentration shifted (the sign is that of their density less"
    " the gel's)",
    closed=True,
    present=has("material.particles.settling"),
    means=("the particles have settled in the gel",),
    signature="a little softer at small depth, harder at large depth",
    separated_by="images: particles by depth in the gel; a slice of a spare gel",
    applies=lambda study: (
        is_block(study) and any(layer.particle_volume_fraction > 0 for layer in study.sensor.layers)
    ),
)
