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


def test_equations_number_the_free_degrees_of_freedom(pattern):
    assert (pattern.equation[MESH.fixed] == -1).all()
    assert np.array_equal(pattern.equation[~MESH.fixed].ravel(), np.arange(3 * (~MESH.fixed).sum()))


def test_pattern_equals_the_brute_force_one(pattern):
    expected = set()
    for nodes in MESH.elements:
        dofs = [k for k in pattern.equation[nodes].ravel() if k >= 0]
        expected |= {(i, j) for i in dofs for j in dofs if i <= j}
    assert entries(pattern) == sorted(expected)  # in row order, columns sorted, so the diagonal comes first


def test_element_slots_name_where_rows_of_their_blocks_begin(pattern):
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


def test_node_slots_name_the_nodes_own_blocks(pattern):
    nodes = np.array([0, 26, 13, 20])
    where = entries(pattern)
    slots = pattern.node_slots(nodes)
    for node, block in zip(nodes, slots):
        for i in range(3):
            for j in range(3):
                pair = sorted((pattern.equation[node, i], pattern.equation[node, j]))
                assert (block[i, j] == -1) if pair[0] < 0 else (where[block[i, j]] == tuple(pair))
    assert (slots[MESH.fixed[nodes]] == -1).all()


def test_symmetric_product_equals_the_dense_one(pattern):
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


def test_condensation_equals_the_dense_product():
    """T^T K T by dense algebra, K the full matrix in which hanging nodes are free."""
    mesh = specimens.press(specimens.CORNER).body.mesh
    assert mesh.hanging.sum() > 20
    tied, free = (
        build_pattern(mesh.elements, mesh.fixed, mesh.ties),
        build_pattern(mesh.elements, mesh.fixed),
    )
    values = np.random.default_rng(1).normal(size=tied.assembled)

    def dense(pattern, data):
        upper = sp.csr_matrix((data, pattern.indices, pattern.indptr), shape=(pattern.size,) * 2).toarray()
        return upper + np.triu(upper, 1).T

    T = np.zeros((free.size, tied.size))
    ties = mesh.ties.tocoo()
    for node, master, weight in zip(ties.row, ties.col, ties.data):
        for i in range(3):
            row, column = free.equation[node, i], tied.equation[master, i]
            if row >= 0 and column >= 0:
                T[row, column] = weight
    expected = T.T @ dense(free, values) @ T
    assert_allclose(dense(tied, tied.condense @ values), expected, atol=1e-12)
