"""Unloading from the depths of a loading: each path begins at the state that the loading has reached there."""

from __future__ import annotations

import numpy as np

from gelforge.indentation.solving.simulate import Solution
from gelforge.mechanics.solving.yielding import follow_yielding


def unloaded(solution: Solution, peak: int, poses: np.ndarray) -> np.ndarray:
    """Return the forces of an unloading from a pose of a solved loading, through earlier poses.

    They are those of one path through the loading to its peak and back. The body must not remember.

    Parameters
    ----------
    solution : Solution
        Of the loading.
    peak : int
        Number of the pose at which the unloading begins.
    poses : numpy.ndarray
        (n,) int, numbers of earlier poses in their order.

    Returns
    -------
    numpy.ndarray
        (n, 3), total force on the sensor [N].

    Raises
    ------
    NotConverged
        Where a step finds no equilibrium.
    """
    model, reached = solution.model, solution.followed.states[peak]
    way = model.centres[poses]
    states = follow_yielding(solution.press, reached, way, model.yielding, begun=model.centres[peak])
    return np.array([state.force for state in states]).reshape(-1, 3)
