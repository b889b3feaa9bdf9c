"""The pattern of the tangent against a brute-force one."""

import numpy as np
import pytest
import scipy.sparse as sp
import specimens
from numpy.testing import assert_allclose

from gelforge.mechanics.linear.sparsity import build_pattern, symmetric_product

MESH = specimens.box(2)


@pytest.fixture(scope="module")
def pattern():
    return build_pattern(MESH.elements, MESH.fixed)


def entries(pattern):
    return [(row, column) for row in range(pattern.size) for column in
            pattern.indices[pattern.indptr[row] : pattern.indptr[row + 1]]]  # fmt: skip


def test_pattern_equations_and_product_equal_the_dense_ones(pattern):
    # Pattern and equations equal the brute force ones
    assert (pattern.equation[MESH.fixed] == -1).all()
    assert np.array_equal(pattern.equation[~MESH.fixed].ravel(), np.arange(3 * (~MESH.fixed).sum()))

    # Pattern equals the brute force one
    expected = set()
    for nodes in MESH.elements:
        dofs = [k for k in pattern.equation[nodes].ravel() if k >= 0]
        expected |= {(i, j) for i in dofs for j in dofs if i <= j}
    assert entries(pattern) == sorted(expected)  # in row order, columns sorted, so the diagonal comes first

    # Symmetric product equals the dense one
    rng = np.random.default_rng(0)
    values, x, y = (
        rng.normal(size=len(pattern.indices)),
        rng.normal(size=pattern.size),
        np.empty(pattern.size),
    )
    dense = np.zeros((pattern.size, pattern.size))
    for (i, j), value in zip(entries(pattern), values):
        dense[i, j] = dense[j, i] = value
    symmetric_product(pattern.indptr, pattern.indices, values, x, y)
    assert_allclose(y, dense @ x, rtol=1e-12, atol=1e-12)  # sums of some 80 terms of order one


def test_slots_name_where_blocks_begin(pattern):
    where = entries(pattern)
    pairs = [(a, c) for a in range(8) for c in range(a, 8)]
    for nodes, slots in zip(MESH.elements, pattern.element_slots):
        assert len(slots) == len(pairs)
        for (a, c), rows in zip(pairs, slots):
            row, column = (pattern.equation[n] for n in sorted((nodes[a], nodes[c])))
            for i, slot in enumerate(rows):
                if row[0] < 0 or column[0] < 0:
                    assert slot == -1
                    continue
                first = i if a == c else 0
                found = where[slot : slot + 3 - first]
                assert found == [(row[i], column[m]) for m in range(first, 3)]

    # Node slots name the nodes own blocks
    nodes = np.array([0, 26, 13, 20])
    slots = pattern.node_slots(nodes)
    for node, block in zip(nodes, slots):
        for i in range(3):
            for j in range(3):
                pair = sorted((pattern.equation[node, i], pattern.equation[node, j]))
                assert (block[i, j] == -1) if pair[0] < 0 else (where[block[i, j]] == tuple(pair))
    assert (slots[MESH.fixed[nodes]] == -1).all()


def assembled(pattern, elements, matrices):
    """Return the values of symmetric element matrices (E, 3 A, 3 A) added where the slots say."""
    values = np.zeros(pattern.assembled)
    A = elements.shape[1]
    pairs = [(a, c) for a in range(A) for c in range(a, A)]
    for nodes, slots, K in zip(elements, pattern.element_slots, matrices):
        for (a, c), rows in zip(pairs, slots):
            row, column = (a, c) if nodes[a] <= nodes[c] else (c, a)
            for i in range(3):
                first = i if a == c else 0
                if rows[0] >= 0:
                    values[rows[i] : rows[i] + 3 - first] += K[
                        3 * row + i, 3 * column + first : 3 * column + 3
                    ]
    return values


def test_hanging_nodes_share_by_their_masters():
    mesh = specimens.press(specimens.CORNER).body.mesh
    tied = build_pattern(mesh.elements, mesh.fixed, mesh.ties)
    expected = set()
    for nodes in mesh.elements:
        masters = np.concatenate([mesh.ties[n].indices for n in nodes])
        dofs = [k for k in tied.equation[np.unique(masters)].ravel() if k >= 0]
        expected |= {(i, j) for i in dofs for j in dofs if i <= j}
    assert entries(tied) == sorted(expected)

    # T^T K T by dense algebra, K the full matrix in which hanging nodes are free.
    assert mesh.hanging.sum() > 20
    E, A = mesh.elements.shape
    matrices = np.random.default_rng(1).normal(size=(E, 3 * A, 3 * A))
    matrices += matrices.transpose(0, 2, 1)
    N = len(mesh.X)
    K = np.zeros((3 * N, 3 * N))
    for nodes, own in zip(mesh.elements, matrices):
        dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
        K[np.ix_(dofs, dofs)] += own
    T = sp.kron(mesh.ties, np.eye(3)).toarray()[:, np.flatnonzero((tied.equation >= 0).ravel())]
    T[3 * np.flatnonzero(mesh.fixed)[:, None] + np.arange(3)] = 0.0
    upper = sp.csr_matrix(
        (tied.condense @ assembled(tied, mesh.elements, matrices), tied.indices, tied.indptr),
        shape=(tied.size, tied.size),
    ).toarray()
    assert_allclose(upper, np.triu(T.T @ K @ T), atol=1e-12)
