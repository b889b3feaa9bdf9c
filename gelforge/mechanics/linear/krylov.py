"""Flexible GMRES: the preconditioned directions are kept, so that the solution needs no further back-substitution."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Operator = Callable[[np.ndarray], np.ndarray]


def flexible_gmres(
    product: Operator, precondition: Operator, rhs: np.ndarray, target: float, limit: int
) -> tuple[np.ndarray, int]:
    """Solve A x = rhs until the residual's norm is at most target, or for `limit` steps.

    Parameters
    ----------
    product, precondition : callable
        A times a vector (n,), and an approximate inverse of A times a vector (n,).
    rhs : (n,) array
    target : float
        Norm of rhs - A x at which to stop, in the units of rhs.
    limit : int
        Most applications of the preconditioner.

    Returns
    -------
    x : (n,) array
        The combination of the preconditioned directions with the least residual.
    steps : int
        Applications of the preconditioner.

    References
    ----------
    Saad 1993, doi 10.1137/0914028.

    Examples
    --------
    >>> import numpy as np
    >>> x, steps = flexible_gmres(lambda v: 2 * v, lambda v: v, np.ones(3), 1e-12, 5)
    >>> x, steps
    (array([0.5, 0.5, 0.5]), 1)
    """
    size = float(np.linalg.norm(rhs))
    if size <= target or limit == 0:
        return np.zeros_like(rhs), 0
    basis, directions = [rhs / size], []
    H = np.zeros((limit + 1, limit))
    reduced = np.zeros(limit + 1)
    reduced[0] = size
    for k in range(limit):
        directions.append(precondition(basis[k]))
        w = product(directions[k])
        for j, v in enumerate(basis):  # modified Gram-Schmidt
            H[j, k] = w @ v
            w -= H[j, k] * v
        H[k + 1, k] = np.linalg.norm(w)
        y, *_ = np.linalg.lstsq(H[: k + 2, : k + 1], reduced[: k + 2], rcond=None)
        left = float(np.linalg.norm(H[: k + 2, : k + 1] @ y - reduced[: k + 2]))
        if left <= target or H[k + 1, k] <= np.finfo(float).eps * size:
            break
        basis.append(w / H[k + 1, k])
    return sum(c * z for c, z in zip(y, directions)), len(directions)
