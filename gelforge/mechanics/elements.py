"""The 8-node hexahedron: shape functions, quadrature, gradients on any (also distorted) mesh."""

from __future__ import annotations

import numpy as np

# Corners in natural coordinates, in the order of meshio's "hexahedron": bottom face, then top face.
HEX8_CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],
    dtype=float,
)
HEX8_GAUSS = HEX8_CORNERS / np.sqrt(3.0)  # 2 x 2 x 2 points, weight 1 each


def hex8_shape(xi: np.ndarray) -> np.ndarray:
    """Return the shape functions N (..., 8) at natural coordinates xi (..., 3)."""
    return np.prod(1 + HEX8_CORNERS * xi[..., None, :], axis=-1) / 8


def hex8_natural_gradient(xi: np.ndarray) -> np.ndarray:
    """Return dN/dxi (..., 8, 3) at natural coordinates xi (..., 3)."""
    factor = 1 + HEX8_CORNERS * xi[..., None, :]
    others = np.stack(
        [factor[..., 1] * factor[..., 2], factor[..., 0] * factor[..., 2], factor[..., 0] * factor[..., 1]],
        -1,
    )
    return HEX8_CORNERS * others / 8


def hex8_gradient(X: np.ndarray, hexahedra: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return dN/dX (E, 8 Gauss points, 8 nodes, 3) [1/mm] and the weights (E, 8) [mm^3] of the undeformed mesh.

    X (N, 3) are the nodes [mm], hexahedra (E, 8) their numbers. Raises ValueError for an inverted element.
    """
    dN = hex8_natural_gradient(HEX8_GAUSS)  # (8 points, 8 nodes, 3)
    jacobian = np.einsum("enx,gnk->egxk", X[hexahedra], dN)  # dX_x / dxi_k
    weight = np.linalg.det(jacobian)
    if not weight.min() > 0:
        worst = int(np.argmin(weight.min(axis=1)))
        raise ValueError(
            f"element {worst} has volume factor {weight.min():.3g} mm^3 at a Gauss point; untangle the mesh"
        )
    gradient = np.einsum("gnk,egkx->egnx", dN, np.linalg.inv(jacobian))
    return np.ascontiguousarray(gradient), weight
