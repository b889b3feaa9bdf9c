"""Derivatives by direct differentiation against neighbouring presses, differences of full solutions, and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import specimens
from neighbouring_presses import Neighbour, follow_beside
from numpy.testing import assert_allclose
from test_sensitivities import AMOUNT, PARAMETERS, binned, model, nodal

from gelforge.mechanics.bodies.body import Body, SmallStrainBody
from gelforge.mechanics.sensitivities.direct import Varied, follow_with_slopes
from gelforge.mechanics.solving.equilibrium import NotConverged, Press

LITTLE = 1e-4  # next to which few nodes change between open, stick and slip: there differences jump, derivatives do not
SHEAR = np.array([[0.0, 0.0, -0.4], [0.0, 0.0, -0.8], [0.1, 0.0, -0.8], [0.25, 0.05, -0.8], [0.1, 0.0, -0.7]])
TURNED = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.02, 0.01, 0.02], [0.0, 0.01, 0.05]])


def sheared(path=SHEAR, **factors):
    """Return a model that is pressed and then dragged until most nodes slip, and back."""
    body, ball, settings, start, centres = model(**factors)
    deeper = centres[0] - model()[4][0]  # by which its parameter moves the path
    path = start + path + deeper if path.shape[1] == 3 else np.pad(start + deeper, (0, 3)) + path
    return body, ball, settings, start, path


def along(base, varied, amount=AMOUNT):
    """Return the base's states and the derivatives (D, P, S, 3) of nodal forces and (D, P, N, 3) of displacements."""
    body, ball, settings, start, centres = base
    press = Press(body, ball, settings)
    found = [
        (state, slopes.force, slopes.u)
        for state, slopes in follow_with_slopes(
            press, press.start_at(start), centres, [Varied(*one, amount) for one in varied]
        )
    ]
    states, force, u = zip(*found)
    return states, np.array(force), np.array(u)


def neighbours(base, varied, amount=AMOUNT):
    """The same by a press of its own next to the base for each parameter."""
    body, ball, settings, start, centres = base
    press = Press(body, ball, settings)
    near = [Neighbour(press, *one) for one in varied]
    force, u = [], []
    for state, states in follow_beside(press, press.start_at(start), centres, near):
        force.append([(nodal(one) - nodal(state)) / amount for one in states])
        u.append([(one.u - state.u) / amount for one in states])
    return np.array(force), np.array(u)


def assert_alike(found, expected, bins, share=1.0):
    """Totals to 2 %, bins to 5 % of the largest derivative: what users of the derivatives are promised; or a share of it."""
    for own, other in zip(np.moveaxis(found, 1, 0), np.moveaxis(expected, 1, 0)):
        total, size = other.sum(axis=1), np.linalg.norm(other.sum(axis=1), axis=1).max()
        assert_allclose(own.sum(axis=1), total, atol=0.02 * share * size, rtol=0)
        assert_allclose(bins(own), bins(other), atol=0.05 * share * np.abs(bins(other)).max(), rtol=0)


