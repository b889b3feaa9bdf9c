"""Columns whitened and compressed to a few rows, under a covariance with further draws of many sizes at once.

Evidence needs products of whitened columns only. With A the directions of one group of draws, and Z all other columns in its
rows, Z' (I + A A')^-1 Z = Z'Z - Z'A (I + A'A)^-1 A'Z (Woodbury): where the groups of draws lie inside one another, small
matrices of products, group by group, are all that is needed, whatever the number of entries.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.evidence.covariance import Covariance, Draws


def compressed(
    covariance: Covariance, columns: np.ndarray, more: Sequence[Draws], sizes: np.ndarray
) -> list[tuple[np.ndarray, float]]:
    """Return R (k, k), where R'R = columns' C^-1 columns, and ln det C at each of m sizes of further draws.

    columns (n, k); C: the covariance with those draws, whose groups lie inside those of its last level, and inside those of
    the level before it or around them, and around those of all others; sizes (m, q): by which their directions count, in
    turn.
    """
    sized = np.cumsum([0, *(draws.directions.shape[1] for draws in more)])
    by = [sizes[:, a:b] for a, b in zip(sized, sized[1:])]
    last = covariance.levels[-2:]
    own = [np.ones((len(sizes), draws.directions.shape[1])) for draws in last]
    # of nested groups the finer ones are more
    levels = sorted(zip([*more, *last], [*by, *own]), key=lambda one: -len(np.unique(one[0].group)))
    factors = np.hstack([*(factor for _, factor in levels), np.ones((len(sizes), columns.shape[1]))])
    white = covariance.whiten_finer(np.column_stack([*(draws.directions for draws, _ in levels), columns]))
    products, log_det = None, np.full(len(sizes), covariance.log_det_finer)
    inside = np.arange(len(columns))
    for draws, _ in levels:
        _, first, group = np.unique(draws.group[inside], return_index=True, return_inverse=True)
        inside = inside[first]
        if products is None:
            products = _by_group(white, group) * (factors[:, None, :, None] * factors[:, None, None, :])
        else:
            products = _summed(products, group)
        products, more_det = _without(products, draws.directions.shape[1])
        log_det = log_det + more_det.sum(axis=1)
    assert products is not None
    l, E = np.linalg.eigh(products.sum(axis=1))
    roots = np.sqrt(np.maximum(l, 0.0))[..., None] * np.swapaxes(E, -1, -2)
    return list(zip(roots, log_det.tolist()))


def _by_group(columns: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Return the products (G, K, K) of columns (n, K) in the rows of each group (n,)."""
    order = np.argsort(group, kind="stable")
    parts = np.split(columns[order], np.cumsum(np.bincount(group))[:-1])
    return np.stack([part.T @ part for part in parts])


def _summed(products: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Return products (m, G, K, K) summed over the groups that lie in each of some larger ones (G,)."""
    found = np.zeros((products.shape[0], group.max() + 1, *products.shape[2:]))
    for k, larger in enumerate(group):
        found[:, larger] += products[:, k]
    return found


def _without(products: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
    """Return products (m, G, K - q, K - q) under I + A A', A the first q columns, and its ln det (m, G)."""
    inner = np.eye(q) + products[..., :q, :q]
    across = products[..., :q, q:]
    left = products[..., q:, q:] - np.swapaxes(across, -1, -2) @ np.linalg.solve(inner, across)
    return left, np.linalg.slogdet(inner)[1]
