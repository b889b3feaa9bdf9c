r"""Homogeneous deformations of an incompressible body: what a material test measures, computed from a law.

With the pressure eliminated by a direction whose stress is known to be zero, every test measures

.. math:: s (\beta_1 - \beta_3), \qquad \beta_i = \lambda_i \partial W / \partial\lambda_i,

with axis 1 the measured direction and axis 3 the one that fixes the pressure. beta_1 - beta_3 is the Cauchy stress
in direction 1, and s = 1 / lam_1 makes it nominal (Ogden 1997, sec. 7.2; Sferrazza et al. 2019, eq. 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gelforge.mechanics.laws.law import PrincipalLaw

# Exponents of lam in (lam_1, lam_2, lam_3), volume preserved (Ogden 1997, sec. 7.2).
LOAD_CASES = {"uniaxial": (1.0, -0.5, -0.5), "pure_shear": (1.0, 0.0, -1.0), "equibiaxial": (1.0, 1.0, -2.0)}


@dataclass(frozen=True)
class StressPoints:
    """Measured states: lam (n, 3) as (measured axis, other axis, axis that fixes the pressure), scale s (n,)."""

    lam: np.ndarray
    scale: np.ndarray

    @cached_property
    def logarithms(self) -> np.ndarray:
        """Return ln lam (n, 3)."""
        return np.log(self.lam)

    @cached_property
    def I1(self) -> np.ndarray:
        """Return the first invariant (n,)."""
        return (self.lam**2).sum(axis=-1)

    def measured_stress(self, law: PrincipalLaw) -> np.ndarray:
        """Return the nominal stress (n,) [MPa] of a law, NaN beyond the law's limiting stretch."""
        stress = np.full(len(self.lam), np.nan)
        has = law.admissible(self.lam)
        beta = law.principal_stress(self.lam[has])
        stress[has] = self.scale[has] * (beta[:, 0] - beta[:, 2])
        return stress


def stress_points(
    case: str, stretch: np.ndarray, stretch_2: np.ndarray | None = None, component: str = "1"
) -> StressPoints:
    """Return the states of a test, in which a law predicts the measured stress.

    Parameters
    ----------
    case : str
        One of LOAD_CASES, "biaxial" or "simple_shear".
    stretch : (n,) array
        Along the load [-]; in simple shear the amount of shear gamma.
    stretch_2 : (n,) array, optional
        Across it, in a biaxial test.
    component : str
        "1": the nominal stress along the load (in simple shear the shear stress); "2": that across it; "1-2": the difference
        of the Cauchy stresses divided by lam_1.

    Returns
    -------
    StressPoints
        n states.

    Raises
    ------
    ValueError
        A biaxial test without stretch_2.
    """
    stretch = np.asarray(stretch, dtype=float)
    if case == "simple_shear":
        # principal stretches l and 1/l with l - 1/l = gamma; sigma_12 = dW/dgamma = (beta_1 - beta_3) / (l + 1/l)
        l = (stretch + np.sqrt(stretch**2 + 4)) / 2
        return StressPoints(np.column_stack([l, np.ones_like(l), 1 / l]), 1 / (l + 1 / l))
    if case == "biaxial":
        if stretch_2 is None:
            raise ValueError("a biaxial test has two stretches; give stretch_2")
        lam = np.column_stack([stretch, stretch_2, 1 / (stretch * stretch_2)])
    else:
        lam = principal_stretches(case, stretch)
    lam = lam[:, {"1": [0, 1, 2], "2": [1, 0, 2], "1-2": [0, 2, 1]}[component]]
    return StressPoints(lam, 1 / lam[:, 0])


def principal_stretches(case: str, lam: np.ndarray) -> np.ndarray:
    """Return the principal stretches of a load case, volume preserved.

    Parameters
    ----------
    case : str
        One of LOAD_CASES.
    lam : array
        Stretch (...) along the load [-].

    Returns
    -------
    numpy.ndarray
        (..., 3) [-].

    Examples
    --------
    >>> principal_stretches("equibiaxial", 2.0)
    array([2.  , 2.  , 0.25])
    """
    return np.asarray(lam, dtype=float)[..., None] ** np.array(LOAD_CASES[case])


def cauchy_stress(law: PrincipalLaw, case: str, lam: np.ndarray) -> np.ndarray:
    """Return the Cauchy stress in the loading direction.

    Parameters
    ----------
    law : PrincipalLaw
        Moduli in MPa.
    case : str
        One of LOAD_CASES.
    lam : numpy.ndarray
        Stretch (...) along the load [-].

    Returns
    -------
    numpy.ndarray
        (...) [MPa].
    """
    beta = law.principal_stress(principal_stretches(case, lam))
    return beta[..., 0] - beta[..., 2]


def nominal_stress(law: PrincipalLaw, case: str, lam: np.ndarray) -> np.ndarray:
    """Return the nominal stress [MPa], force over undeformed area, in the loading direction, any shape."""
    return cauchy_stress(law, case, lam) / np.asarray(lam, dtype=float)
