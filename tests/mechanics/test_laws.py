"""One battery for every law: a new one enters by one line in LAWS and one closed form."""

import re
from dataclasses import asdict

import closed_forms
import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.mechanics.laws.corrected import Corrected
from gelforge.mechanics.laws.homogeneous import LOAD_CASES, cauchy_stress, nominal_stress, principal_stretches
from gelforge.mechanics.laws.models.gent import Gent
from gelforge.mechanics.laws.models.mooney_rivlin import MooneyRivlin
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.laws.models.yeoh import Yeoh

LAWS = {
    "ecoflex_gel": Ogden((7.9652e-3, 0.3093e-3), (1.2769, 3.5676)),
    "elastosil_25_1": Ogden((85.1168e-3, -0.0020e-3), (2.8991, -8.2915)),
    "ogden_of_neo_hooke": Ogden((0.1,), (2.0,)),
    "three_terms": Ogden((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0)),  # Ogden 1972, fitted to Treloar's rubber
    "neo_hooke": NeoHooke(0.1),
    "mooney_rivlin": MooneyRivlin(0.08, 0.02),
    "yeoh": Yeoh(0.05, -1e-3, 5e-5),  # S-shaped, as filled rubber is
    "gent": Gent(0.1, 60.0),
    "corrected": Corrected(NeoHooke(0.1), -1e-3, 5e-5),
}
rng = np.random.default_rng(1)


def rotations(count):
    Q, R = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    Q = Q * np.sign(np.einsum("nii->ni", R))[:, None, :]
    Q[np.linalg.det(Q) < 0, :, 0] *= -1
    return Q


def stretched(lam):
    """Return deformation gradients with the principal stretches lam (n, 3) in random frames."""
    n = len(lam)
    return np.einsum("nia,na,nja->nij", rotations(n), np.asarray(lam, float), rotations(n))


# distinct, two and three equal, nearly equal at every distance down to rounding, with and without a change of
# volume
NEAR = [(1.3, 1.3 * (1 + d), 0.7) for d in 10.0 ** -np.arange(2.0, 16.0)]
STATES = {
    "distinct": stretched(np.exp(0.4 * rng.normal(size=(20, 3)))),
    "two equal": stretched([(1.4, 1.4, 0.6), (0.8, 0.8, 1.7), (1.0, 1.0, 2.0)]),
    "three equal": stretched([(1.0, 1.0, 1.0), (1.2, 1.2, 1.2), (0.7, 0.7, 0.7)]),
    "nearly equal": stretched(NEAR),
    "identity": np.eye(3)[None],
}
battery = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
states = pytest.mark.parametrize("F", STATES.values(), ids=STATES.keys())


def remainder_rates(remainder, steps=(2e-2, 1e-2, 5e-3)):
    """Return log2 of the ratios of Taylor remainders (points,) of halved steps."""
    r = np.array([remainder(h) for h in steps])
    return np.log2(r[:-1] / r[1:])


@battery
@states
def test_stress_and_tangent_are_derivatives(law, F):
    D = rng.normal(size=F.shape) / 3
    slope = (law.nominal_stress(F) * D).sum(axis=(-2, -1))
    rates = remainder_rates(lambda h: np.abs(law.energy(F + h * D) - law.energy(F) - h * slope).max())
    # remainder of a correct first derivative: O(h^2), rate 2 + O(h); a wrong one has rate 1
    assert_allclose(rates, 2, atol=0.2)

    # Tangent is the derivative of the nominal stress
    slope = np.einsum("...ijkl,...kl->...ij", law.tangent(F), D)
    rates = remainder_rates(
        lambda h: np.abs(law.nominal_stress(F + h * D) - law.nominal_stress(F) - h * slope).max()
    )
    assert_allclose(rates, 2, atol=0.2)


@battery
def test_tangent_does_not_lose_digits_between_close_stretches(law):
    """The tangent is smooth in F: over a step d it changes by a bounded slope times d, plus rounding."""
    frames = rotations(2)
    distance = 10.0 ** -np.arange(3.0, 17.0)
    close = np.array([frames[0] @ np.diag([1.3, 1.3 * (1 + d), 0.7]) @ frames[1] for d in distance])
    equal = frames[0] @ np.diag([1.3, 1.3, 0.7]) @ frames[1]
    A = law.tangent(equal)
    change = np.abs(law.tangent(close) - A).max(axis=(-4, -3, -2, -1)) / np.abs(A).max()
    # slope: alpha up to 8 gives d A / A of some ten d; rounding: thirty products of order one
    assert (change <= 50 * distance + 1e-13).all()


