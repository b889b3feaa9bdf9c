"""How far the elements of a site are stretched, and whether a law leaves the range in which it was tested."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.stability import drucker_margin

# principal stretches (E, 3) -> whether they leave the tested range (E,)
Outside = Callable[[np.ndarray], np.ndarray]
# Values of `leaves_valid_range` (docs/file-formats.md).
NOT_KNOWN, INSIDE, LEAVES = -1, 0, 1


def element_stretches(
    gradient: np.ndarray, elements: np.ndarray, u: np.ndarray, rest: np.ndarray | None = None
) -> np.ndarray:
    """Return the principal stretches (E, 3), smallest first, of the elements' mean deformation gradient.

    gradient (E, n, 3) is the mean of dN/dX [1/mm] over an element (meshes.elements.mean_gradient), elements (E, n), u (N, 3)
    [mm] the displacement, rest (E, 3, 3) F at u = 0 where it is not 1. The mean over an element and not a Gauss point: at
    the clamped edge and under the contact's edge single points follow the mesh, and not the material.
    """
    F = np.einsum("eai,eaj->eij", u[elements], gradient) + (np.eye(3) if rest is None else rest)
    return np.sqrt(np.maximum(np.linalg.eigvalsh(np.swapaxes(F, 1, 2) @ F), 0.0))


def stretch_ranges(
    stretches: Sequence[np.ndarray], volume: np.ndarray, region: np.ndarray, outside: Sequence[Outside | None]
) -> dict[str, np.ndarray]:
    """Return the attributes of a site about its stretches.

    stretches: (E, 3) per depth; volume (E,) [mm^3]; region (E,) numbers; outside: the test of each region's law, None
    where nothing is known of its range. `stretch_range` (D, R, 2) is the smallest and largest principal stretch of a
    region; `volume_outside_valid_range` (D, R) the share of its volume that leaves the tested range, NaN where that is
    not known; `leaves_valid_range` (D,) is 1 where any region leaves it, 0 where all are inside, -1 where it is not known.
    """
    D, R = len(stretches), len(outside)
    extent, share = np.ones((D, R, 2)), np.full((D, R), np.nan)
    for d, lam in enumerate(stretches):
        for r, leaves in enumerate(outside):
            inside = region == r
            extent[d, r] = lam[inside].min(), lam[inside].max()
            if leaves is not None:
                share[d, r] = (volume[inside] * leaves(lam[inside])).sum() / volume[inside].sum()
    verdict = np.where(np.isnan(share).any(axis=1), NOT_KNOWN, INSIDE)
    verdict[(share > 0).any(axis=1)] = LEAVES  # one region outside is enough, whatever is not known of others
    return {
        "stretch_range": extent,
        "volume_outside_valid_range": share,
        "leaves_valid_range": verdict.astype(np.int8),
    }


def unstable_shares(
    stretches: Sequence[np.ndarray],
    volume: np.ndarray,
    region: np.ndarray,
    laws: Sequence[PrincipalLaw | None],
) -> dict[str, np.ndarray]:
    """Return the attributes of a site about the stability of its laws at the stretches that were really reached.

    Arguments as in stretch_ranges; laws: of each region, None where stretches do not matter. `volume_law_unstable` (D, R) is
    the share of a region's volume in which its law is not Drucker-stable; `law_unstable` (D,) is 1 where any is, else 0.
    What was checked before solving is an estimate (effects.material.stretches_ahead): this is what came of it.
    """
    share = np.zeros((len(stretches), len(laws)))
    for d, lam in enumerate(stretches):
        for r, law in enumerate(laws):
            inside = region == r
            if law is not None:
                bad = ~(drucker_margin(law, lam[inside]) > 0)
                share[d, r] = (volume[inside] * bad).sum() / volume[inside].sum()
    return {"volume_law_unstable": share, "law_unstable": np.any(share > 0, axis=1).astype(np.int8)}
