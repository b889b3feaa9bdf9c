"""Where the entries of the global tangent go: one upper-triangular CSR pattern per mesh, slots for elements and nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numba as nb
import numpy as np
import scipy.sparse as sp


class Rows(Protocol):
    """The places of the values of a square sparse matrix of `size` rows."""

    @property
    def indptr(self) -> np.ndarray: ...  # (n + 1,) int32

    @property
    def indices(self) -> np.ndarray: ...  # (nnz,) int32, sorted in every row

    @property
    def size(self) -> int: ...


@dataclass(frozen=True)
class Pattern:
    """Upper triangle of the symmetric tangent over the free degrees of freedom."""

    equation: np.ndarray  # (N, 3) int32, number of each degree of freedom, -1 where fixed or hanging
    indptr: np.ndarray  # (n + 1,) int32
    indices: np.ndarray  # (nnz,) int32, sorted, the diagonal first in every row
    # (E, pairs, 3) int32 of the pairs of an element's nodes, row by row: where the three rows of their block begin in the
    # assembled values, on the diagonal at the diagonal. The block's row is the smaller node; -1 where one is fixed.
    element_slots: np.ndarray
    condense: (
        sp.csr_matrix | None
    )  # (nnz, assembled): takes the values of hanging nodes to those they hang on

    @property
    def size(self) -> int:
        return len(self.indptr) - 1

    @property
    def assembled(self) -> int:
        """The number of values that the elements fill."""
        return len(self.indices) if self.condense is None else self.condense.shape[1]

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


def build_pattern(elements: np.ndarray, fixed: np.ndarray, ties: sp.csr_matrix | None = None) -> Pattern:
    """Return the pattern of a mesh: elements (E, A) node numbers, fixed (N,) bool (all three directions), ties (N, N)."""
    E, A = elements.shape
    N = len(fixed)
    incidence = sp.csr_matrix(
        (np.ones(E * A, np.int32), elements.ravel(), np.arange(0, E * A + 1, A)), shape=(E, N)
    )
    equation, indptr, indices = _upper(incidence, ~fixed)
    if ties is None:
        slots = _element_slots(elements, equation, indptr, indices)
        return Pattern(equation, indptr, indices, slots, None)
    # The elements fill a pattern in which hanging nodes are free; one sparse product then condenses them out.
    hanging = np.diff(ties.indptr) > 1
    slots = _element_slots(elements, equation, indptr, indices)
    tied, tied_indptr, tied_indices = _upper(incidence @ (ties != 0).astype(np.int32), ~fixed & ~hanging)
    row, column, weight = _condensation(
        indptr,
        indices,
        _owners(equation),
        ties.indptr,
        ties.indices,
        ties.data,
        tied,
        tied_indptr,
        tied_indices,
    )
    condense = sp.csr_matrix((weight, (row, column)), shape=(len(tied_indices), len(indices)))
    return Pattern(tied, tied_indptr, tied_indices, slots, condense)


def _upper(incidence: sp.csr_matrix, free: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return equation (N, 3), indptr and indices of the upper triangle over the free nodes; incidence is (E, N)."""
    equation = np.full((len(free), 3), -1, dtype=np.int32)
    equation[free] = np.arange(3 * free.sum()).reshape(-1, 3)
    shared = incidence[:, free]
    neighbours = shared.T @ shared
    neighbours.data = np.ones(len(neighbours.data), np.int8)
    full = sp.kron(neighbours, np.ones((3, 3), np.int8), format="csr")
    upper = sp.triu(full, format="csr")
    upper.sort_indices()
    return equation, upper.indptr.astype(np.int32), upper.indices.astype(np.int32)


def _owners(equation: np.ndarray) -> np.ndarray:
    """Return node and direction (n, 2) int32 of every equation."""
    node, direction = np.nonzero(equation >= 0)
    owners = np.empty((len(node), 2), np.int32)
    owners[equation[node, direction]] = np.stack([node, direction], axis=1)
    return owners


@nb.njit(cache=True)
def _slot(indptr, indices, i, j):
    """Return the place of the entry (i, j), i <= j."""
    low = indptr[i]
    high = indptr[i + 1]
    while low < high:
        mid = (low + high) // 2
        if indices[mid] < j:
            low = mid + 1
        else:
            high = mid
    return low


@nb.njit(cache=True)
def _element_slots(elements, equation, indptr, indices):
    E, A = elements.shape
    slots = np.full((E, A * (A + 1) // 2, 3), -1, np.int32)
    for e in range(E):
        k = 0
        for a in range(A):
            for c in range(a, A):
                row = min(elements[e, a], elements[e, c])
                column = max(elements[e, a], elements[e, c])
                if equation[row, 0] >= 0 and equation[column, 0] >= 0:
                    for i in range(3):
                        first = i if row == column else 0
                        slots[e, k, i] = _slot(indptr, indices, equation[row, i], equation[column, first])
                k += 1
    return slots


@nb.njit(cache=True)
def _condensation(indptr, indices, owners, tie_ptr, tie_node, tie_weight, tied, tied_ptr, tied_indices):
    """Return (row, column, weight) of the map from upper values with hanging nodes to upper values T^T K T without."""
    count = 0
    for i in range(owners.shape[0]):
        ni = owners[i, 0]
        for k in range(indptr[i], indptr[i + 1]):
            nj = owners[indices[k], 0]
            count += (tie_ptr[ni + 1] - tie_ptr[ni]) * (tie_ptr[nj + 1] - tie_ptr[nj])
    row = np.empty(count, np.int32)
    column = np.empty(count, np.int32)
    weight = np.empty(count)
    n = 0
    for i in range(owners.shape[0]):
        ni = owners[i, 0]
        for k in range(indptr[i], indptr[i + 1]):
            j = indices[k]
            nj = owners[j, 0]
            for p in range(tie_ptr[ni], tie_ptr[ni + 1]):
                a = tied[tie_node[p], owners[i, 1]]
                if a < 0:
                    continue
                for q in range(tie_ptr[nj], tie_ptr[nj + 1]):
                    b = tied[tie_node[q], owners[j, 1]]
                    if b < 0 or (i == j and a > b):
                        continue
                    w = tie_weight[p] * tie_weight[q]
                    if i != j and a == b:  # the entry and its mirror image meet on the diagonal
                        w *= 2.0
                    row[n] = _slot(tied_ptr, tied_indices, min(a, b), max(a, b))
                    column[n] = k
                    weight[n] = w
                    n += 1
    return row[:n], column[:n], weight[:n]


@nb.njit(cache=True)
def symmetric_product(indptr, indices, data, x, y):
    """Fill y = A x for a symmetric A whose upper triangle is in CSR form, diagonal first in every row."""
    for i in range(x.shape[0]):
        y[i] = 0.0
    for i in range(x.shape[0]):
        first = indptr[i]
        xi = x[i]
        s = data[first] * xi
        for k in range(first + 1, indptr[i + 1]):
            j = indices[k]
            s += data[k] * x[j]
            y[j] += data[k] * xi
        y[i] += s