@battery
@states
def test_tangent_and_kirchhoff_stress_are_symmetric(law, F):
    A = law.tangent(F)
    assert_allclose(
        A, np.einsum("...ijkl->...klij", A), atol=1e-14 * np.abs(A).max()
    )  # rounding of the rotations

    # Kirchhoff stress is symmetric traceless and blind to volume
    tau = law.kirchhoff_stress(F)
    atol = 1e-12 * max(law.shear_modulus, np.abs(tau).max())  # rounding
    assert_allclose(tau, law.nominal_stress(F) @ np.swapaxes(F, -1, -2), atol=atol)
    assert_allclose(tau, np.swapaxes(tau, -1, -2), atol=atol)
    assert_allclose(np.trace(tau, axis1=-2, axis2=-1), 0, atol=atol)
    assert_allclose(law.kirchhoff_stress(1.3 * F), tau, atol=atol)


@battery
@states
def test_objectivity_and_isotropy(law, F):
    Q = rotations(len(F))
    scale = law.shear_modulus
    assert_allclose(
        law.energy(Q @ F), law.energy(F), rtol=1e-12, atol=1e-14 * scale
    )  # rounding of Q and the SVD
    assert_allclose(law.nominal_stress(Q @ F), Q @ law.nominal_stress(F), rtol=1e-11, atol=1e-13 * scale)
    rotated = np.einsum("nia,nkc,najcl->nijkl", Q, Q, law.tangent(F))
    assert_allclose(law.tangent(Q @ F), rotated, rtol=1e-9, atol=1e-12 * np.abs(rotated).max())

    # Isotropy
    assert_allclose(law.energy(F @ Q), law.energy(F), rtol=1e-12, atol=1e-14 * scale)
    assert_allclose(law.nominal_stress(F @ Q), law.nominal_stress(F) @ Q, rtol=1e-11, atol=1e-13 * scale)


@battery
def test_small_strains_and_simple_shear_have_their_closed_forms(law):
    # Small strain limit. tau = 2 mu dev(eps) + O(eps^2), and the tangent at rest is that of deviatoric linear
    # elasticity
    H = rng.normal(size=(3, 3))
    eps = (H + H.T) / 2
    dev = eps - np.trace(eps) / 3 * np.eye(3)
    linear = 2 * law.shear_modulus * dev
    rates = remainder_rates(
        lambda h: np.abs(law.kirchhoff_stress(np.eye(3) + h * H) - h * linear).max(), (4e-3, 2e-3, 1e-3)
    )
    assert_allclose(rates, 2, atol=0.1)
    delta = np.eye(3)
    A = law.shear_modulus * (
        np.einsum("ik,jl->ijkl", delta, delta)
        + np.einsum("il,jk->ijkl", delta, delta)
        - 2 / 3 * np.einsum("ij,kl->ijkl", delta, delta)
    )
    assert_allclose(law.tangent(np.eye(3)), A, atol=1e-14 * law.shear_modulus)  # exact but for rounding
    assert law.youngs_modulus == pytest.approx(3 * law.shear_modulus, rel=1e-15)

    # Simple shear
    for gamma in (1e-3, 0.5, 2.0):
        tau = law.kirchhoff_stress(np.eye(3) + gamma * np.outer([1, 0, 0], [0, 1, 0]))
        # the small shear cancels three digits
        assert tau[0, 1] == pytest.approx(closed_form(law, "simple_shear", gamma), rel=1e-10)


def closed_form(law, case, lam):
    if isinstance(law, Corrected):  # of neo-Hooke's model: Yeoh's
        law = Yeoh(law.law.shear_modulus / 2, law.C20, law.C30)
    name = re.sub(r"(?<!^)(?=[A-Z])", "_", type(law).__name__).lower()
    return getattr(closed_forms, name)(case, lam, **asdict(law))


