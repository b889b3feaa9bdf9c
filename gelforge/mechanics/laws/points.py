r"""The compiled form of the laws: principal stresses and their slopes at a point of several elements at once.

Given the isochoric stretches, the routine of a law returns its energy W,

.. math:: \beta_i = \mathrm{dev}\, \frac{\partial W}{\partial\ln\lambda_i}, \qquad
    \gamma_{ij} = \frac{\partial\beta_i}{\partial\ln\lambda_j} \text{ (both indices without their mean)}

as beta (3,) and gamma (6,) = 00, 11, 22, 01, 02, 12, and how far the point is on its way to the law's limit of extension (1:
reached; 0: no limit). A law of the invariants gives the derivatives of its energy alone. The routines are those of the files
in `models`; laws may share one. They are written for floats and compiled for `lanes`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from inspect import getfile
from pathlib import Path
from zlib import crc32

import numba as nb
import numpy as np

from gelforge.mechanics.laws.corrected import Corrected
from gelforge.mechanics.laws.lanes import ONCE
from gelforge.mechanics.laws.law import InvariantLaw, PrincipalLaw
from gelforge.mechanics.laws.models import MODELS

_LAWS: list[type[PrincipalLaw]] = [model.law for model in MODELS.values()]
_OF_STRETCHES = list(dict.fromkeys(law.point for law in _LAWS if not issubclass(law, InvariantLaw)))
_OF_INVARIANTS = list(dict.fromkeys(law.point for law in _LAWS if issubclass(law, InvariantLaw)))
_ROUTINES = [*_OF_STRETCHES, *_OF_INVARIANTS]
STRETCHES = len(_OF_STRETCHES)  # routines below this number are of the stretches
# Added to the number of a law whose energy is corrected; its row of constants ends in C20, C30
CORRECTED = len(_ROUTINES)


def fingerprint(*files: str) -> int:
    """Return what compiled kernels on disk are known by: another number once one of these files or a routine is another."""
    known = sorted({__file__, getfile(PrincipalLaw), *map(getfile, _ROUTINES), *files})
    return crc32(b"".join(Path(file).read_bytes() for file in known))


def point_number(law: PrincipalLaw) -> int:
    """Return the number by which principal_stress knows a law's routine."""
    if isinstance(law, Corrected):
        return CORRECTED + point_number(law.law)
    return _ROUTINES.index(type(law).point)


def point_constants(laws: Sequence[PrincipalLaw]) -> np.ndarray:
    """Return the constants (L, K) as principal_stress takes them, a law a row."""
    correction = 2 * any(isinstance(law, Corrected) for law in laws)
    constants = np.zeros((len(laws), max(len(_plain(law).point_constants) for law in laws) + correction))
    for row, law in zip(constants, laws):
        constants_of = _plain(law).point_constants
        row[: len(constants_of)] = constants_of
        if isinstance(law, Corrected):
            row[-2:] = law.C20, law.C30
    return constants


def _plain(law: PrincipalLaw) -> PrincipalLaw:
    return law.law if isinstance(law, Corrected) else law


def _inlined(routine: Callable):
    return nb.njit(inline="always")(routine)


def _stretches_by_number(others, numbered):
    number, routine = numbered[0], _inlined(numbered[1])

    def choice(law, constants, lam):
        if law == number:
            return routine(constants, lam)
        return others(law, constants, lam)

    return _inlined(choice)


def _invariants_by_number(others, numbered):
    number, routine = numbered[0], _inlined(numbered[1])

    def choice(law, constants, x, y):
        if law == number:
            return routine(constants, x, y)
        return others(law, constants, x, y)

    return _inlined(choice)


def _last_of_stretches(routine: Callable):
    inlined = _inlined(routine)
    return _inlined(lambda law, constants, lam: inlined(constants, lam))


def _last_of_invariants(routine: Callable):
    inlined = _inlined(routine)
    return _inlined(lambda law, constants, x, y: inlined(constants, x, y))


_of_stretches = reduce(
    _stretches_by_number, enumerate(_OF_STRETCHES[1:], start=1), _last_of_stretches(_OF_STRETCHES[0])
)
_of_invariants = reduce(
    _invariants_by_number,
    enumerate(_OF_INVARIANTS[1:], start=STRETCHES + 1),
    _last_of_invariants(_OF_INVARIANTS[0]),
)


