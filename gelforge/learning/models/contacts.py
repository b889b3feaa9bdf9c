"""The contacts of a force distribution: which bins press together, with the total and the centre of pressure of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label

NEIGHBOURS = np.ones((3, 3), int)  # bins that share a corner touch


@dataclass(frozen=True)
class Contact:
    """One contact."""

    force_N: np.ndarray  # (3,)
    centre_mm: np.ndarray  # (2,) of its pressing forces


def contacts(force: np.ndarray, nx: int, ny: int, width_mm: np.ndarray) -> list[Contact]:
    """Return the contacts of one distribution (B, 3) [N], the strongest first: connected regions of bins with a force.

    A region counts where its sum presses. Two that touch are one.
    """
    regions, count = label(force.any(axis=1).reshape(ny, nx), NEIGHBOURS)
    found = []
    for number in range(1, count + 1):
        bins = np.flatnonzero(regions.ravel() == number)
        total = force[bins].sum(axis=0)
        if total[2] < 0:
            at = np.column_stack([bins % nx, bins // nx]) + 0.5
            found.append(Contact(total, force[bins, 2] @ at / total[2] * width_mm / [nx, ny]))
    return sorted(found, key=lambda contact: contact.force_N[2])
