"""A data-entry error: the readings are not in newtons."""

from gelforge.mismatch.model.solver_effects import data_entry_error

# What is read of one newton: the kgf of 1901, the lbf of 1959; thousands are refused when a recording is read.
READ = {
    "kgf": 1 / 9.80665,
    "lbf": 1 / 4.4482216,
    "N, multiplied by 9.81": 9.80665,
    "N, multiplied by 4.45": 4.4482216,
}

EFFECT = data_entry_error(
    "force_unit",
    "unit",
    [*READ],
    "kgf",
    lambda force, unit: READ[unit] * force,
    means=("forces are recorded in another unit than assumed",),
    signature="all forces in proportion, by a factor between two units; images clean",
    separated_by="one known weight on the force sensor",
)
