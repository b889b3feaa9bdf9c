"""The range of deformation in which a law was tested, and whether a deformation leaves it.

A state of an incompressible isotropic material is its three logarithmic principal stretches, in any order: a point
of a plane, with five mirror images. The range is the convex hull of all tested states and their images. With the
three standard tests driven to the same stretch it is "no principal stretch above the tested one"; with uniaxial
tests alone it is "none below 1 / sqrt(tested one)", so little equibiaxial stretch is in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from gelforge.mechanics.laws.homogeneous import principal_stretches
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.stability import PLANE, drucker_margin

STATES = (13, 40)  # directions from uniaxial to equibiaxial and steps along each, where stability is checked


@dataclass(frozen=True)
class ValidRange:
    """The hull of tested states: extremes (m, 3) stretches, largest first; n . e <= 1 on the plane of ln lam."""

    extremes: np.ndarray
    normals: np.ndarray  # (sides, 2)

    @classmethod
    def of(cls, lam: np.ndarray) -> ValidRange:
        """Return the range of tested states lam (m, 3), whose order does not matter."""
        e = np.sort(_logarithms(lam), axis=-1)[:, ::-1]
        if not (np.abs(e) > 1e-6).any():  # at rest below
            raise ValueError("no tested state is stretched; a range needs one at least")
        images = np.concatenate([e[:, list(order)] for order in permutations(range(3))])
        from scipy.spatial import ConvexHull  # slow to import: jobs that only read a law do without

        hull = ConvexHull(images @ PLANE)
        extremes = np.unique(np.round(np.exp(e[np.unique(hull.vertices % len(e))]), 10), axis=0)
        return cls(extremes, hull.equations[:, :2] / -hull.equations[:, 2:])

    def used(self, lam: np.ndarray) -> np.ndarray:
        """Return how much of the range (...) the stretches lam (..., 3) use: 0 at rest, above 1 outside.

        Volume changes are taken off first. It is the ratio of ln lam to the hull in the same direction.
        """
        e = _logarithms(lam) @ PLANE
        return np.maximum((e @ self.normals.T).max(axis=-1), 0.0)

    def outside(self, lam: np.ndarray) -> np.ndarray:
        """Return whether the stretches lam (..., 3) leave the range; rounding (1e-6 of it) is forgiven."""
        return self.used(lam) > 1 + 1e-6

    def largest(self, case: str) -> float:
        """Return the largest stretch of a load case within the range."""
        return float(np.exp(1 / self.used(principal_stretches(case, np.array(np.e)))))

    def states(self) -> np.ndarray:
        """Return stretches (directions, steps, 3) that fill the range."""
        angle = np.linspace(0, np.pi / 3, STATES[0])
        e = np.column_stack([np.cos(angle), np.sin(angle)]) @ PLANE.T  # uniaxial tension to compression
        e = e / self.used(np.exp(e))[:, None]
        return np.exp(e[:, None, :] * np.linspace(0, 1, STATES[1])[:, None])


def unstable_from(law: PrincipalLaw, valid: ValidRange) -> float | None:
    """Return the share of the range from which on the law is not Drucker-stable in some direction, or None.

    States beyond a limiting stretch count as unstable.
    """
    unstable = ~(drucker_margin(law, valid.states()) > 0)
    return float(np.argmax(unstable.any(axis=0)) / (STATES[1] - 1)) if unstable.any() else None


def _logarithms(lam: np.ndarray) -> np.ndarray:
    e = np.log(np.asarray(lam, dtype=float))
    return e - e.mean(axis=-1, keepdims=True)
