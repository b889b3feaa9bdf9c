r"""Homogeneous deformations of an incompressible body: the three load cases of a material test.

With the pressure eliminated by the stress-free thickness direction 3, the Cauchy stress in the loading
direction is

.. math:: \sigma_1 = \beta_1 - \beta_3, \qquad \beta_i = \lambda_i \partial W / \partial\lambda_i,

and the nominal stress sigma_1 / lam_1 (Ogden 1997, sec. 7.2; Sferrazza et al. 2019, eq. 2).
"""

from __future__ import annotations

import numpy as np

from gelforge.mechanics.laws import PrincipalLaw

# exponents of lam in (lam_1, lam_2, lam_3)
LOAD_CASES = {
    "uniaxial": (1.0, -0.5, -0.5),
    "pure_shear": (1.0, 0.0, -1.0),
    "equibiaxial": (1.0, 1.0, -2.0),
}


def principal_stretches(case: str, lam: np.ndarray) -> np.ndarray:
    """Return the principal stretches (..., 3) of a load case at the stretch lam (...), volume preserved."""
    return np.asarray(lam, dtype=float)[..., None] ** np.array(LOAD_CASES[case])


def cauchy_stress(law: PrincipalLaw, case: str, lam: np.ndarray) -> np.ndarray:
    """Return the Cauchy stress [MPa] in the loading direction at the stretch lam, any shape."""
    beta = law.principal_stress(principal_stretches(case, lam))
    return beta[..., 0] - beta[..., 2]


def nominal_stress(law: PrincipalLaw, case: str, lam: np.ndarray) -> np.ndarray:
    """Return the nominal stress [MPa], force over undeformed area, in the loading direction, any shape."""
    return cauchy_stress(law, case, lam) / np.asarray(lam, dtype=float)
