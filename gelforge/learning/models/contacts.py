"""The contacts of a force distribution: which bins press together, with the total and the centre of pressure of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, find_objects, label, maximum_filter

# Two contacts are apart where bins between them press with less than this share of the weaker one's largest bin. Flat
# punches and edges press more at their rims than in their middle, in bins of 1.6 mm at most 2.5 times as much. Hills with a
# valley of a quarter are two, the same on a plateau one (tests/learning/test_contacts.py).
VALLEY = 0.35
LEVELS = VALLEY * np.linspace(0.1, 1.0, 10)  # of the largest bin, at which a region may fall apart


@dataclass(frozen=True)
class Contact:
    """One contact."""

    force_N: np.ndarray  # (3,)
    centre_mm: np.ndarray  # (2,) of its pressing forces


def contacts(force: np.ndarray, nx: int, ny: int, width_mm: np.ndarray) -> list[Contact]:
    """Return the contacts of one force distribution, the strongest first.

    A contact is a connected region of bins with a force, or a part of it that bins with little pressure divide from
    another; bins between go to the nearest. It counts where its sum presses.

    Parameters
    ----------
    force : numpy.ndarray
        (B, 3) [N], bin k = nx iy + ix.
    nx, ny : int
        Bins along x and y.
    width_mm : numpy.ndarray
        (2,) of the rectangle of the bins.

    Returns
    -------
    list of Contact
        Force (3,) [N] and centre (2,) [mm] of each.
    """
    field = force.reshape(ny, nx, 3)
    _, regions = _connected((field != 0).any(axis=2))
    touching = []
    for number, box in enumerate(find_objects(regions), 1):
        pressing = np.maximum(-field[box][..., 2], 0)
        for part in _parts(pressing, regions[box] == number):
            rows, columns = np.nonzero(part)
            forces = field[box][rows, columns]
            total = forces.sum(axis=0)
            if total[2] < 0:
                at = np.column_stack([columns + box[1].start, rows + box[0].start]) + 0.5
                touching.append(Contact(total, forces[:, 2] @ at / total[2] * width_mm / [nx, ny]))
    return sorted(touching, key=lambda contact: contact.force_N[2])


def _parts(pressing: np.ndarray, region: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the parts (ny, nx) into which a region (ny, nx) of bins falls."""
    # every piece above a level has a local maximum of its own, so one maximum is one contact
    if np.count_nonzero(region & (pressing == maximum_filter(pressing, 3))) == 1:
        yield region
        return
    largest = pressing[region].max()
    for level in largest * LEVELS:
        count, pieces = _connected(region & (pressing > level))
        tops = np.zeros(count)
        np.maximum.at(tops, pieces, np.where(pieces > 0, pressing, 0.0))
        cores = np.flatnonzero(VALLEY * tops >= level)
        if len(cores) > 1:
            away = ~np.isin(pieces, cores)
            nearest = distance_transform_edt(away, return_distances=False, return_indices=True)
            owner = pieces[tuple(nearest)]
            for number in cores:
                yield from _parts(pressing, region & (owner == number))
            return
    yield region


def _connected(bins: np.ndarray) -> tuple[int, np.ndarray]:
    """Return how many connected regions bins (ny, nx) form, counting 0, and their numbers (ny, nx); corners touch."""
    numbers, count = label(bins, structure=np.ones((3, 3)))
    return count + 1, numbers
