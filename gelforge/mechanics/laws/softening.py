r"""Softening below the largest energy density that a point has seen (Ogden & Roxburgh 1999, doi 10.1098/rspa.1999.0431)."""

from __future__ import annotations

import numpy as np
from scipy.special import erf


def lost_share(energy, peak, m: float | np.ndarray, beta: float | np.ndarray):
    r"""Return erf((peak - W) / (m + beta peak)): the stress is 1 - amount times this of what it was.

    Parameters
    ----------
    energy, peak : float or array
        Energy density W and the largest one so far [MPa]; beyond it nothing is lost.
    m : float or array
        Energy density that scales the softening [MPa].
    beta : float or array
        Growth of that scale with the largest energy density [-].
    """
    return erf(np.maximum(peak - energy, 0) / (m + beta * peak))
