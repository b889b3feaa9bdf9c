"""Lanes: numbers of several elements in vector registers, against NumPy lane by lane."""

import inspect
import math
import operator

import numba as nb
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gelforge.mechanics.bodies.layout import load6, rooms, store3, store9
from gelforge.mechanics.bodies.point_stress import eigen
from gelforge.mechanics.laws.lanes import FAST, LANES, PART, PARTS, any_less, load, store, where_less

rng = np.random.default_rng(3)
SPECIAL = [0.0, -0.0, 1.0, -1.0, math.inf, -math.inf, math.nan, 5e-324, 1e-310, 2.0**-1022, 1e308, -1e308]


@nb.njit
def _room(points):
    return rooms(points, 0)[0]


def in_room(values):
    """Return values (n, LANES) as a room lays them out."""
    room = _room(len(values))
    room[:] = values.reshape(len(values), PARTS, PART).swapaxes(0, 1).reshape(PARTS, -1)
    return room


def in_lanes(function, *arguments):
    """Return a function's values at numbers (n,), computed in lanes."""
    n = len(arguments[0])
    padded = [np.resize(x, -(-n // LANES) * LANES).reshape(-1, LANES) for x in arguments]
    compiled = nb.njit(function) if inspect.isfunction(function) else function

    if len(arguments) == 1:

        @nb.njit(fastmath=FAST, error_model="numpy")
        def run(x, y, out):
            for k in range(x.shape[1] // PART):
                store(out, k, compiled(load(x, k)))

    else:

        @nb.njit(fastmath=FAST, error_model="numpy")
        def run(x, y, out):
            for k in range(x.shape[1] // PART):
                store(out, k, compiled(load(x, k), load(y, k)))

    out = in_room(np.zeros_like(padded[0]))
    run(in_room(padded[0]), in_room(padded[-1]), out)
    return out.reshape(PARTS, -1, PART).swapaxes(0, 1).ravel()[:n]


def ulps(found, exact):
    """Return the errors (n,) of found in units of the last place of exact (n,), which has more digits."""
    rounded = exact.astype(float)
    same = (found == rounded) | (np.isnan(found) & np.isnan(rounded))
    return np.where(same, 0.0, np.abs((found - exact) / np.spacing(np.abs(rounded))).astype(float))


def exponents():
    edges = [-745.13, -745.14, -708.4, -708.3, 709.78, 709.79, 1e300, -1e300]
    return np.concatenate([SPECIAL, edges, *(rng.uniform(-r, r, 20_000) for r in (1e-9, 0.4, 30.0, 760.0))])


def positive():
    spread = np.exp(rng.uniform(-744, 709, 20_000))
    return np.concatenate([SPECIAL, spread, rng.uniform(0.3, 3, 20_000), 1 + rng.uniform(-1e-9, 1e-9, 2_000)])


@pytest.mark.skipif(np.finfo(np.longdouble).nmant < 63, reason="no longer doubles to compare with")
@pytest.mark.parametrize(
    ("name", "x", "largest"), [("exp", exponents(), 1.0), ("log", positive(), 2.0)], ids=["exp", "log"]
)
def test_exp_and_log_are_right_to_the_last_place(name, x, largest):
    """At every size of the result: subnormal, 0, infinite or no number too."""
    with np.errstate(all="ignore"):
        exact = getattr(np, name)(x.astype(np.longdouble))
        assert ulps(in_lanes(getattr(math, name), x), exact).max() <= largest


@pytest.mark.parametrize("function", [operator.add, operator.sub, operator.mul, operator.truediv, min, max])
def test_two_operands(function):
    x, y = rng.normal(size=40), rng.normal(size=40)
    assert_array_equal(in_lanes(function, x, y), list(map(function, x, y)))


@pytest.mark.parametrize("function", [operator.neg, abs])
def test_one_operand(function):
    x = rng.normal(size=40)
    assert_array_equal(in_lanes(function, x), list(map(function, x)))


def test_functions_choices_and_numbers_in_lanes():
    x = rng.uniform(0.1, 2.0, 40)
    assert_array_equal(in_lanes(math.sqrt, x), np.sqrt(x))
    assert_array_equal(in_lanes(math.erf, x), list(map(math.erf, x)))
    np.testing.assert_allclose(in_lanes(lambda x: x**1.7 + x**2, x), x**1.7 + x**2, rtol=1e-15)

    # A number is the same in all lanes
    x = rng.normal(size=40)
    assert_array_equal(in_lanes(lambda x: 2 - x / 4.0, x), 2 - x / 4.0)

    # Choices
    x, y = rng.normal(size=40), rng.normal(size=40)
    assert_array_equal(in_lanes(lambda x, y: where_less(x, y, 1.0, -x), x, y), np.where(x < y, 1.0, -x))
    x, y = np.zeros(LANES), np.zeros(LANES)
    for lane in range(LANES):
        y[lane] = 1.0
        assert in_lanes(lambda x, y: x + (1.0 if any_less(x, y) else 0.0), x, y)[0] == 1.0
        assert in_lanes(lambda x, y: x + (1.0 if any_less(y, x) else 0.0), x, y)[0] == 0.0


@nb.njit(fastmath=FAST, error_model="numpy")
def _eigen(matrices, found):
    for k in range(matrices.shape[1] // (6 * PART)):
        values, u, v, w = eigen(*load6(matrices, 6 * k))
        store3(found, 12 * k, values)
        store9(found, 12 * k + 3, (*u, *v, *w))


def eigen_of(matrices):
    """Return eigenvalues (n, 3) and eigenvectors (n, 3, 3), in columns, of symmetric matrices (n, 3, 3); LANES divides n."""
    order = matrices[:, [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]].reshape(-1, LANES, 6).swapaxes(1, 2)
    found = in_room(np.zeros((len(matrices) // LANES * 12, LANES)))
    _eigen(in_room(order.reshape(-1, LANES)), found)
    found = found.reshape(PARTS, -1, 12, PART).transpose(1, 0, 3, 2).reshape(-1, 12)
    return found[:, :3], found[:, 3:].reshape(-1, 3, 3).swapaxes(1, 2)


def symmetric(values):
    """Return matrices (n, 3, 3) with the eigenvalues (n, 3) in random frames."""
    Q = np.linalg.qr(rng.normal(size=(len(values), 3, 3)))[0]
    return np.einsum("nia,na,nja->nij", Q, values, Q)


def test_eigenvectors_of_every_lane():
    """Of any matrix: eigenvalues equal, nearly equal, far apart; none, one, diagonal; small and large."""
    apart = np.exp(rng.normal(size=(400, 3)))
    close = np.ones((240, 3)) + 10.0 ** -rng.uniform(1, 17, (240, 1)) * rng.normal(size=(240, 3))
    pairs = apart[:240, [0, 1, 1]] + 10.0 ** -rng.uniform(1, 17, (240, 1)) * rng.normal(size=(240, 3))
    large = np.exp(4 * rng.normal(size=(80, 3)))
    diagonal = [
        np.diag(d)
        for d in ((1.0, 1, 1), (0, 0, 0), (1, 2, 3), (3, 2, 1), (2, 3, 1), (1, 1, 2), (2, 1, 1), (1, 2, 1))
    ]
    A = np.concatenate([*map(symmetric, (apart, close, pairs, large)), diagonal])
    values, V = eigen_of(A)
    size = np.abs(A).max(axis=(1, 2))[:, None, None]
    assert np.abs(np.swapaxes(V, 1, 2) @ V - np.eye(3)).max() < 1e-14
    assert (np.abs(np.einsum("nia,na,nja->nij", V, values, V) - A) <= 1e-13 + 1e-14 * size).all()

    # Large matrices, which rounding keeps from being diagonal at once, next to such as are.
    A = symmetric(np.exp(np.array([0.1, 6.0] * LANES)[:, None] * rng.normal(size=(2 * LANES, 3))))
    values, V = eigen_of(A)
    for k in range(len(A)):
        own_values, own = eigen_of(np.repeat(A[k : k + 1], LANES, axis=0))
        assert_array_equal(own_values[0], values[k])
        assert_array_equal(own[0], V[k])
