r"""The compiled form of the laws: principal stresses and their slopes at one point.

Given the isochoric stretches, the routine of a law fills

.. math:: \beta_i = \mathrm{dev}\, \frac{\partial W}{\partial\ln\lambda_i}, \qquad
    \gamma_{ij} = \frac{\partial\beta_i}{\partial\ln\lambda_j} \text{ (both indices without their mean)}

and returns the energy and how far the point is on its way to the law's limit of extension (1: reached; 0: no limit). A law
of the invariants gives the derivatives of its energy alone. The routines are those of the files in `models`; laws may share
one.
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
from gelforge.mechanics.laws.law import InvariantLaw, PrincipalLaw
from gelforge.mechanics.laws.models import MODELS

_LAWS: list[type[PrincipalLaw]] = [model.law for model in MODELS.values()]
_OF_STRETCHES = list(dict.fromkeys(law.point for law in _LAWS if not issubclass(law, InvariantLaw)))
_OF_INVARIANTS = list(dict.fromkeys(law.point for law in _LAWS if issubclass(law, InvariantLaw)))
_ROUTINES = [*_OF_STRETCHES, *_OF_INVARIANTS]
STRETCHES = len(_OF_STRETCHES)  # routines below this number are of the stretches
CORRECTED = (
    1000  # added to the number of a law whose energy is corrected; its row of constants ends in C20, C30
)
# What the compiled kernels on disk are known by: another one once the file of a routine is another, or there is one more.
_FILES = sorted({__file__, getfile(PrincipalLaw), *map(getfile, _ROUTINES)})
FINGERPRINT = crc32(b"".join(Path(file).read_bytes() for file in _FILES))


def point_number(law: PrincipalLaw) -> int:
    """Return the number by which principal_stress knows a law's routine."""
    if isinstance(law, Corrected):
        return CORRECTED + point_number(law.law)
    return _ROUTINES.index(type(law).point)


def point_constants(laws: Sequence[PrincipalLaw]) -> np.ndarray:
    """Return the constants (L, K) as principal_stress takes them, a law a row."""
    correction = 2 * any(isinstance(law, Corrected) for law in laws)
    found = np.zeros((len(laws), max(len(_plain(law).point_constants) for law in laws) + correction))
    for row, law in zip(found, laws):
        own = _plain(law).point_constants
        row[: len(own)] = own
        if isinstance(law, Corrected):
            row[-2:] = law.C20, law.C30
    return found


def _plain(law: PrincipalLaw) -> PrincipalLaw:
    return law.law if isinstance(law, Corrected) else law


def _inlined(routine: Callable):
    return nb.njit(inline="always")(routine)


def _stretches_by_number(others, numbered):
    number, own = numbered[0], _inlined(numbered[1])

    def choice(law, constants, lam, beta, gamma):
        if law == number:
            return own(constants, lam, beta, gamma)
        return others(law, constants, lam, beta, gamma)

    return _inlined(choice)


def _invariants_by_number(others, numbered):
    number, own = numbered[0], _inlined(numbered[1])

    def choice(law, constants, x, y):
        if law == number:
            return own(constants, x, y)
        return others(law, constants, x, y)

    return _inlined(choice)


def _last_of_stretches(routine: Callable):
    own = _inlined(routine)
    return _inlined(lambda law, constants, lam, beta, gamma: own(constants, lam, beta, gamma))


def _last_of_invariants(routine: Callable):
    own = _inlined(routine)
    return _inlined(lambda law, constants, x, y: own(constants, x, y))


_of_stretches = reduce(
    _stretches_by_number, enumerate(_OF_STRETCHES[1:], start=1), _last_of_stretches(_OF_STRETCHES[0])
)
_of_invariants = reduce(
    _invariants_by_number,
    enumerate(_OF_INVARIANTS[1:], start=STRETCHES + 1),
    _last_of_invariants(_OF_INVARIANTS[0]),
)


@nb.njit(cache=True, inline="always")
def _of_plain(law, constants, lam, beta, gamma):
    if law < STRETCHES:
        return _of_stretches(law, constants, lam, beta, gamma)
    I1 = 0.0
    I2 = 0.0
    for i in range(3):
        square = lam[i] * lam[i]
        beta[i] = square  # until the invariants' slopes need the place
        I1 += square
        I2 += 1.0 / square
    energy, W1, W2, W11, W12, W22, extension = _of_invariants(law, constants, I1 - 3.0, I2 - 3.0)
    # f_i, g_i: dI1/d ln lam_i and dI2/d ln lam_i without their means; their own slopes are 2 f and -2 g before that.
    for i in range(3):
        fi = 2.0 * (beta[i] - I1 / 3.0)
        di = 4.0 * (W1 * beta[i] + W2 / beta[i])
        for j in range(i, 3):
            fj = 2.0 * (beta[j] - I1 / 3.0)
            dj = 4.0 * (W1 * beta[j] + W2 / beta[j])
            slope = 4.0 * (W1 * I1 + W2 * I2) / 9.0 - (di + dj) / 3.0 + W11 * fi * fj
            if W12 != 0.0 or W22 != 0.0:
                gi, gj = -2.0 * (1.0 / beta[i] - I2 / 3.0), -2.0 * (1.0 / beta[j] - I2 / 3.0)
                slope += W12 * (fi * gj + gi * fj) + W22 * gi * gj
            if i == j:
                slope += di
            gamma[i, j] = slope
            gamma[j, i] = slope
    for i in range(3):
        beta[i] = 2.0 * W1 * (beta[i] - I1 / 3.0) - 2.0 * W2 * (1.0 / beta[i] - I2 / 3.0)
    return energy, extension


@nb.njit(cache=True, inline="always")
def principal_stress(law, constants, lam, beta, gamma):
    """Fill beta (3,) [MPa] and gamma (3, 3) [MPa] at lam (3,); return (energy [MPa], extension over its limit)."""
    corrected = law >= CORRECTED
    number, own = law, constants
    if corrected:
        number, own = law - CORRECTED, constants[:-2]
    energy, extension = _of_plain(number, own, lam, beta, gamma)
    if corrected:
        C20, C30 = constants[-2], constants[-1]
        mean = (lam[0] * lam[0] + lam[1] * lam[1] + lam[2] * lam[2]) / 3.0
        x = 3.0 * mean - 3.0
        W1 = x * (2.0 * C20 + 3.0 * x * C30)
        W11 = 2.0 * C20 + 6.0 * x * C30
        energy += x * x * (C20 + x * C30)
        for i in range(3):
            si = lam[i] * lam[i]
            beta[i] += 2.0 * W1 * (si - mean)
            for j in range(3):
                sj = lam[j] * lam[j]
                gamma[i, j] += 4.0 * W11 * (si - mean) * (sj - mean) - 4.0 * W1 * (si + sj - mean) / 3.0
            gamma[i, i] += 4.0 * W1 * si
    return energy, extension
