"""Error bars of the nominal forces: discretisation, by axis and place."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gelforge.config import Study
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.error_bars import CROSS_TOTALS, layer_totals
from gelforge.indentation.solving.resolution import Resolution, resolution_of
from gelforge.mechanics.laws.law import PrincipalLaw

# Of the difference to the mesh of twice the sizes, root mean square over depths. Labels take 0.05 (error_bars.py), which
# meshes of half the sizes ask for; FElupe's forces, which share no elements with ours, differ by more
# (tests/mismatch/test_base_bars.py, `python benchmarks/stiff_layers.py --nominal`).
PART = 0.2


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
        Of the site, for the parts that layers and walls have in the error bars of labels. None: there are none.

    Returns
    -------
    numpy.ndarray
        (D, 3) [N], one standard deviation.
    """
    size = np.linalg.norm(total, axis=1, keepdims=True)
    difference = total - coarse
    carries = (size > 1e-3 * size.max()).ravel()  # below, the indenter is about to leave
    x, y, z = ((difference[carries] / size[carries]) ** 2).sum(axis=0) / max(carries.sum(), 1)
    horizontal = np.sqrt(PART**2 * (x + y) / 2 + CROSS_TOTALS**2 * z)
    sigma = np.array([horizontal, horizontal, PART * np.sqrt(z)]) * size
    if resolution is not None:
        sigma = np.hypot(sigma, layer_totals(total, resolution))
    return np.where(carries[:, None], sigma, np.maximum(sigma, PART * np.abs(difference)))
