"""Error bars of the nominal forces: discretisation, by axis and place."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gelforge.config import Study
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.error_bars import layer_totals
from gelforge.indentation.solving.resolution import Resolution, resolution_of
from gelforge.mechanics.laws.law import PrincipalLaw

# Of the difference to the mesh of twice the sizes, root mean square over depths; with the parts below. On default meshes Fz
# then errs by 0.2 to 1.4 bars (docs/results/stiff-layers.md). Labels take 0.05; another code differs by more
# (python -m validation.checks.between_codes): judgement.
PART = 0.2
# Of the vertical difference, on sideways forces: near a wall they lean on it. Twice what labels have, whose share of walls
# is left out here (judgement; docs/results/stiff-layers.md).
CROSS = 0.04
# Of a sideways force itself, which errs by wall and skin: errors are then at most 2.0 bars in the root mean square on every
# sensor and mesh of docs/results/stiff-layers.md.
SIDEWAYS = 0.05


def known_resolution(study: Study, laws: Mapping[str, PrincipalLaw], way: PlannedCell) -> Resolution | None:
    """Return how finely the mesh resolves layers and walls at a site; None where the study states its error on all axes."""
    if study.mismatch.discretisation is not None:
        return None
    return resolution_of(study.sensor, study.mechanics.mesh, laws, way.x_mm, way.y_mm)


def base_bars(total: np.ndarray, coarse: np.ndarray, resolution: Resolution | None) -> np.ndarray:
    """Return the error bars of the forces of a loading.

    Where the indenter has all but left the gel there is nothing to be a share of: the difference itself is given.

    Parameters
    ----------
    total : numpy.ndarray
        (D, 3) [N].
    coarse : numpy.ndarray
        (D, 3) [N], on the mesh of twice the sizes.
    resolution : Resolution or None
        Of the site: Fz has the parts of layers and walls that it has in the error bars of labels, sideways forces a share
        of themselves. None: both are left out.

    Returns
    -------
    numpy.ndarray
        (D, 3) [N], one standard deviation.
    """
    size = np.linalg.norm(total, axis=1, keepdims=True)
    difference = total - coarse
    carries = (size > 1e-3 * size.max()).ravel()  # below, the indenter is about to leave
    x, y, z = ((difference[carries] / size[carries]) ** 2).sum(axis=0) / max(carries.sum(), 1)
    horizontal = np.sqrt(PART**2 * (x + y) / 2 + CROSS**2 * z)
    sigma = np.array([horizontal, horizontal, PART * np.sqrt(z)]) * size
    if resolution is not None:
        sigma[:, :2] = np.hypot(sigma[:, :2], SIDEWAYS * np.abs(total[:, :2]))
        sigma[:, 2] = np.hypot(sigma[:, 2], layer_totals(total, resolution)[:, 2])
    return np.where(carries[:, None], sigma, np.maximum(sigma, PART * np.abs(difference)))