def test_they_are_those_of_neighbouring_presses_and_of_what_the_base_has_reached():
    # They are those of neighbouring presses. Ten times closer than promised, but for the node that joins the
    # contact of a neighbour at the deepest step
    varied = [vary(AMOUNT) for vary in PARAMETERS.values()]
    _, force, u = along(model(), varied)
    expected, u_expected = neighbours(model(), varied)
    bins = binned(model()[0])
    assert_alike(force, expected, bins)
    assert_alike(force[:3], expected[:3], bins, 0.1)
    for own, other in zip(np.moveaxis(u, 1, 0), np.moveaxis(u_expected, 1, 0)):
        assert_allclose(own, other, atol=0.02 * np.abs(other).max(), rtol=0)

    # Of forces only the same is found. Along a path on which nodes come into contact, slip and leave it
    body, ball, settings, start, centres = sheared()
    press = Press(body, ball, settings)
    varied = [Varied(*sheared(**{name: 1 + LITTLE}), LITTLE) for name in ("skin", "friction")]
    both = [
        [
            slopes
            for _, slopes in follow_with_slopes(press, press.start_at(start), centres, varied, None, only)
        ]
        for only in (False, True)
    ]
    force, alone = (np.array([slopes.force for slopes in one]) for one in both)
    assert_allclose(alone, force, atol=1e-8 * np.abs(force).max(), rtol=0)
    assert both[1][0].u.shape == (2, 0, 3)

    # A base that ends early yields what it has reached
    body, ball, settings, start, centres = model()
    press = Press(body, ball, replace(settings, max_halvings=0))
    too_deep = np.vstack([centres[:2], centres[1:2] - [0.0, 0.0, 50.0]])
    steps = follow_with_slopes(press, press.start_at(start), too_deep, [])
    assert [state.centre[2] for state, _ in (next(steps), next(steps))] == too_deep[:2, 2].tolist()
    with pytest.raises(NotConverged):
        next(steps)


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize("path", [np.hstack([SHEAR, TURNED]), SHEAR], ids=["sheared and turned", "sheared"])
def test_history_of_stick_and_slip_is_carried_along(path):
    """Against central differences of full solutions along a path on which nodes stick, slip, and stick again."""
    names = {"skin modulus": "skin", "friction": "friction", "ball radius": "radius"}
    varied = [sheared(path, **{key: 1 + LITTLE}) for key in names.values()]
    varied.append(sheared(path, deeper=LITTLE))
    states, force, _ = along(sheared(path), varied, LITTLE)
    kinds = {int(kind) for state in states for kind in state.contact_state}
    assert kinds == {0, 1, 2}
    less = [sheared(path, **{key: 1 - LITTLE}) for key in names.values()] + [sheared(path, deeper=-LITTLE)]
    expected = np.stack([central(one, other, LITTLE) for one, other in zip(varied, less)], axis=1)
    assert_alike(force, expected, binned(model()[0]))


def central(more, less, amount=AMOUNT):
    """Return the difference (D, S, 3) of nodal forces of two solutions over twice an amount."""
    ends = []
    for body, ball, settings, start, centres in (more, less):
        press = Press(body, ball, settings)
        ends.append(np.array([nodal(state) for state in press.follow(press.start_at(start), centres)]))
    return (ends[0] - ends[1]) / (2 * amount)


def stiffer(base, factor):
    """Return the base's model with factors (E,) on the moduli, and on the bulk moduli."""
    body, *rest = base
    return type(body)(body.mesh, body.laws, 1000.0, stiffness=factor), *rest


@pytest.mark.parametrize("kind", [Body, SmallStrainBody])
def test_force_grows_with_all_moduli_in_proportion(kind):
    """A common factor of all moduli leaves displacements alone: d F / d ln factor = F; boxes sum to the whole."""
    body, *rest = model()
    base = kind(body.mesh, body.laws, 1000.0), *rest
    E = len(body.mesh.elements)
    box = np.arange(E) % 3
    factors = [np.full(E, 1 + AMOUNT), *(1 + AMOUNT * (box == k) for k in range(3))]
    states, force, u = along(base, [stiffer(base, factor) for factor in factors])
    own = np.array([nodal(state) for state in states])
    size = np.abs(own).max()
    # The base is solved to 1e-9 of its forces; the bulk's compliance is taken for its modulus, which differs by AMOUNT.
    assert_allclose(force[:, 0], own, atol=2 * AMOUNT * size, rtol=0)
    # How the displacements of the step before enter is a difference, too.
    assert_allclose(force[:, 1:].sum(axis=1), force[:, 0], atol=0.1 * AMOUNT * size, rtol=0)
    assert np.abs(u[:, 0]).max() < 2 * AMOUNT * np.abs(states[-1].u).max()


