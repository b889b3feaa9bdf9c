"""The eight symmetries of a square sensor (D4), acting on positions, bins and fields."""

from __future__ import annotations

import numpy as np

# Each element is the 2x2 matrix that acts on horizontal positions relative to the sensor's centre.
D4: dict[str, np.ndarray] = {
    "identity": np.array([[1, 0], [0, 1]]),
    "rotate_90": np.array([[0, -1], [1, 0]]),
    "rotate_180": np.array([[-1, 0], [0, -1]]),
    "rotate_270": np.array([[0, 1], [-1, 0]]),
    "mirror_x": np.array([[-1, 0], [0, 1]]),
    "mirror_y": np.array([[1, 0], [0, -1]]),
    "swap_xy": np.array([[0, 1], [1, 0]]),
    "swap_xy_negative": np.array([[0, -1], [-1, 0]]),
}


def inverse(name: str) -> str:
    """Return the name of the symmetry that takes another one back.

    Parameters
    ----------
    name : str
        A key of D4.

    Returns
    -------
    str
        A key of D4.
    """
    return next(other for other, matrix in D4.items() if (matrix == D4[name].T).all())


def transform_points(name: str, points: np.ndarray, width: float) -> np.ndarray:
    """Return points carried by a symmetry of the square.

    Parameters
    ----------
    name : str
        A key of D4.
    points : (..., 2) or (..., 3) array
        In the sensor's frame [mm].
    width : float
        Of the square [mm].

    Returns
    -------
    numpy.ndarray
        Same shape [mm].
    """
    moved = np.array(points, dtype=float)
    moved[..., :2] = (moved[..., :2] - width / 2) @ D4[name].T + width / 2
    return moved


def transform_vectors(name: str, vectors: np.ndarray) -> np.ndarray:
    """Return vectors carried by a symmetry of the square; the z component stays.

    Parameters
    ----------
    name : str
        A key of D4.
    vectors : numpy.ndarray
        (..., 3).

    Returns
    -------
    numpy.ndarray
        (..., 3) float64.
    """
    moved = np.array(vectors, dtype=float)
    moved[..., :2] = moved[..., :2] @ D4[name].T
    return moved


def transform_bins(name: str, bins: np.ndarray, n: int) -> np.ndarray:
    """Return forces of bins carried by a symmetry of the square.

    Parameters
    ----------
    name : str
        A key of D4.
    bins : numpy.ndarray
        (..., n * n, 3) [N], bin k = n iy + ix.
    n : int
        Bins along each side.

    Returns
    -------
    numpy.ndarray
        (..., n * n, 3) [N].
    """
    index = np.arange(n * n)
    centre = np.stack([index % n, index // n], axis=-1) - (n - 1) / 2
    target = np.rint(centre @ D4[name].T + (n - 1) / 2).astype(int)
    moved = np.empty_like(bins)
    moved[..., target[:, 1] * n + target[:, 0], :] = transform_vectors(name, bins)
    return moved
