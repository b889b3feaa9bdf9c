"""A data-entry error: the lateral axes of the force sensor, or of the stage, are not those that the session states."""

import numpy as np

from gelforge.mismatch.model.solver_effects import data_entry_error

# What was read as (Fx, Fy), of the force (Fx, Fy) on the sensor: all other ways to lay a square on itself.
READ = {
    "turned by 90 deg": ((0, -1), (1, 0)),
    "turned by 180 deg": ((-1, 0), (0, -1)),
    "turned by 270 deg": ((0, 1), (-1, 0)),
    "x reversed": ((-1, 0), (0, 1)),
    "y reversed": ((1, 0), (0, -1)),
    "x and y swapped": ((0, 1), (1, 0)),
    "x and y swapped and reversed": ((0, -1), (-1, 0)),
}

EFFECT = data_entry_error(
    "force_frame",
    "axes",
    [*READ],
    "x and y swapped",
    lambda force, axes: np.column_stack([force[:, :2] @ np.array(READ[axes], float).T, force[:, 2]]),
    means=("forces are recorded in another frame than assumed",),
    signature="lateral forces as large as they should be, along other axes; vertical forces clean",
    separated_by="a look at how the force sensor is mounted; one indentation next to each wall, which pushes the"
    " ball away from it",
)