def test_tetrahedra_hold_part_of_their_bulk_modulus_and_other_elements_are_refused():
    # Tetrahedra hold part of their bulk modulus at every point. Against neighbours, with factors on some elements
    # and with another law
    _, ball, settings, *_ = model()
    mesh = specimens.tetrahedral(
        specimens.layered_block(replace(specimens.BLOCK, wall=0.0), 8.0, 8.0, COARSE)
    )
    laws = {name: specimens.LAWS[name] for name in mesh.regions}
    start = ball.start(8.0, 8.0)
    path = start + np.outer([0.3, 0.6], [0.0, 0.0, -1.0])
    base = Body(mesh, laws, 100.0), ball, settings, start, path
    low = mesh.X[mesh.elements, 2].mean(axis=1) < -1.0
    softer = Body(mesh, laws, 100.0, stiffness=1 + AMOUNT * low), *base[1:]
    g = specimens.GEL
    bent = replace(g, alpha=(g.alpha[0] * (1 + AMOUNT), g.alpha[1]))
    varied = [softer, (Body(mesh, laws | {"gel": bent}, 100.0), *base[1:])]
    _, force, _ = along(base, varied)
    expected, _ = neighbours(base, varied)
    assert_alike(force, expected, lambda forces: forces, 0.1)

    # Other elements or bodies are refused
    other = model(block=replace(specimens.BLOCK, layers=(("gel", 6.0), ("skin", 1.0))))
    with pytest.raises(ValueError, match="other elements"):
        along(model(), [other])

    # Another kind of body is refused
    body, *rest = model()
    linear = SmallStrainBody(body.mesh, body.laws, 1000.0)
    with pytest.raises(ValueError, match="subtract two solutions"):
        along((body, *rest), [(linear, *rest)])


COARSE = specimens.Sizes(near=2.0, near_radius=2.5, growth=0.3, far=2.0)


@pytest.mark.parametrize(
    "settings",
    [
        {"film_thickness": 0.3, "film_pressure": 0.1},
        {"friction_exponents": (0.3, 0.2), "friction_pressures": (0.01, 0.03)},
        {"adhesion_work": 2e-4, "adhesion_approach": 2e-4, "adhesion_range": 0.2},
    ],
    ids=["film", "friction that falls with the pressure", "adhesion"],
)
def test_a_base_with_effects_of_the_contact(settings):
    """Film, adhesion and their own amounts, of a base that has them already, pressed and released."""
    path = np.array([[0.0, 0.0, -0.4], [0.0, 0.0, -0.8], [0.05, 0.0, -0.6], [0.05, 0.0, -0.3]])
    name, value = next(iter(settings.items()))

    def with_effect(**changed):
        body, ball, own, start, centres = sheared(path)
        return body, ball, replace(own, **(settings | changed)), start, centres

    less, more = (with_effect(**{name: grown(value, 1 + sign * AMOUNT)}) for sign in (-1, 1))
    soft = sheared(path, skin=1 + AMOUNT)
    soft = *soft[:2], with_effect()[2], *soft[3:]
    stiff = sheared(path, skin=1 - AMOUNT)
    stiff = *stiff[:2], with_effect()[2], *stiff[3:]
    _, force, _ = along(with_effect(), [more, soft])
    expected = np.stack([central(more, less), central(soft, stiff)], axis=1)
    assert_alike(force, expected, binned(model()[0]))


def grown(value, factor):
    """Return a setting times a factor, each of several."""
    return tuple(factor * one for one in value) if isinstance(value, tuple) else factor * value


def test_without_mkl_they_are_the_same():
    varied = [PARAMETERS["friction"](AMOUNT), PARAMETERS["thickness"](AMOUNT)]
    found = {}
    for solver in ("auto", "superlu"):
        body, ball, settings, start, centres = model()
        press = Press(body, ball, settings, solver)
        steps = follow_with_slopes(
            press, press.start_at(start), centres[:2], [Varied(*v[:4], v[4][:2], AMOUNT) for v in varied]
        )
        found[solver] = np.array([slopes.force for _, slopes in steps])
    assert_allclose(
        found["superlu"], found["auto"], atol=1e-4 * np.abs(found["auto"]).max(), rtol=0
    )  # of the base's own tolerance