@battery
@pytest.mark.parametrize("case", LOAD_CASES)
def test_homogeneous_stress_is_the_closed_form_in_one_and_three_dimensions(law, case):
    lam = np.linspace(0.6, 3, 25).reshape(5, 5)
    expected = closed_form(law, case, lam)
    atol = 1e-14 * np.abs(expected).max()  # cancellation near lam = 1
    assert_allclose(nominal_stress(law, case, lam), expected, rtol=1e-12, atol=atol)
    assert_allclose(cauchy_stress(law, case, lam), lam * expected, rtol=1e-12, atol=3 * atol)

    # Tau_1 - tau_3 is free of the pressure, so it is the Cauchy stress of the incompressible sheet.
    lam = np.linspace(0.7, 2.5, 10)
    F = np.einsum("ni,ij->nij", principal_stretches(case, lam), np.eye(3))
    tau = law.kirchhoff_stress(F)
    expected = lam * closed_form(law, case, lam)
    assert_allclose(tau[:, 0, 0] - tau[:, 2, 2], expected, rtol=1e-11, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["neo_hooke", "ogden_of_neo_hooke"])
def test_neo_hooke_is_the_law_of_invariants(name):
    for F in STATES["distinct"]:
        expected = closed_forms.neo_hooke_energy(0.1, F.tolist())
        assert LAWS[name].energy(F) == pytest.approx(expected, rel=1e-12)


def test_published_moduli_and_mooney_rivlin_as_ogdens_law():
    # Mooney rivlin is ogdens law with exponents two and minus two
    law, twin = LAWS["mooney_rivlin"], Ogden((0.16, -0.04), (2.0, -2.0))
    F = STATES["distinct"]
    assert_allclose(law.nominal_stress(F), twin.nominal_stress(F), rtol=1e-12, atol=1e-14)
    assert_allclose(law.tangent(F), twin.tangent(F), rtol=1e-10, atol=1e-12)

    # Published youngs moduli. Sferrazza et al. 2019, sec. II-E: 16.9 kPa and 370.2 kPa, to the digits printed
    assert LAWS["ecoflex_gel"].youngs_modulus * 1e3 == pytest.approx(16.9, abs=0.05)
    assert LAWS["elastosil_25_1"].youngs_modulus * 1e3 == pytest.approx(370.2, abs=0.05)


def test_points_and_corrections_without_a_meaning_are_refused():
    lam = np.array([[3.0, 3**-0.5, 3**-0.5], [4.0, 0.5, 0.5]])  # I1 - 3 = 6.67 and 13.5
    law = Gent(0.1, 10.0)
    assert law.admissible(lam).tolist() == [True, False]
    with pytest.raises(ValueError, match=r"I_1 - 3 = 13.5, the chains' limit is Jm = 10"):
        law.principal_stress(lam)

    # An inverted point is refused
    F = np.stack([np.eye(3), np.diag([1.0, 1.0, -0.5])])
    with pytest.raises(ValueError, match=r"det F = -0.5 at the worst of 2 points"):
        LAWS["ecoflex_gel"].nominal_stress(F)

    # Only a law without a correction is corrected
    law = Corrected(NeoHooke(0.1), 0.01, 0.0)
    assert law.description()["C20_correction_MPa"] == 0.01 and law.shear_modulus == 0.1
    with pytest.raises(ValueError, match="law without a correction"):
        Corrected(law, 0.01, 0.0)
    with pytest.raises(ValueError, match="finite numbers"):
        Corrected(NeoHooke(0.1), np.nan, 0.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: NeoHooke(-0.1), "Neo-Hooke: mu is -0.1; > 0"),
        (lambda: MooneyRivlin(0.1, -0.2), "Mooney-Rivlin: C01 is -0.2; >= 0"),
        (lambda: Yeoh(0.1, float("nan"), 0.0), "Yeoh: C20 is nan"),
        (lambda: Yeoh(0.1, 0.0, float("inf")), "Yeoh: C30 is inf"),
        (lambda: Yeoh(-0.1, 0.0, 0.1), "Yeoh: C10 is -0.1"),
        (lambda: Gent(0.1, 0.0), "Gent: Jm is 0"),
    ],
)
def test_constants_without_a_meaning_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("mu", "alpha", "message"),
    [
        ((1.0,), (-2.0,), "mu_1 1.0 MPa and alpha_1 -2.0"),
        ((1.0, 0.0), (2.0, 3.0), "mu_2 0.0"),
        ((1.0, float("nan")), (2.0, 3.0), "mu_2 nan"),
        ((1.0,), (2.0, 3.0), "1 mu but 2 alpha"),
        ((), (), "at least one"),
    ],
)
def test_parameters_without_a_meaning_are_refused(mu, alpha, message):
    with pytest.raises(ValueError, match=message):
        Ogden(mu, alpha)
