"""A quantity over the sensor's face and depth, from its values at a few distances from the middle and a few depths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline, NdPPoly, PchipInterpolator


@dataclass(frozen=True)
class Surface:
    """Cubics from node to node, monotone where the nodes are, and a polynomial over depth.

    Where the ball's contact reaches the wall slopes change within half a millimetre: a polynomial through all nodes, or
    slopes of parabolas, would swing next to it.
    """

    face: NdPPoly  # (D,) values at the depths, over x and y
    fit: np.ndarray  # (degree + 1, D) from values at the depths to the polynomial's coefficients

    @classmethod
    def through(
        cls, nodes: np.ndarray, depths: np.ndarray, values: np.ndarray, degree: int, sign: int = 1
    ) -> Surface:
        """Return the surface through values (N, N, D) at |x|, |y| in nodes (N,), the first 0, and depths (D,) [mm].

        Over depth the polynomial is the nearest of its degree. sign: 1 if it is even in x, -1 if odd; in y it is even.
        """
        powers = np.vander(depths, degree + 1, increasing=True)
        fit = np.linalg.pinv(powers)
        smooth = values @ (powers @ fit).T
        right = np.concatenate([sign * smooth[:0:-1], smooth])
        whole = np.concatenate([right[:, :0:-1], right], axis=1)
        return cls(_cubics(np.concatenate([-nodes[:0:-1], nodes]), whole), fit)

    def at(self, x: np.ndarray, y: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Return the quantity (R,) at places and depths [mm]; beyond the outermost nodes the last cubics go on."""
        over_depth = np.vander(depth, len(self.fit), increasing=True) @ self.fit
        return np.einsum("rd,rd->r", self.face(np.column_stack([x, y])), over_depth)


def _cubics(nodes: np.ndarray, values: np.ndarray) -> NdPPoly:
    """Return the bicubics through values (M, M, D) at nodes (M,) along both axes, with the slopes of monotone cubics."""
    along_x, along_y = (_slopes(nodes, values, axis) for axis in (0, 1))
    # slopes of slopes depend on which axis comes first: the mean of both keeps what is alike in x and y alike
    along_both = (_slopes(nodes, along_x, 1) + _slopes(nodes, along_y, 0)) / 2
    of_values = CubicHermiteSpline(nodes, values, along_x, axis=0).c  # (4, M - 1, M, D)
    of_slopes = CubicHermiteSpline(nodes, along_y, along_both, axis=0).c
    both = CubicHermiteSpline(nodes, of_values, of_slopes, axis=2).c  # (4, M - 1, 4, M - 1, D), y before x
    return NdPPoly(both.transpose(2, 0, 3, 1, 4), (nodes, nodes))


def _slopes(nodes: np.ndarray, values: np.ndarray, axis: int) -> np.ndarray:
    """Return the slopes at nodes along an axis of Fritsch and Carlson's monotone cubics."""
    return PchipInterpolator(nodes, values, axis=axis).derivative()(nodes)
