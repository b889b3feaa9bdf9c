"""Where the entries of the global tangent go: one upper-triangular CSR pattern per mesh, slots for elements and nodes.

A node couples in all three directions to every node it shares an element with, so that patterns are found for nodes and
written out in blocks of 3x3: rows of a node's own block begin at the diagonal, its other blocks follow in order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numba as nb
import numpy as np
import scipy.sparse as sp


@dataclass(frozen=True)
class Condensation:
    """Takes the values of blocks with hanging nodes to the nodes they hang on: T^T K T.

    Assembled are the values of the pattern itself, then those of C blocks (3x3, or the upper triangle of a node's own)
    with a hanging node.
    """

    shape: tuple[int, int]  # (nnz, assembled)
    # (C, 2, 3) int32: where the three rows of such a block begin among the assembled values, and those of the block of the
    # pattern that gets a share of it; an own block's rows begin at the diagonal.
    slots: np.ndarray
    weight: np.ndarray  # (C,)
    kind: np.ndarray  # (C,) int8, sum of OWN, TO_OWN, TURNED

    def __matmul__(self, assembled: Any) -> np.ndarray:
        """Return the values (nnz,) of the pattern without hanging nodes."""
        values = assembled[: self.shape[0]].copy()
        _hand_on(self.slots, self.weight, self.kind, assembled, values)
        return values


# Bits of one number, so that they combine: from a node's own block, to a node's own block, to the transposed one
# (tests/mechanics/test_sparsity.py).
OWN, TO_OWN, TURNED = 1, 2, 4


@dataclass(frozen=True)
class Pattern:
    """Upper triangle of the symmetric tangent over the free degrees of freedom."""

    equation: np.ndarray  # (N, 3) int32, number of each degree of freedom, -1 where fixed or hanging
    indptr: np.ndarray  # (n + 1,) int32
    indices: np.ndarray  # (nnz,) int32, sorted, the diagonal first in every row
    # (E, pairs, 3) int32 of the pairs of an element's nodes, row by row: where the three rows of their block begin in the
    # assembled values, on the diagonal at the diagonal. The block's row is the smaller node; -1 where one is fixed.
    element_slots: np.ndarray
    condense: Condensation | None  # None: no node hangs

    @property
    def size(self) -> int:
        return len(self.indptr) - 1

    @property
    def assembled(self) -> int:
        """The number of values that the elements fill."""
        return len(self.indices) if self.condense is None else self.condense.shape[1]

    def symmetric(self, values: np.ndarray) -> sp.csr_matrix:
        """Return both triangles (n, n) of the matrix whose upper one has these values (nnz,)."""
        upper = sp.csr_matrix((values, self.indices, self.indptr), shape=(self.size, self.size))
        return upper + sp.triu(upper, 1).T

    def node_slots(self, nodes: np.ndarray) -> np.ndarray:
        """Return the slots (n, 3, 3) of the nodes' own 3x3 blocks, -1 where fixed; both triangles name the upper entry."""
        equation = self.equation[nodes]
        i, j = np.indices((3, 3))
        first, last = np.minimum(i, j), np.maximum(i, j)
        slots = self.indptr[np.maximum(equation, 0)][:, first] + (last - first)
        return np.where((equation >= 0).all(axis=1)[:, None, None], slots, -1).astype(np.int32)


def build_pattern(elements: np.ndarray, fixed: np.ndarray, ties: sp.csr_matrix | None = None) -> Pattern:
    """Return the pattern of a mesh: elements (E, A) node numbers, fixed (N,) bool (all three directions), ties (N, N)."""
    E, A = elements.shape
    starts = np.arange(0, E * A + 1, A)
    nodes = np.ascontiguousarray(elements, np.int32).ravel()
    blocks = Blocks.of(starts, nodes, ~fixed)
    if ties is None:
        slots = _element_slots(elements, blocks, _starts(blocks))
        indptr, indices = _expanded(blocks)
        return Pattern(blocks.equation, indptr, indices, slots, None)
    hung = Ties(ties.indptr, ties.indices, ties.data)
    their_starts, their_nodes = _masters(starts, nodes, hung)
    tied = Blocks.of(their_starts, their_nodes, ~fixed & ~(np.diff(ties.indptr) > 1))
    indptr, indices = _expanded(tied)
    begins = _starts(tied)
    first, count = _starts_with_hanging(blocks, tied, begins, len(indices))
    slots = _element_slots(elements, blocks, first)
    handed = _handed_on(blocks, first, len(indices), hung, tied, begins)
    return Pattern(tied.equation, indptr, indices, slots, Condensation((len(indices), count), *handed))


class Ties(NamedTuple):
    """On which nodes each node hangs, in CSR form; one that does not hang hangs on itself."""

    starts: np.ndarray  # (N + 1,)
    nodes: np.ndarray
    weights: np.ndarray


class Blocks(NamedTuple):
    """Which free nodes couple: for each one itself and those of greater number, in order."""

    number: np.ndarray  # (N,) int32 of the free nodes, -1 of the others
    nodes: np.ndarray  # (F,) the free nodes
    rows: np.ndarray  # (F + 1,)
    columns: np.ndarray  # (blocks,)

    @classmethod
    def of(cls, starts: np.ndarray, members: np.ndarray, free: np.ndarray) -> Blocks:
        """Return the blocks of free (N,) nodes; starts (E + 1,) and members: the nodes of every element."""
        nodes = np.flatnonzero(free)
        number = np.where(free, np.cumsum(free) - 1, -1).astype(np.int32)
        return cls(number, nodes, *_coupled(starts, members, number, len(nodes)))

    @property
    def equation(self) -> np.ndarray:
        """Numbers (N, 3) of the degrees of freedom, -1 of nodes that are not free."""
        three = 3 * self.number[:, None] + np.arange(3, dtype=np.int32)
        return np.where(self.number[:, None] >= 0, three, np.int32(-1))


@nb.njit(cache=True)
def _coupled(starts, members, number, F):
    """Return (rows, columns) of the free nodes that share an element, upper triangle."""
    begins = np.zeros(F + 1, np.int32)
    for node in members:
        if number[node] >= 0:
            begins[number[node] + 1] += 1
    for i in range(F):
        begins[i + 1] += begins[i]
    place = begins[:-1].copy()
    sharing = np.empty(begins[F], np.int32)  # elements of every free node
    for e in range(len(starts) - 1):
        for k in range(starts[e], starts[e + 1]):
            i = number[members[k]]
            if i >= 0:
                sharing[place[i]] = e
                place[i] += 1
    rows = np.zeros(F + 1, np.int32)
    columns = np.empty(16 * F + 16, np.int32)
    seen = np.full(F, -1, np.int32)
    count = 0
    for i in range(F):
        for k in range(begins[i], begins[i + 1]):
            for m in range(starts[sharing[k]], starts[sharing[k] + 1]):
                j = number[members[m]]
                if j >= i and seen[j] != i:
                    seen[j] = i
                    if count == len(columns):
                        columns = np.concatenate((columns, np.empty(count, np.int32)))
                    columns[count] = j
                    count += 1
        columns[rows[i] : count].sort()
        rows[i + 1] = count
    return rows, columns[:count].copy()


@nb.njit(cache=True)
def _expanded(blocks):
    """Return indptr and indices of the upper triangle."""
    rows, columns = blocks.rows, blocks.columns
    F = len(rows) - 1
    indptr = np.zeros(3 * F + 1, np.int32)
    indices = np.empty(9 * len(columns) - 3 * F, np.int32)
    n = 0
    for row in range(F):
        for i in range(3):
            for k in range(rows[row], rows[row + 1]):
                for j in range(i if k == rows[row] else 0, 3):
                    indices[n] = 3 * columns[k] + j
                    n += 1
            indptr[3 * row + i + 1] = n
    return indptr, indices


@nb.njit(cache=True)
def _starts(blocks):
    """Return where the three rows of every block (blocks, 3) begin among the values."""
    rows, columns = blocks.rows, blocks.columns
    first = np.empty((len(columns), 3), np.int32)
    n = 0
    for row in range(len(rows) - 1):
        for i in range(3):
            for k in range(rows[row], rows[row + 1]):
                first[k, i] = n
                n += 3 - i if k == rows[row] else 3
    return first


@nb.njit(cache=True)
def _starts_with_hanging(blocks, tied, begins, count):
    """Return where blocks (blocks, 3) begin: in the pattern, or after its `count` values with a hanging node; their end.

    tied: the blocks of the pattern without hanging nodes, begins (., 3): where these begin.
    """
    rows, columns, nodes = blocks.rows, blocks.columns, blocks.nodes
    first = np.empty((len(columns), 3), np.int32)
    for row in range(len(rows) - 1):
        for k in range(rows[row], rows[row + 1]):
            a, b = tied.number[nodes[row]], tied.number[nodes[columns[k]]]
            if a >= 0 and b >= 0:
                first[k] = begins[_block(tied, a, b)]
                continue
            for i in range(3):
                first[k, i] = count
                count += 3 - i if columns[k] == row else 3
    return first, count


@nb.njit(cache=True)
def _block(blocks, i, j):
    """Return the number of the block (i, j), i <= j."""
    low, high = blocks.rows[i], blocks.rows[i + 1]
    while low < high:
        mid = (low + high) // 2
        if blocks.columns[mid] < j:
            low = mid + 1
        else:
            high = mid
    return low


@nb.njit(cache=True)
def _element_slots(elements, blocks, first):
    number = blocks.number
    E, A = elements.shape
    slots = np.full((E, A * (A + 1) // 2, 3), -1, np.int32)
    for e in range(E):
        pair = 0
        for a in range(A):
            for c in range(a, A):
                i, j = number[elements[e, a]], number[elements[e, c]]
                if i >= 0 and j >= 0:
                    slots[e, pair] = first[_block(blocks, min(i, j), max(i, j))]
                pair += 1
    return slots


@nb.njit(cache=True)
def _masters(starts, members, ties):
    """Return (starts, members) of elements whose hanging nodes are replaced by those they hang on."""
    tie_starts, tie_nodes = ties.starts, ties.nodes
    begins = np.zeros(len(starts), np.int64)
    for e in range(len(starts) - 1):
        begins[e + 1] = begins[e]
        for k in range(starts[e], starts[e + 1]):
            begins[e + 1] += tie_starts[members[k] + 1] - tie_starts[members[k]]
    masters = np.empty(begins[-1], np.int32)
    n = 0
    for node in members:
        for k in range(tie_starts[node], tie_starts[node + 1]):
            masters[n] = tie_nodes[k]
            n += 1
    return begins, masters


@nb.njit(cache=True)
def _handed_on(blocks, first, count, ties, tied, begins):
    """Return (slots, weight, kind) of Condensation; first (blocks, 3): where assembled blocks begin.

    tied, begins and count: as of _starts_with_hanging.
    """
    rows, columns, nodes = blocks.rows, blocks.columns, blocks.nodes
    tie_starts, tie_nodes, tie_weights = ties
    total = 0
    for row in range(len(rows) - 1):
        for k in range(rows[row], rows[row + 1]):
            if first[k, 0] >= count:
                a, b = nodes[row], nodes[columns[k]]
                total += (tie_starts[a + 1] - tie_starts[a]) * (tie_starts[b + 1] - tie_starts[b])
    slots = np.empty((total, 2, 3), np.int32)
    weight = np.empty(total)
    kind = np.empty(total, np.int8)
    n = 0
    for row in range(len(rows) - 1):
        for k in range(rows[row], rows[row + 1]):
            if first[k, 0] < count:
                continue
            a, b = nodes[row], nodes[columns[k]]
            for p in range(tie_starts[a], tie_starts[a + 1]):
                i = tied.number[tie_nodes[p]]
                for q in range(tie_starts[b], tie_starts[b + 1]):
                    j = tied.number[tie_nodes[q]]
                    # Of a node's own block the pairs (p, q) and (q, p) are each other's transposes: one is the upper one.
                    if i < 0 or j < 0 or (a == b and i > j):
                        continue
                    slots[n, 0] = first[k]
                    slots[n, 1] = begins[_block(tied, min(i, j), max(i, j))]
                    weight[n] = tie_weights[p] * tie_weights[q]
                    kind[n] = (OWN if a == b else 0) + (TO_OWN if i == j else 0) + (TURNED if i > j else 0)
                    n += 1
    return slots[:n].copy(), weight[:n].copy(), kind[:n].copy()


@nb.njit(cache=True)
def _hand_on(slots, weight, kind, assembled, values):
    """Add the values of blocks with hanging nodes to those of the blocks that get a share of them."""
    B = np.empty((3, 3))
    for n in range(len(weight)):
        w = weight[n]
        diagonal = kind[n] & OWN
        for i in range(3):
            for j in range(i if diagonal else 0, 3):
                B[i, j] = w * assembled[slots[n, 0, i] + j - (i if diagonal else 0)]
                if diagonal:
                    B[j, i] = B[i, j]
        if not kind[n] & TO_OWN:
            for i in range(3):
                for j in range(3):
                    values[slots[n, 1, i] + j] += B[j, i] if kind[n] & TURNED else B[i, j]
            continue
        for i in range(3):
            for j in range(i, 3):
                # A block between two nodes that hang on the same one meets its mirror image there.
                values[slots[n, 1, i] + j - i] += B[i, j] if diagonal else B[i, j] + B[j, i]


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
