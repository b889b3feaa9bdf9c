r"""Drucker stability of a law: work is needed for every further isochoric increment of strain.

With e = ln lam and the Kirchhoff stress conjugate to it, an incompressible material is stable where

.. math:: d\tau : de = de^T \frac{\partial^2 W}{\partial e^2} de > 0 \quad \text{for all } de_1 + de_2 + de_3 = 0

(Drucker 1959; Ogden 1997, sec. 6.2; the check that finite-element codes make of a hyperelastic law).
"""

from __future__ import annotations

import numpy as np

from gelforge.mechanics.laws.law import PrincipalLaw

# columns span the plane de_1 + de_2 + de_3 = 0; first: uniaxial extension
PLANE = np.array([[2.0, 0.0], [-1.0, 1.0], [-1.0, -1.0]]) / np.sqrt([6.0, 2.0])


def drucker_margin(law: PrincipalLaw, lam: np.ndarray) -> np.ndarray:
    """Return the smallest stiffness of a constitutive model against isochoric increments.

    It is 2 mu at rest, and negative where the model is unstable (Drucker).

    Parameters
    ----------
    law : PrincipalLaw
        Moduli in MPa.
    lam : numpy.ndarray
        (..., 3) principal stretches; their volume is divided out.

    Returns
    -------
    numpy.ndarray
        (...) [MPa]; NaN beyond the model's limiting stretch.
    """
    lam = np.asarray(lam, dtype=float)
    lam = lam / np.cbrt(lam.prod(axis=-1, keepdims=True))
    has = law.admissible(lam)
    margin = np.full(lam.shape[:-1], np.nan)
    stiffness = PLANE.T @ law.principal_tangent(lam[has]) @ PLANE
    a, b, c = stiffness[..., 0, 0], stiffness[..., 0, 1], stiffness[..., 1, 1]
    margin[has] = (a + c) / 2 - np.hypot((a - c) / 2, b)
    return margin


class UnstableLaw(ValueError):
    """A law that is unstable, or has no stress, within the stretches that it is used at."""


def check_stable(law: PrincipalLaw, smallest: float, largest: float, name: str) -> None:
    """Refuse a law that is not Drucker-stable down to the smallest and up to the largest principal stretch.

    Tried are extension and pure shear up to the largest, and compression (equibiaxial extension) down to the smallest.

    Parameters
    ----------
    law : PrincipalLaw
        Moduli in MPa.
    smallest, largest : float
        Principal stretches [-], at most 1 and at least 1.
    name : str
        Of the material, for the message.

    Raises
    ------
    UnstableLaw
        Names the first stretch at which the law is unstable or has no stress.
    """
    for case, end, exponents in (
        ("extension", largest, (1.0, -0.5, -0.5)),
        ("compression", smallest, (1.0, -0.5, -0.5)),
        ("pure shear", largest, (1.0, 0.0, -1.0)),
    ):
        lam = np.geomspace(1.0, end, 101)
        margin = drucker_margin(law, lam[:, None] ** np.array(exponents))
        bad = ~(margin > 0)
        if bad.any():
            reason = "has no stress" if np.isnan(margin[bad][0]) else "is unstable (Drucker)"
            raise UnstableLaw(
                f"the constitutive model of {name} {reason} in {case} from stretch {lam[np.argmax(bad)]:.3g}; this"
                " indentation may use it up to"
                f" {end:.3g}: press less deep or fit another constitutive model"
            )
