"""A data-entry error: the readings are not in newtons."""

from __future__ import annotations

from gelforge.mismatch.model.data_entry import data_entry_error
from gelforge.mismatch.model.effect import Effect

# What is read of one newton; thousands are refused when a recording is read.
READ = {
    "kgf": 1 / 9.80665,
    "lbf": 1 / 4.4482216,
    "N, multiplied by 9.81": 9.80665,
    "N, multiplied by 4.45": 4.4482216,
}

EFFECT = Effect(
    name="force_unit",
    enters="force readings: a unit other than the newtons that their columns state",
    signature="all forces in proportion, by a factor between two units; images clean",
    confused_with=("force_gain", "body_stiffness"),
    separated_by="one known weight on the force sensor",
    **data_entry_error("unit", READ, "kgf", lambda force, unit: READ[unit] * force),
)
