"""The tangent with unsymmetric blocks at some nodes against dense algebra."""

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.mechanics.linear.sparse import direct_solver
from gelforge.mechanics.linear.unsymmetric import UnsymmetricTangent

SOLVERS = sorted({"superlu", direct_solver(specimens.press().body.pattern).name})


@pytest.fixture(scope="module")
def body():
    return specimens.press(specimens.CORNER).body  # with hanging nodes


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("count", [0, 1, 30])
def test_solutions_are_those_of_the_dense_matrix(body, solver, count):
    pattern, rng = body.pattern, np.random.default_rng(2)
    upper = np.empty(len(pattern.indices))
    body.response(np.zeros_like(body.mesh.X), np.zeros(len(body.mesh.elements)), upper)
    nodes = body.mesh.surface.nodes[:count]
    if count > 1:  # one that is held
        nodes = np.sort(np.append(nodes, np.flatnonzero(body.mesh.fixed)[-1]))
    blocks = upper.max() * rng.normal(size=(len(nodes), 3, 3))
    blocks[::2] *= 1e6  # as stiff as what holds a node
    dense = np.zeros((pattern.size, pattern.size))
    rows = np.repeat(np.arange(pattern.size), np.diff(pattern.indptr))
    dense[rows, pattern.indices] = dense[pattern.indices, rows] = upper
    for equation, block in zip(pattern.equation[nodes], blocks):
        if equation[0] >= 0:
            dense[np.ix_(equation, equation)] += block
    rhs = rng.normal(size=(5, pattern.size))
    expected = np.linalg.solve(dense, rhs.T).T
    tangent = UnsymmetricTangent(pattern, nodes, solver)
    tangent.factor(upper, blocks)
    size = np.abs(expected).max()
    assert_allclose(tangent.solve(rhs), expected, atol=1e-9 * size, rtol=0)
    at_nodes = np.zeros((5, len(nodes), 3))
    held = pattern.equation[nodes] < 0
    at_nodes[:, ~held] = expected[:, pattern.equation[nodes][~held]]
    assert_allclose(tangent.solve_at_nodes(rhs), at_nodes, atol=1e-9 * size, rtol=0)
    assert tangent.solve(rhs[:0]).shape == (0, pattern.size)