@nb.njit(inline="always")
def _by_invariants(x, y, first, second):
    """Return beta and gamma of a law of the invariants at x_i = lam_i^2, y_i = 1 / x_i from its derivatives by them."""
    (x0, x1, x2), (y0, y1, y2), (W1, W2), (W11, W12, W22) = x, y, first, second
    mean_x, mean_y = (x0 + x1 + x2) / 3.0, (y0 + y1 + y2) / 3.0
    # dI1/d ln lam_i and dI2/d ln lam_i without their means; their own slopes are 2 f and -2 g before that.
    f0, f1, f2 = 2.0 * (x0 - mean_x), 2.0 * (x1 - mean_x), 2.0 * (x2 - mean_x)
    g0, g1, g2 = 2.0 * (mean_y - y0), 2.0 * (mean_y - y1), 2.0 * (mean_y - y2)
    d0, d1, d2 = 4.0 * (W1 * x0 + W2 * y0), 4.0 * (W1 * x1 + W2 * y1), 4.0 * (W1 * x2 + W2 * y2)
    mean = (d0 + d1 + d2) / 9.0
    # W_1 f + W_2 g is beta; these are the slopes of the derivatives themselves.
    h0, h1, h2 = W11 * f0 + W12 * g0, W11 * f1 + W12 * g1, W11 * f2 + W12 * g2
    k0, k1, k2 = W12 * f0 + W22 * g0, W12 * f1 + W22 * g1, W12 * f2 + W22 * g2
    gamma = (
        d0 / 3.0 + mean + h0 * f0 + k0 * g0,
        d1 / 3.0 + mean + h1 * f1 + k1 * g1,
        d2 / 3.0 + mean + h2 * f2 + k2 * g2,
        mean - (d0 + d1) / 3.0 + h0 * f1 + k0 * g1,
        mean - (d0 + d2) / 3.0 + h0 * f2 + k0 * g2,
        mean - (d1 + d2) / 3.0 + h1 * f2 + k1 * g2,
    )
    return (W1 * f0 + W2 * g0, W1 * f1 + W2 * g1, W1 * f2 + W2 * g2), gamma


@nb.njit(inline="always")
def _of_plain(law, constants, lam):
    if law < STRETCHES:
        return _of_stretches(law, constants, lam)
    x0, x1, x2 = lam[0] * lam[0], lam[1] * lam[1], lam[2] * lam[2]
    y0, y1, y2 = 1.0 / x0, 1.0 / x1, 1.0 / x2
    energy, W1, W2, W11, W12, W22, extension = _of_invariants(
        law, constants, x0 + x1 + x2 - 3.0, y0 + y1 + y2 - 3.0
    )
    beta, gamma = _by_invariants((x0, x1, x2), (y0, y1, y2), (W1, W2), (W11, W12, W22))
    return energy, beta, gamma, extension


@nb.njit(**ONCE)
def principal_stress(law, constants, lam):
    """Return W [MPa], beta (3,) [MPa], gamma (6,) [MPa] and the extension over its limit at lam (3,)."""
    corrected = law >= CORRECTED
    number, parameters = law, constants
    if corrected:
        number, parameters = law - CORRECTED, constants[:-2]
    energy, b, g, extension = _of_plain(number, parameters, lam)
    if not corrected:
        return energy, b, g, extension
    C20, C30 = constants[-2], constants[-1]
    squares, none = (lam[0] * lam[0], lam[1] * lam[1], lam[2] * lam[2]), (0.0, 0.0, 0.0)
    x = squares[0] + squares[1] + squares[2] - 3.0
    first, second = (x * (2.0 * C20 + 3.0 * x * C30), 0.0), (2.0 * C20 + 6.0 * x * C30, 0.0, 0.0)
    c, h = _by_invariants(squares, none, first, second)
    beta = (b[0] + c[0], b[1] + c[1], b[2] + c[2])
    gamma = (g[0] + h[0], g[1] + h[1], g[2] + h[2], g[3] + h[3], g[4] + h[4], g[5] + h[5])
    return energy + x * x * (C20 + x * C30), beta, gamma, extension
