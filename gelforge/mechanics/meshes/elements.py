"""The elements: 8-node hexahedron and 10-node tetrahedron with shape functions, quadrature and gradients on any mesh.

Nodes are numbered as meshio does. The tetrahedron has the 4-point rule of degree 2: with straight edges grad N is linear,
so the stiffness of the undeformed state and the balance of a uniform stress are integrated exactly; where an edge's middle
lies off the edge by s, that balance errs by (s/h)^2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numba as nb
import numpy as np

# Corners in natural coordinates, in the order of meshio's "hexahedron": bottom face, then top face.
HEX8_CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],
    dtype=float,
)
HEX8_GAUSS = HEX8_CORNERS / np.sqrt(3.0)  # 2 x 2 x 2 points, weight 1 each

# Corners 0 to 3 of meshio's "tetra10", then the middles of these edges.
TET10_EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
_TET4_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
# Faces seen from outside: three corners, then the middles of (0, 1), (1, 2), (2, 0), as meshio's "triangle6".
TET10_FACES = np.array([[0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6]])
TET10_NODES = np.concatenate([_TET4_CORNERS, _TET4_CORNERS[TET10_EDGES].mean(axis=1)])
# 4 points of degree 2, weight 1/24 each (Hammer, Marlowe & Stroud 1956, doi 10.1090/S0025-5718-1956-0086389-6).
TET10_GAUSS = (5 - np.sqrt(5.0)) / 20 + _TET4_CORNERS / np.sqrt(5.0)
# A 6-node face as four triangles of its corners 0 to 2 and the middles 3 to 5 of (0, 1), (1, 2), (2, 0).
TRIANGLE6_PARTS = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])

# A quadratic displacement can change the volume of points while the element keeps its mean (conformal maps do so without any
# shear), so with one pressure per element alone errors are of the size (jump of pressure between elements)/mu, and once the
# jump exceeds about 2 mu the tangent loses its definiteness. A small part of the bulk modulus at the points holds these
# modes. Measured rms error of the gradient at K/mu = 1e6, pressure of amplitude mu, 1296 tetrahedra, for 0, 3, 10, 30, 100,
# 1000 mu: .041 .015 .0076 .0048 .0042 .0054 (12^3 hexahedra, as many nodes: .023). Force on a ball in coarse elements over a
# thin layer, at a quarter and at full depth: -12, -6 % for 0; +1, -2 % for 3; +7, -1 % for 10; +14, +2 % for 100. 10 serves
# both.
LOCAL_BULK_TO_SHEAR = 10.0


def hex8_shape(xi: np.ndarray) -> np.ndarray:
    """Return the shape functions N (..., 8) at natural coordinates xi (..., 3)."""
    return np.prod(1 + HEX8_CORNERS * xi[..., None, :], axis=-1) / 8


def hex8_natural_gradient(xi: np.ndarray) -> np.ndarray:
    """Return dN/dxi (..., 8, 3) at natural coordinates xi (..., 3)."""
    x, y, z = np.moveaxis(1 + HEX8_CORNERS * xi[..., None, :], -1, 0)
    others = np.stack([y * z, x * z, x * y], -1)
    return HEX8_CORNERS * others / 8


def tet10_shape(xi: np.ndarray) -> np.ndarray:
    """Return the shape functions N (..., 10) at natural coordinates xi (..., 3) = volume coordinates 1 to 3."""
    L = np.concatenate([1 - xi.sum(axis=-1, keepdims=True), xi], axis=-1)
    a, b = TET10_EDGES.T
    return np.concatenate([L * (2 * L - 1), 4 * L[..., a] * L[..., b]], axis=-1)


def tet10_natural_gradient(xi: np.ndarray) -> np.ndarray:
    """Return dN/dxi (..., 10, 3) at natural coordinates xi (..., 3)."""
    L = np.concatenate([1 - xi.sum(axis=-1, keepdims=True), xi], axis=-1)[..., None]
    dL = np.concatenate([-np.ones((1, 3)), np.eye(3)])  # (4 coordinates, 3)
    a, b = TET10_EDGES.T
    return np.concatenate([(4 * L - 1) * dL, 4 * (L[..., a, :] * dL[b] + L[..., b, :] * dL[a])], axis=-2)


@dataclass(frozen=True)
class Element:
    """A kind of element: A nodes, Q quadrature points."""

    name: str  # meshio's name of the cell type
    nodes: np.ndarray  # (A, 3) natural coordinates
    points: np.ndarray  # (Q, 3)
    weights: np.ndarray  # (Q,)
    shape: Callable[[np.ndarray], np.ndarray]
    natural_gradient: Callable[[np.ndarray], np.ndarray]
    local_bulk_to_shear: float = 0.0  # the part of K/mu that resists the volume change of each point


HEX8 = Element("hexahedron", HEX8_CORNERS, HEX8_GAUSS, np.ones(8), hex8_shape, hex8_natural_gradient)
TET10 = Element(
    "tetra10", TET10_NODES, TET10_GAUSS, np.full(4, 1 / 24), tet10_shape, tet10_natural_gradient, LOCAL_BULK_TO_SHEAR
)  # fmt: skip
ELEMENTS = {len(element.nodes): element for element in (HEX8, TET10)}  # by the number of nodes


def element_gradient(X: np.ndarray, elements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the gradients of the shape functions and the weights at the quadrature points of the undeformed mesh.

    Parameters
    ----------
    X : numpy.ndarray
        (N, 3), nodes [mm].
    elements : numpy.ndarray
        (E, A) int, their nodes; A is a key of ELEMENTS.

    Returns
    -------
    numpy.ndarray
        dN/dX (E, Q, A, 3) [1/mm] at Q points.
    numpy.ndarray
        Weights (E, Q) [mm^3].

    Raises
    ------
    ValueError
        For an inverted element.
    """
    kind = ELEMENTS[elements.shape[1]]
    dN = kind.natural_gradient(kind.points)  # (Q points, A nodes, 3)
    gradient, factor = _gradient(X, elements, dN)
    if not factor.min() > 0:
        worst = int(np.argmin(factor.min(axis=1)))
        raise ValueError(
            f"element {worst} has volume factor {factor.min():.3g} mm^3 at a Gauss point; untangle the mesh"
        )
    return gradient, factor * kind.weights


