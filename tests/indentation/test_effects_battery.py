"""Every effect of the catalogue: nothing gives the plain forces bit for bit, a little is linear, signs are physical."""

import json
from functools import cache

import numpy as np
import pytest
import specimens

from gelforge.config import study_from
from gelforge.config.basis.variants import merged
from gelforge.indentation.effects.catalogue import CATALOGUE, Place, with_keys
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.simulate import simulate_cell

LAWS = specimens.STUDY_LAWS
# Pressed off every line of symmetry, so that yaw, tilt and gradient change the total force at first order too.
UNDER = Place(*specimens.CORNER, -2.5, 1.2)
# Iterated on: a hundredth of an effect changes forces by 1e-4, and 5 % of that must be seen.
TIGHT = {"solver": {"force_tolerance": 1e-10, "gap_tolerance": 1e-9, "max_iterations": 80}}
SESSION = {"age_days": 10.0, "temperature_C": 33.0}

# The sign of the change of the pressing force -Fz; none: it may go either way.
HARDER, SOFTER = 1, -1
SIGNS = {
    "gel_stiffness": HARDER, "skin_stiffness": HARDER, "compressibility": SOFTER, "elastic_base": SOFTER,
    "ageing": HARDER, "temperature": HARDER, "toe_region": SOFTER, "layer_thickness": SOFTER,
    "wall_stiffness": HARDER, "wall_gap": SOFTER, "wall_side": SOFTER, "delamination": SOFTER, "void": SOFTER,
    "inclusion": HARDER, "indenter_radius": HARDER, "contact_zero": HARDER, "frame_compliance": SOFTER,
    "base_bending": SOFTER, "viscoelastic": HARDER, "mullins": SOFTER, "adhesion": SOFTER,
}  # fmt: skip


def study(**changes):
    plain = specimens.study(**TIGHT)
    circumstances = {"mechanics": {"effects": {"material": {"circumstances": SESSION}}}}
    return study_from(merged(plain.model_dump(mode="json"), merged(circumstances, changes)))


# On these elements all nodes stick at a friction of 0.45, where no law of friction matters, and open nodes are further away
# than adhesion reaches.
SEEN_WITH = {
    "friction_law": {"friction": 0.03},
    "adhesion": {"friction": 0.0, "effects": {"contact": {"adhesion": {"range_mm": 0.5}}}},
}


def study_for(name):
    """Return the study in which an effect is seen."""
    return study(mechanics=SEEN_WITH.get(name, {}))


PRESSED = PlannedCell("place", *specimens.CORNER, (0.5,))
PRESSED_AGAIN = PlannedCell(
    "place", *specimens.CORNER, (0.6, 0.5)
)  # softening is seen after a deeper press only
RELEASED = PlannedCell("place", *specimens.CORNER, (0.5, 0.2), phases=("load", "unload"))


def way(name):
    """Return the presses in which an effect is seen."""
    effect = CATALOGUE[name]
    return PRESSED_AGAIN if effect.history else RELEASED if effect.unloading else PRESSED


def forces(name, amount):
    """Return the total forces (D, 3) [N] with an amount of an effect."""
    return solved(CATALOGUE[name](study_for(name), amount, UNDER).model_dump_json(), way(name))


def plain_forces(name):
    """Return the total forces (D, 3) [N] without effects along the same way."""
    if not CATALOGUE[name].history:
        return solved(study_for(name).model_dump_json(), way(name))
    nothing = {"relative_moduli": [0.0], "times_s": [3.0]}  # a plain body, every press a path of its own
    timed = with_keys(study(), history={"viscoelastic": {"skin": nothing}})
    return solved(timed.model_dump_json(), way(name))


@cache
def solved(text, planned):
    """Return the total forces of a study; two effects with nothing to do may be the same study."""
    cell = simulate_cell(study_from(json.loads(text)), LAWS, planned)
    assert cell.converged, cell.attributes["reason"]
    return cell.arrays["total_force_N"]


# A rigid slab has elements of its own: sums over all elements round in another order.
ROUNDED = {"elastic_base": 1e-9}


@pytest.mark.parametrize("name", CATALOGUE)
def test_nothing_gives_the_plain_forces_bit_for_bit(name):
    np.testing.assert_allclose(forces(name, 0.0), plain_forces(name), rtol=ROUNDED.get(name, 0.0))


@pytest.mark.thorough(but_first=1)  # the sign of each is seen below
@pytest.mark.parametrize("name", [n for n, e in CATALOGUE.items() if not e.binary])
def test_a_little_is_linear(name):
    """1 % and 2 % of a plausible width: the second change is twice the first within 5 %, so nothing jumps at zero."""
    width = CATALOGUE[name].width
    first, second = (forces(name, share * width) - forces(name, 0.0) for share in (0.01, 0.02))
    assert np.linalg.norm(first) > 1e-6 * np.linalg.norm(forces(name, 0.0))  # it does something
    assert np.linalg.norm(second - 2 * first) < 0.05 * np.linalg.norm(2 * first)


@pytest.mark.parametrize(
    "name",
    [
        # what relaxes takes longest, and test_effects_history.py follows its force
        pytest.param(n, marks=[pytest.mark.thorough] if n == "viscoelastic" else [])
        for n in SIGNS
        if n in CATALOGUE
    ],
)
def test_its_sign_is_the_physical_one(name):
    change = forces(name, 0.01 * CATALOGUE[name].width) - forces(name, 0.0)
    assert np.sign(-change[-1, 2]) == SIGNS[name]


# --------------------------------------------------------------------- settings that no effect of the catalogue names
OTHERS = {
    "particle stiffening": lambda amount: with_keys(study(), material={"particles": {"stiffening": amount}}),
    "adhesion on the approach": lambda amount: with_keys(
        study(), contact={"adhesion": {"approach_N_per_mm": 1e-4 * amount, "range_mm": 0.2}}
    ),
}


def without(name):
    """Return the study described otherwise, without what the setting acts on: particles, or any keys of adhesion."""
    if name != "particle stiffening":
        return study()
    layers = [layer.model_dump(mode="json") for layer in study().sensor.layers]
    layers[0]["particle_volume_fraction"] = 0.0
    return study(sensor={"layers": layers})


@pytest.mark.parametrize("name", OTHERS)
def test_none_of_an_unnamed_setting_gives_the_plain_forces_bit_for_bit(name):
    none = solved(OTHERS[name](0.0).model_dump_json(), PRESSED)
    assert np.array_equal(none, solved(without(name).model_dump_json(), PRESSED))


@pytest.mark.parametrize(("name", "sign"), [*zip(OTHERS, (HARDER, SOFTER))])
def test_a_little_of_an_unnamed_setting_is_linear(name, sign):
    """As above; what draws a surface to the ball presses less hard at a depth."""
    none, first, second = (
        solved(OTHERS[name](amount).model_dump_json(), PRESSED) for amount in (0, 0.01, 0.02)
    )
    assert np.linalg.norm(second - none - 2 * (first - none)) < 0.05 * np.linalg.norm(2 * (first - none))
    assert np.sign(none - first)[-1, 2] == sign
