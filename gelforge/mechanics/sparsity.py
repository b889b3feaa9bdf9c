"""Where the entries of the global tangent go: one upper-triangular CSR pattern per mesh, slots for elements and nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
import scipy.sparse as sp


@dataclass(frozen=True)
class Pattern:
    """Upper triangle of the symmetric tangent over the free degrees of freedom."""

    equation: np.ndarray  # (N, 3) int32, number of each degree of freedom, -1 where fixed
    indptr: np.ndarray  # (n + 1,) int32
    indices: np.ndarray  # (nnz,) int32, sorted, the diagonal first in every row
    element_slots: (
        np.ndarray
    )  # (E, 300) int32 into the values, upper element pairs row by row, -1 where fixed

    @property
    def size(self) -> int:
        return len(self.indptr) - 1

    def node_slots(self, nodes: np.ndarray) -> np.ndarray:
        """Return the slots (n, 3, 3) of the nodes' own 3x3 blocks, -1 where fixed; both triangles name the upper entry."""
        slots = np.full((len(nodes), 3, 3), -1, dtype=np.int32)
        for i in range(3):
            for j in range(i, 3):
                row, column = self.equation[nodes, i], self.equation[nodes, j]
                for k in np.flatnonzero((row >= 0) & (column >= 0)):
                    start, stop = self.indptr[row[k]], self.indptr[row[k] + 1]
                    slots[k, i, j] = slots[k, j, i] = start + np.searchsorted(
                        self.indices[start:stop], column[k]
                    )
        return slots


def build_pattern(elements: np.ndarray, fixed: np.ndarray) -> Pattern:
    """Return the pattern of a mesh: elements (E, A) node numbers, fixed (N,) bool (all three directions)."""
    N = len(fixed)
    equation = np.full((N, 3), -1, dtype=np.int32)
    equation[~fixed] = np.arange(3 * (~fixed).sum()).reshape(-1, 3)
    E, A = elements.shape
    incidence = sp.csr_matrix(
        (np.ones(E * A, np.int32), elements.ravel(), np.arange(0, E * A + 1, A)), shape=(E, N)
    )
    neighbours = (incidence.T @ incidence)[~fixed][:, ~fixed]
    neighbours.data = np.ones(len(neighbours.data), np.int8)
    full = sp.kron(neighbours, np.ones((3, 3), np.int8), format="csr")
    upper = sp.triu(full, format="csr")
    upper.sort_indices()
    indptr, indices = upper.indptr.astype(np.int32), upper.indices.astype(np.int32)
    dofs = equation[elements].reshape(E, 3 * A)
    return Pattern(equation, indptr, indices, _element_slots(dofs, indptr, indices))


@nb.njit(cache=True)
def _element_slots(dofs, indptr, indices):
    E, n = dofs.shape
    slots = np.full((E, n * (n + 1) // 2), -1, np.int32)
    for e in range(E):
        k = 0
        for a in range(n):
            for b in range(a, n):
                i = dofs[e, a]
                j = dofs[e, b]
                if i >= 0 and j >= 0:
                    if i > j:
                        i, j = j, i
                    low = indptr[i]
                    high = indptr[i + 1]
                    while low < high:
                        mid = (low + high) // 2
                        if indices[mid] < j:
                            low = mid + 1
                        else:
                            high = mid
                    slots[e, k] = low
                k += 1
    return slots