@nb.njit(cache=True, error_model="numpy")
def _gradient(X, elements, dN):
    """Return dN/dX (E, Q, A, 3) and det dX/dxi (E, Q), dN (Q, A, 3) the gradients in natural coordinates."""
    (E, A), Q = elements.shape, len(dN)
    gradient, factor = np.empty((E, Q, A, 3)), np.empty((E, Q))
    J, inverse = np.empty((3, 3)), np.empty((3, 3))  # dX_x / dxi_k, dxi_k / dX_x
    for e in range(E):
        for q in range(Q):
            J[:] = 0.0
            for a in range(A):
                for x in range(3):
                    for k in range(3):
                        J[x, k] += X[elements[e, a], x] * dN[q, a, k]
            for k in range(3):
                l, m = (k + 1) % 3, (k + 2) % 3
                for x in range(3):
                    y, z = (x + 1) % 3, (x + 2) % 3
                    inverse[k, x] = J[y, l] * J[z, m] - J[z, l] * J[y, m]
            det = J[0, 0] * inverse[0, 0] + J[1, 0] * inverse[0, 1] + J[2, 0] * inverse[0, 2]
            factor[e, q] = det
            for a in range(A):
                for x in range(3):
                    gradient[e, q, a, x] = (
                        dN[q, a, 0] * inverse[0, x]
                        + dN[q, a, 1] * inverse[1, x]
                        + dN[q, a, 2] * inverse[2, x]
                    ) / det
    return gradient, factor


def mean_gradient(gradient: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the mean gradient of the shape functions over the volume of every element.

    Parameters
    ----------
    gradient : numpy.ndarray
        dN/dX (E, Q, A, 3) [1/mm].
    weight : numpy.ndarray
        (E, Q) [mm^3].

    Returns
    -------
    numpy.ndarray
        (E, A, 3) [1/mm].
    """
    E, Q, A, _ = gradient.shape
    share = weight / weight.sum(axis=1, keepdims=True)
    return (share[:, None] @ gradient.reshape(E, Q, 3 * A)).reshape(E, A, 3)


def quadratic_tetrahedra(X: np.ndarray, tetrahedra: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return straight tetrahedra of ten nodes from their corners.

    Parameters
    ----------
    X : numpy.ndarray
        (N, 3) [mm] corners.
    tetrahedra : numpy.ndarray
        (E, 4) int, rows of corners.

    Returns
    -------
    numpy.ndarray
        (N + edges, 3) [mm]: the corners, then the middle of each edge.
    numpy.ndarray
        (E, 10) int32, in meshio's order.
    """
    edges = np.sort(tetrahedra[:, TET10_EDGES], axis=-1).reshape(-1, 2)
    unique, middle = np.unique(edges, axis=0, return_inverse=True)
    nodes = np.concatenate([X, X[unique].mean(axis=1)])
    return nodes, np.hstack([tetrahedra, len(X) + middle.reshape(-1, 6)]).astype(np.int32)


def lumped_area(X: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the share of faces that belongs to each node.

    A four-sided face is a rectangle, a quarter to each corner. A six-node triangle is four flat ones, a third of each to
    its corners: all shares are positive. Over a flat face a linear traction keeps its force, a uniform one its moment too.

    Parameters
    ----------
    X : numpy.ndarray
        (N, 3) [mm] nodes.
    faces : numpy.ndarray
        (F, 4) or (F, 6) int, rows of nodes.

    Returns
    -------
    numpy.ndarray
        (N,) [mm^2]; they sum to the area of the faces.
    """
    area = np.zeros(len(X))
    if faces.shape[1] == 4:
        corner = X[faces]
        diagonals = np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1])
        np.add.at(area, faces, np.linalg.norm(diagonals, axis=1)[:, None] / 8)
        return area
    triangles = faces[:, TRIANGLE6_PARTS].reshape(-1, 3)
    corner = X[triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    np.add.at(area, triangles, np.linalg.norm(normal, axis=1)[:, None] / 6)
    return area
