"""One pressed block in FElupe, an independent code with the same element: same mesh, laws and K/mu = 1000."""

from dataclasses import replace

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block
from gelforge.mechanics.solving.equilibrium import Press

pytest.importorskip("felupe", reason="FElupe is not installed: pip install -e .[verification]")
pytest.importorskip("tensortrax", reason="tensortrax is not installed: pip install -e .[verification]")
import felupe_model  # benchmarks/felupe_model.py

OGDEN = {"gel": specimens.GEL, "skin": specimens.SKIN}
NEO_HOOKE = {name: Ogden((law.shear_modulus,), (2.0,)) for name, law in OGDEN.items()}
POSITION = (6.0, 6.0)
BULK_TO_SHEAR = 1000.0
# FElupe's neo-Hooke is written by hand: rounding of K (J - 1). Its Ogden is differentiated automatically and moves equal
# stretches apart by 1e-7 to do so; that is what differs there, 1e-8 of 1 mm and 1e-7 of the largest nodal force.
CASES = {"neo-Hooke": (NEO_HOOKE, 1e-11), "Ogden": (OGDEN, 1e-7)}


def mesh():
    return layered_block(
        Block(12.0, 12.0, (("gel", 3.0), ("skin", 1.0))), *POSITION, Sizes(near=1.0, far=1.0)
    )


@pytest.fixture(scope="module", params=CASES.values(), ids=CASES.keys())
def pressed(request):
    """Return laws, limit, press and the state at 1 mm, with friction, iterated to rounding."""
    laws, limit = request.param
    press = Press(Body(mesh(), laws, BULK_TO_SHEAR), specimens.BALL, specimens.TO_ROUNDING)
    return laws, limit, press, specimens.follow(press, POSITION, [0.25, 0.5, 0.75, 1.0])[-1]


def test_internal_forces_and_held_solutions_agree(pressed):
    laws, limit, press, state = pressed
    theirs = felupe_model.internal_forces(felupe_model.twin(press.body.mesh, laws, BULK_TO_SHEAR), state.u)
    ours = press.body.response(state.u, state.pressure).f_condensed
    assert_allclose(theirs, ours, atol=limit * np.abs(ours).max())

    # The nodes in contact are moved as we moved them; all others, and the forces at those, are
    # FElupe's own finding.
    held = press.body.mesh.fixed.copy()
    held[press.surface[state.contact_state > 0]] = True
    block = felupe_model.twin(press.body.mesh, laws, BULK_TO_SHEAR)
    u, force = felupe_model.solve_held(block, held, state.u)
    contact = np.zeros_like(u)
    contact[press.surface] = state.normal_force + state.friction_force
    touched = held & ~press.body.mesh.fixed
    assert touched.sum() > 20
    assert_allclose(u, state.u, atol=limit)  # 1 mm deep
    assert_allclose(force[touched], contact[touched], atol=limit * np.abs(contact).max())
    assert_allclose(
        force[press.body.mesh.fixed].sum(axis=0), state.reaction, atol=limit * abs(state.force[2])
    )


def test_felupes_own_contact_tends_to_ours_as_its_penalty_grows():
    """Its ball has a penalty, ours none: the difference falls with 1/penalty, and what is extrapolated is our force."""
    from scipy.sparse.linalg import spsolve

    settings = replace(specimens.TO_ROUNDING, friction=0.0)
    press = Press(Body(mesh(), NEO_HOOKE, BULK_TO_SHEAR), specimens.BALL, settings)
    depths = [0.25, 0.5]
    ours = specimens.follow(press, POSITION, depths)[-1].force[2]
    theirs = []
    for penalty in (50.0, 200.0):
        block = felupe_model.twin(press.body.mesh, NEO_HOOKE, BULK_TO_SHEAR, np.array([*POSITION, 5.0]))
        forces, _ = felupe_model.press_with_penalty(block, 5.0, depths, penalty, spsolve, 1e-8)
        theirs.append(forces[-1][2])
    assert abs(theirs[0] / ours - 1) < 5e-3
    extrapolated = theirs[1] + (theirs[1] - theirs[0]) / 3  # penalties 1 : 4
    # The penalty's second order is the square of its first, 1e-3 at 50 N/mm^3.
    assert extrapolated == pytest.approx(ours, rel=2e-5)
