"""A quantity over the sensor's face and depth, from its values at a few distances from the middle and a few depths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator


@dataclass(frozen=True)
class Surface:
    """Cubics from node to node, monotone where the nodes are, and a polynomial over depth.

    Where the ball's contact reaches the wall slopes change within half a millimetre: a polynomial through all nodes, or
    slopes of parabolas, would swing beside it.
    """

    nodes: np.ndarray  # (M,) mirrored about 0 [mm]
    table: np.ndarray  # (2 M, 2 M, D) values at the nodes and slopes along x; the same along y
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
        mirrored = np.concatenate([-nodes[:0:-1], nodes])
        # slopes of slopes depend on which axis comes first: the mean of both keeps what is alike in x and y alike
        orders = (_with_slopes(mirrored, _with_slopes(mirrored, whole, a), 1 - a) for a in (0, 1))
        return cls(mirrored, sum(orders) / 2, fit)

    def at(self, x: np.ndarray, y: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Return the quantity (R,) at places and depths [mm]; beyond the outermost nodes the last cubics go on."""
        over_depth = np.vander(depth, len(self.fit), increasing=True) @ self.fit
        weights = self._weights(x), self._weights(y)
        return np.einsum("ri,rj,ijd,rd->r", *weights, self.table, over_depth, optimize=True)

    def _weights(self, at: np.ndarray) -> np.ndarray:
        """Return the weights (R, 2 M) of values and slopes at the nodes."""
        ones, zeros = np.eye(len(self.nodes)), np.zeros((len(self.nodes),) * 2)
        of_values = CubicHermiteSpline(self.nodes, ones, zeros)(at)
        return np.hstack([of_values, CubicHermiteSpline(self.nodes, zeros, ones)(at)])


def _with_slopes(nodes: np.ndarray, values: np.ndarray, axis: int) -> np.ndarray:
    """Return values at nodes along an axis, and after them the slopes there of Fritsch and Carlson's monotone cubics."""
    slopes = PchipInterpolator(nodes, values, axis=axis).derivative()(nodes)
    return np.concatenate([values, slopes], axis=axis)
