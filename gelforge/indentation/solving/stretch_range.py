"""How far the elements of a site are stretched, and whether a law leaves the range in which it was tested."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numba as nb
import numpy as np

from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.stability import drucker_margin

Outside = Callable[
    [np.ndarray], np.ndarray
]  # principal stretches (E, 3) -> whether they leave the tested range (E,)
NOT_KNOWN, INSIDE, LEAVES = -1, 0, 1
# Jacobi's rotations end where the squares off the diagonal are this share of the trace's.
OFF_DIAGONAL, SWEEPS = 1e-31, 12


def element_stretches(
    gradient: np.ndarray, elements: np.ndarray, u: np.ndarray, rest: np.ndarray | None = None
) -> np.ndarray:
    """Return the principal stretches (E, 3), smallest first, of the elements' mean deformation gradient.

    gradient (E, n, 3) is the mean of dN/dX [1/mm] over an element (meshes.elements.mean_gradient), elements (E, n), u (N, 3)
    [mm] the displacement, rest (E, 3, 3) F at u = 0 where it is not 1. The mean over an element and not a Gauss point: at
    the clamped edge and under the contact's edge single points follow the mesh, and not the material.
    """
    return _stretches(gradient, elements, u, np.eye(3)[None] if rest is None else rest)


@nb.njit(cache=True)
def _stretches(gradient, elements, u, rest):
    """Return the roots (E, 3) of the eigenvalues of F^T F, found by Jacobi's rotations."""
    E, A, _ = gradient.shape
    F, C, stretches = np.empty((3, 3)), np.empty((3, 3)), np.empty((E, 3))
    for e in range(E):
        for i in range(3):
            for j in range(3):
                F[i, j] = rest[min(e, len(rest) - 1), i, j]
        for a in range(A):
            for i in range(3):
                for j in range(3):
                    F[i, j] += u[elements[e, a], i] * gradient[e, a, j]
        for i in range(3):
            for j in range(3):
                C[i, j] = F[0, i] * F[0, j] + F[1, i] * F[1, j] + F[2, i] * F[2, j]
        _diagonalise(C)
        for i in range(3):
            stretches[e, i] = np.sqrt(max(C[i, i], 0.0))
        stretches[e].sort()
    return stretches


@nb.njit(cache=True)
def _diagonalise(C):
    """Bring the symmetric C (3, 3) to its eigenvalues, in place."""
    limit = OFF_DIAGONAL * (C[0, 0] + C[1, 1] + C[2, 2]) ** 2
    for _ in range(SWEEPS):
        if C[0, 1] ** 2 + C[0, 2] ** 2 + C[1, 2] ** 2 <= limit:
            return
        for p, q in ((0, 1), (0, 2), (1, 2)):
            if C[p, q] ** 2 <= 0.1 * limit:
                continue
            apart = (C[q, q] - C[p, p]) / (2.0 * C[p, q])
            t = (1.0 if apart >= 0.0 else -1.0) / (abs(apart) + np.sqrt(apart * apart + 1.0))
            c = 1.0 / np.sqrt(t * t + 1.0)
            s, r = t * c, 3 - p - q
            C[p, p] -= t * C[p, q]
            C[q, q] += t * C[p, q]
            C[p, q] = C[q, p] = 0.0
            x, y = C[r, p], C[r, q]
            C[r, p] = C[p, r] = c * x - s * y
            C[r, q] = C[q, r] = s * x + c * y


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
            own = region == r
            extent[d, r] = lam[own].min(), lam[own].max()
            if leaves is not None:
                share[d, r] = (volume[own] * leaves(lam[own])).sum() / volume[own].sum()
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
            own = region == r
            if law is not None:
                bad = ~(drucker_margin(law, lam[own]) > 0)
                share[d, r] = (volume[own] * bad).sum() / volume[own].sum()
    return {"volume_law_unstable": share, "law_unstable": np.any(share > 0, axis=1).astype(np.int8)}
