"""Stress from what is measured, for the load cases of a material test; conditions where a formula needs one.

Sferrazza et al. 2019, sec. II-C: tension F lam_1 / (w0 h0); membrane inflation p r / (2 h0 lam_3) at the apex.
"""

from __future__ import annotations

import numpy as np

from gelforge.materials.basis.common_form import LOAD_CASE_OF
from gelforge.mechanics.laws.homogeneous import stress_points
from gelforge.mechanics.laws.models.ogden import ogden_terms

# Less does not distinguish a law from a straight line: the stress of a neo-Hookean strip (Treloar 1943) departs from one by
# the strain itself, there 2 %.
LEAST_STRAIN = 0.02
# The membrane formula needs h0 << r: bending is then below (h0 / r)^2 = 1 % (Timoshenko and Woinowsky-Krieger 1959).
LEAST_RADIUS_TO_THICKNESS = 10.0


def nominal_from_force(force_N, cross_section_mm2: float):
    """Return the nominal stress [MPa], force over undeformed area: tension, compression, pure and simple shear."""
    return force_N / cross_section_mm2


def nominal_from_cauchy(cauchy_stress, stretch):
    """Return the nominal stress sigma_1 / lam_1 of an incompressible sample, in the unit of the Cauchy stress."""
    return cauchy_stress / stretch


def membrane_cauchy(pressure_MPa, apex_radius_mm, thickness_mm: float, stretch_1, stretch_2):
    """Return the Cauchy stress p r / (2 h0 lam_3) [MPa] at the apex, lam_3 = 1 / (lam_1 lam_2)."""
    return pressure_MPa * apex_radius_mm * stretch_1 * stretch_2 / (2 * thickness_mm)


def too_thick(apex_radius_mm: np.ndarray, thickness_mm: float) -> int | None:
    """Return the first row where the membrane is not thin against its radius of curvature, None if none is."""
    rows = np.flatnonzero(apex_radius_mm < LEAST_RADIUS_TO_THICKNESS * thickness_mm)
    return int(rows[0]) if len(rows) else None


def neo_hookean_shape(test: str, stretch, stretch_2=None):
    """Return the nominal stress [MPa] of a neo-Hookean solid of shear modulus 1 MPa.

    For a biaxial test the stress along the first direction; in simple shear the amount of shear itself.
    """
    lam = np.asarray(stretch, dtype=float)
    if test == "simple_shear":
        return lam
    if test == "biaxial":
        return lam - 1 / (lam**3 * stretch_2**2)
    return lam - lam ** {"uniaxial": -2, "compression": -2, "pure_shear": -3, "equibiaxial": -5}[test]


def ogden_shape(test: str, stretch, exponent: float):
    """Return the nominal stress [MPa] of an Ogden solid of one term and initial shear modulus 1 MPa; at 2 neo-Hookean."""
    points = stress_points(LOAD_CASE_OF[test], stretch)
    return 2 * ogden_terms(points, np.array([exponent]))[0][:, 0]
