"""The sparse solvers agree with each other and with SciPy, on the tangent of a pressed sensor."""

import sys

import numpy as np
import pytest
import scipy.sparse as sp
import specimens
from numpy.testing import assert_allclose
from scipy.sparse.linalg import spsolve

from gelforge.mechanics.linear import sparse
from gelforge.mechanics.linear.sparse import (
    NotPositiveDefinite,
    Pardiso,
    SuperLU,
    direct_solver,
    refined_solve,
)
from gelforge.mechanics.linear.sparsity import symmetric_product

rng = np.random.default_rng(8)


@pytest.fixture(scope="module")
def system():
    """Return a pattern, the values of a tangent at a deformed state, a right-hand side and SciPy's solution."""
    body = specimens.press().body
    u = 0.05 * rng.uniform(-1, 1, body.mesh.X.shape)
    u[body.mesh.fixed] = 0
    values = np.empty(len(body.pattern.indices))
    body.response(u, np.zeros(len(body.mesh.elements)), values)
    upper = sp.csr_matrix((values, body.pattern.indices, body.pattern.indptr))
    rhs = rng.normal(size=body.pattern.size)
    return body.pattern, values, rhs, spsolve((upper + sp.triu(upper, 1).T).tocsc(), rhs)


@pytest.fixture(params=["pardiso", "superlu"])
def solver(request, system):
    if request.param == "superlu":
        return SuperLU(system[0])
    try:
        return Pardiso(system[0])
    except ImportError:
        pytest.skip("MKL is not on this machine")


def error(x, exact):
    return np.linalg.norm(x - exact) / np.linalg.norm(exact)


def test_direct_and_refined_solutions(system, solver):
    _, values, rhs, exact = system
    solver.factor(values)
    # Rounding times a condition of about 1e4 (K/mu = 1000): 7e-5 in single precision, 4e-13 in double; margin of ten.
    limit = 1e-11 if solver.name == "superlu" else 1e-3
    assert error(solver.solve(rhs), exact) < limit

    # GMRES makes the single-precision factorisation as good as a double one, in a few steps.
    pattern, values, rhs, exact = system
    solver.factor(values)
    x, steps = refined_solve(solver, pattern, values, rhs, 1e-12, 50)
    assert error(x, exact) < 1e-11  # as above, in double precision
    assert steps <= 6  # each wins about four digits; sixteen are there to win


def test_every_step_wins_digits(system):
    """One step finds the length of the least residual, the second corrects by the double-precision residual."""
    pattern, values, rhs, _ = system
    try:
        solver = Pardiso(pattern)
    except ImportError:
        pytest.skip("MKL is not on this machine")
    solver.factor(values)

    def residual(x):
        product = np.empty_like(x)
        symmetric_product(pattern.indptr, pattern.indices, values, x, product)
        return np.linalg.norm(rhs - product)

    left = []
    for limit in (1, 2, 3):
        x, steps = refined_solve(solver, pattern, values, rhs, 0.0, limit)
        assert steps == limit
        left.append(residual(x))
    assert left[0] <= residual(solver.solve(rhs))
    assert left[1] < 1e-2 * left[0]
    assert left[2] < 1e-2 * left[1]


def test_scaled_systems_and_two_solvers_of_one_pattern_are_solved(system, solver):
    # Scaled right hand sides and values are solved. Forces of 1e-30 N must not fall out of single precision's range
    pattern, values, rhs, _ = system
    solver.factor(values)
    assert_allclose(
        1e30 * solver.solve(1e-30 * rhs), solver.solve(rhs), rtol=1e-4, atol=1e-4 * np.abs(rhs).max()
    )
    assert not solver.solve(np.zeros(pattern.size)).any()

    # Refactorisation uses the new values
    pattern, values, rhs, exact = system
    solver.factor(2 * values)
    solver.factor(4 * values)
    x, _ = refined_solve(solver, pattern, 4 * values, rhs, 1e-12, 50)
    assert error(4 * x, exact) < 1e-11

    # Two solvers of one pattern do not disturb each other
    solver.factor(values)
    other = direct_solver(pattern, solver.name)
    other.factor(3 * values)
    del other
    x, _ = refined_solve(solver, pattern, values, rhs, 1e-12, 50)
    assert error(x, exact) < 1e-11


def test_matrices_without_a_factor_are_refused(system):
    with pytest.raises(NotPositiveDefinite):
        SuperLU(system[0]).factor(0 * system[1])

    # Cholesky refuses an indefinite matrix
    try:
        solver = Pardiso(system[0])
    except ImportError:
        pytest.skip("MKL is not on this machine")
    with pytest.raises(NotPositiveDefinite, match="pivot"):
        solver.factor(-system[1])


def test_machines_without_mkl_get_superlu_and_a_chosen_solver_is_taken(system, monkeypatch):
    monkeypatch.setitem(sys.modules, "pypardiso", None)  # an import of it now fails
    monkeypatch.setattr(sparse, "_math_kernel_library", sparse._math_kernel_library.__wrapped__)
    assert direct_solver(system[0]).name == "superlu"
    with pytest.raises(ImportError, match="set linear_solver: superlu"):
        direct_solver(system[0], "pardiso")

    # A chosen solver is taken
    monkeypatch.setattr(sparse, "Pardiso", None)
    assert direct_solver(system[0], "superlu").name == "superlu"
