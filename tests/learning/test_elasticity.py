"""The operator of inverse elasticity against closed forms, balances and a nonlinear solution; its solver against twins."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
import torch
from learning.artificial_shards import study_of

from gelforge.config import Camera, Mechanics, Sensor
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.companion import simulate_label
from gelforge.learning.elasticity import operator
from gelforge.learning.elasticity.check import find_check
from gelforge.learning.elasticity.inverse import WARM_ITERATIONS, Inverse, State, in_cone
from gelforge.learning.elasticity.of_study import NoOperator, inverse_of
from gelforge.learning.elasticity.operator import bin_loads, displacements, flow_operator, seen_flow
from gelforge.learning.elasticity.unrolled import Unrolled
from gelforge.mechanics.bodies.body import SmallStrainBody
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.recording.optics.camera import project
from gelforge.virtual_lab.particles import interpolation

MU_MPA = 0.02
LAWS = {"gel": NeoHooke(MU_MPA), "skin": NeoHooke(3 * MU_MPA)}


def sensor_of(width=(12.0, 12.0), bins=(6, 6), skin_mm=1.0, wall_mm=1.0) -> Sensor:
    gel = {"name": "gel", "thickness_mm": 3.0, "material": "soft", "particle_volume_fraction": 0.02}
    layers = [gel, {"name": "skin", "thickness_mm": skin_mm, "material": "soft"}] if skin_mm else [gel]
    return Sensor.model_validate(
        {
            "width_x_mm": width[0],
            "width_y_mm": width[1],
            "layers": layers,
            "wall_mm": wall_mm,
            "bins": {"nx": bins[0], "ny": bins[1]},
        }
    )


def pinhole(width=(12.0, 12.0)) -> Camera:
    return Camera(
        width_px=240,
        height_px=200,
        focal_px=500.0,
        centre_px=[119.5, 99.5],
        position_mm=[width[0] / 2 + 0.3, width[1] / 2, -30.0],
        rotation_deg=[0.5, 0.0, 1.0],
    )


def flat(mm_per_px: float, width_mm: float) -> Camera:
    pixels = round(width_mm / mm_per_px)
    middle = (pixels - 1) / 2
    return Camera(
        width_px=pixels,
        height_px=pixels,
        mm_per_px=mm_per_px,
        centre_px=[middle, middle],
        position_mm=[width_mm / 2, width_mm / 2, -3.0],
    )


# --------------------------------------------------------------------------------------------------- operator
@pytest.mark.parametrize(("width", "bins"), [((12.0, 12.0), (6, 6)), ((12.0, 9.0), (6, 4))])
def test_symmetric_bins_equal_solutions_of_every_bin(monkeypatch, width, bins):
    """Of a camera that is askew: the symmetry is the sensor's, not the image's."""
    sensor, mechanics, camera = sensor_of(width, bins), Mechanics(), pinhole(width)
    found = flow_operator(sensor, mechanics, LAWS, camera, 8)
    monkeypatch.setattr(operator, "names_of", lambda square: ("identity",))
    every = flow_operator(sensor, mechanics, LAWS, camera, 8)
    np.testing.assert_allclose(found, every, atol=1e-5 * np.abs(every).max())  # single precision, twice


@pytest.fixture(scope="module")
def solved():
    """Return a mesh, the loads of all bins and their displacements."""
    sensor, mechanics = sensor_of(), Mechanics()
    mesh = operator._even_mesh(sensor, mechanics)
    load = bin_loads(mesh, sensor)
    return mesh, load, displacements(mesh, sensor, mechanics, LAWS, load)


def test_work_is_reciprocal_and_every_unit_force_held_by_the_base(solved):
    """Betti: the force on one bin works on the displacement of another as that does on the first."""
    _, load, moved = solved
    work = np.einsum("an,bjnc->acbj", load.toarray(), moved).reshape(3 * load.shape[0], -1)
    np.testing.assert_allclose(work, work.T, atol=1e-7 * work.max())
    assert np.linalg.eigvalsh(work).min() > 0

    # Every unit force is held by the base
    mesh, load, moved = solved
    laws = {name: LAWS["gel" if name == "gel" else "skin"] for name in mesh.regions}
    body = SmallStrainBody(mesh, laws, Mechanics().bulk_to_shear)
    for b, axis in ((0, 0), (7, 1), (14, 2)):
        force = body.response(moved[b, axis], np.zeros(len(mesh.elements))).f_mixed
        unit = np.eye(3)[axis]
        np.testing.assert_allclose(force[mesh.fixed].sum(axis=0), -unit, atol=1e-5)
        applied = load[[b]].toarray()[0][:, None] * unit
        np.testing.assert_allclose(force[~mesh.fixed], applied[~mesh.fixed], atol=1e-6)
        assert force[mesh.X[:, 2] > -1e-9].sum(axis=0) @ unit == pytest.approx(1, abs=1e-5)


def test_an_even_shear_of_a_layer_moves_as_its_closed_form():
    """u = tau (z + h) / mu, seen as the mean over heights by what particles below hide: far from the edges."""
    width, bins, tau, mm_per_px = 36.0, 18, 2e-3, 0.1
    sensor = sensor_of((width, width), (bins, bins), skin_mm=0.0, wall_mm=0.0)
    G = flow_operator(
        sensor, Mechanics(), {"gel": LAWS["gel"]}, flat(mm_per_px, width), bins, particle_mm=0.2
    )
    heights = np.linspace(0, 3.0, 3001)
    seen = np.exp(-1.5 * 0.02 / 0.2 * heights)
    mean = (heights * seen).sum() / seen.sum()
    force = np.zeros((bins**2, 3))
    for axis, sign in ((0, 1), (1, -1)):  # the image's v runs against y
        force[:] = 0
        force[:, axis] = tau * (width / bins) ** 2
        flow = np.einsum("krbc,bc->kr", G, force).reshape(2, bins, bins)[:, 8:10, 8:10].mean(axis=(1, 2))
        expected = np.zeros(2)
        expected[axis] = sign * tau * mean / MU_MPA / mm_per_px
        np.testing.assert_allclose(flow, expected, atol=6e-3 * abs(expected[axis]))  # edges 6 h away


def test_a_shallow_nonlinear_indentation_moves_as_its_bin_forces_say():
    """A ball 0.1 mm deep: the flow of the solution's displacement against that of its label, by the same camera."""
    study = study_of(regions=8, bins=6)
    mesh = study.mechanics.mesh.model_copy(update={"near_mm": 0.4, "far_mm": 1.2})
    mechanics = study.mechanics.model_copy(
        update={"error_bars": False, "store_displacement": True, "mesh": mesh, "friction": 0.0}
    )
    sensor = sensor_of(bins=(12, 12), skin_mm=0.0)
    study = study.model_copy(update={"sensor": sensor, "mechanics": mechanics})
    cell = simulate_label(study, {"soft": LAWS["gel"]}, {}, PlannedCell("one", 5.5, 6.5, (0.1,)))
    assert cell.converged
    camera, force = pinhole(), cell.arrays["bin_force_N"][0]
    G = flow_operator(sensor, mechanics, {"gel": LAWS["gel"]}, camera, 8)
    expected = np.einsum("krbc,bc->kr", G, force)
    place = np.random.default_rng(0).uniform([2.0, 2.0, -2.99], [10.0, 10.0, -0.01], (4000, 3))
    nodes, hexahedra = cell.arrays["gel_node_mm"], cell.arrays["gel_hex"]
    weights = interpolation(nodes, hexahedra, place)
    before, after = (
        project(camera, at)[0] for at in (place, place + weights @ cell.arrays["gel_displacement_mm"][0])
    )
    cell_of = (before + 0.5) / [camera.width_px, camera.height_px] * 8
    inside = ((cell_of > 0) & (cell_of < 8)).all(axis=1)
    region = (cell_of[inside].astype(int) @ [1, 8]).ravel()
    seen = np.exp(-1.5 * 0.02 / 0.3 * (place[inside, 2] + 3))
    count = np.bincount(region, seen, minlength=64)
    flow = np.stack([np.bincount(region, seen * d, minlength=64) for d in (after - before)[inside].T])
    known = count > 0.3 * count.max()
    flow, expected = flow[:, known] / count[known], expected[:, known]
    gain = (flow * expected).sum() / (expected**2).sum()
    assert gain == pytest.approx(1, abs=0.05)  # 0.1 mm of 3 is not quite small
    assert np.linalg.norm(flow - expected) < 0.15 * np.linalg.norm(flow)  # a few dozen particles a region


# --------------------------------------------------------------------------------------------------- solver
@pytest.fixture(scope="module")
def inverse():
    G = flow_operator(sensor_of(), Mechanics(), LAWS, pinhole(), 8)
    return Inverse.of(G, 0.45), G.reshape(128, -1)


def contact(rng, count=1):
    """Return forces (count, 36, 3) of a few neighbouring bins within the cone."""
    force = np.zeros((count, 36, 3))
    for row in force:
        first = 6 * rng.integers(1, 4) + rng.integers(1, 4)
        push = rng.uniform(0.01, 0.05, 4)
        angle, share = rng.uniform(0, 2 * np.pi), rng.uniform(0, 0.4)
        bins = first + np.array([0, 1, 6, 7])
        row[bins] = push[:, None] * [share * np.cos(angle), share * np.sin(angle), -1]
    return force


def test_nearest_forces_lie_in_the_cone_and_totals_that_agree_are_not_marked():
    # Nearest forces in the cone
    rng, mu = np.random.default_rng(0), 0.6
    force = rng.normal(size=(200, 30))
    near = in_cone(force, mu).reshape(-1, 3)
    assert (np.linalg.norm(near[:, :2], axis=1) <= -mu * near[:, 2] + 1e-12).all()
    np.testing.assert_allclose(in_cone(near.reshape(200, 30), mu).reshape(-1, 3), near, atol=1e-12)
    others = rng.normal(
        size=(300, 3)
    )  # no point of a convex set lies beyond the plane through the nearest one
    others = others[np.linalg.norm(others[:, :2], axis=1) <= -mu * others[:, 2]]
    away = force.reshape(-1, 3) - near
    assert (away @ others.T <= (away * near).sum(axis=1)[:, None] + 1e-9).all()

    # Totals that agree are not marked. 995 of 1000 known rows; others that differ by more than the share are, and
    # the gain is no difference
    rng = np.random.default_rng(6)
    true = np.column_stack([0.1 * rng.normal(size=(1000, 2)), -rng.uniform(0, 2, 1000)])
    check = find_check(1.2 * true * (1 + 0.05 * rng.normal(size=(1000, 1))), true)
    assert check.gain == pytest.approx(1.2, rel=0.01)
    found = check.disagreement(1.2 * true * (1 + 0.05 * rng.normal(size=(1000, 1))), true)
    assert (found > 1).mean() < 0.01
    assert (check.disagreement(1.2 * true * 1.5, true)[-true[:, 2] > 0.5] > 1).all()
    sheared = 1.2 * true + [0.5, 0.0, 0.0]
    assert (check.disagreement(sheared, true)[-true[:, 2] > 0.5] > 1).all()
    assert find_check(true[:50], true[:50]) is None
    assert find_check(np.zeros_like(true), true) is None


def test_the_solution_is_that_of_projected_gradients_and_of_unrolled_iterations(inverse):
    # The solution is that of projected gradients. A twin of few lines: steps down the gradient of the same
    # function, each back into the cone
    solver, G = inverse
    flow = (contact(np.random.default_rng(1), 3).reshape(3, -1) @ G.T).astype("f4")
    found = solver.solve(flow, 2000).force
    penalty, ridge, _ = solver.step
    H = solver.right * solver.singular**2 @ solver.right.T + float(ridge - penalty) * np.eye(
        len(solver.right)
    )
    force, steepest = np.zeros_like(found, dtype=float), np.linalg.eigvalsh(H).max()
    for _ in range(20000):
        force = in_cone(force - (force @ H - solver.explained(flow)) / steepest, solver.friction)
    np.testing.assert_allclose(found, force, atol=2e-3 * np.abs(force).max())

    # Unrolled iterations are the solver's
    solver = replace(inverse[0], unit_N=np.float32([0.1, 0.2, 0.7]))
    rng = np.random.default_rng(5)
    flow = rng.normal(size=(4, 128)).astype("f4")
    u, v = flow.reshape(4, 2, -1).transpose(1, 0, 2)
    expected = solver.inputs(np.concatenate([np.hypot(u, v), np.arctan2(v, u)], axis=1))
    with torch.inference_mode():
        found = Unrolled(solver)(torch.from_numpy(flow)).numpy()
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


def test_forces_are_found_again_also_in_few_iterations_from_the_frame_before(inverse):
    # Forces are found again and grow with the flow. A few bins of a small sensor: totals within what the penalties
    # take, 15 %; none where nothing moves
    solver, G = inverse
    force = contact(np.random.default_rng(2), 20)
    flow = (force.reshape(20, -1) @ G.T).astype("f4")
    u, v = flow.reshape(20, 2, -1).transpose(1, 0, 2)
    found = solver.forces(np.concatenate([np.hypot(u, v), np.arctan2(v, u)], axis=1))
    total, true = found.sum(axis=1), force.sum(axis=1)
    assert (np.abs(total - true)[:, 2] < 0.15 * np.abs(true[:, 2])).all()
    assert (np.linalg.norm(total - true, axis=1) < 0.2 * np.linalg.norm(true, axis=1)).all()
    assert not solver.forces(np.zeros((1, 128))).any()

    # Forces grow with the flow
    flow = (contact(np.random.default_rng(3), 5).reshape(5, -1) @ G.T).astype("f4")
    one, three = solver.solve(flow).force, solver.solve(3 * flow).force
    np.testing.assert_allclose(three, 3 * one, atol=1e-4 * np.abs(three).max())

    # A few iterations are enough from the frame before
    force = contact(np.random.default_rng(4))
    state = State(*(np.zeros((1, 108), "f4"),) * 2)
    for depth in np.linspace(0.5, 1, 30):
        flow = (depth * force.reshape(1, -1) @ G.T).astype("f4")
        state = solver.solve(flow, WARM_ITERATIONS, state)
    expected = solver.solve(flow, 500).force
    np.testing.assert_allclose(state.force[:, 2::3].sum(), expected[:, 2::3].sum(), rtol=0.02)
    assert (
        np.abs(solver.solve(flow, WARM_ITERATIONS).force - expected).max()
        > 3 * np.abs(state.force - expected).max()
    )


# --------------------------------------------------------------------------------------------------- study
def views(**changes):
    camera = pinhole().model_dump(mode="json")
    return {"day1": {"camera": camera, "crop_px": None, "image_px": [240, 200]} | changes}


def test_a_study_s_operator_has_its_camera_and_laws():
    study = study_of(regions=8, bins=6).model_copy(update={"sensor": sensor_of(skin_mm=0.0)})
    found = inverse_of(study, {"soft": LAWS["gel"]}, views())
    assert found.friction == study.mechanics.friction
    softer = inverse_of(study, {"soft": NeoHooke(MU_MPA / 2)}, views())
    np.testing.assert_allclose(softer.singular[:20], 2 * found.singular[:20], rtol=1e-3)


@pytest.mark.parametrize(
    ("laws", "seen", "sensor", "reason"),
    [
        ({}, views(), sensor_of(), "materials soft have no constitutive model"),
        ({"soft": LAWS["gel"]}, views(camera=None), sensor_of(), "no camera is described"),
        ({"soft": LAWS["gel"]}, {}, sensor_of(), "no camera is described"),
        (
            {"soft": LAWS["gel"]},
            views() | {"day2": {"camera": flat(0.1, 12.0).model_dump(mode="json"), "crop_px": None}},
            sensor_of(),
            "2 cameras",
        ),
        ({"soft": LAWS["gel"]}, views(), study_of().sensor, "no layer has particle_volume_fraction"),
    ],
    ids=["laws", "camera", "sessions", "cameras", "particles"],
)
def test_a_study_without_operator_says_why(laws, seen, sensor, reason):
    study = study_of(regions=8, bins=6).model_copy(update={"sensor": sensor})
    with pytest.raises(NoOperator, match=reason):
        inverse_of(study, laws, seen)


def test_loads_are_even_over_their_bins_and_regions_without_gel_show_no_flow():
    # Loads are spread evenly over their bins
    sensor = sensor_of(bins=(6, 4))
    mesh = operator._even_mesh(sensor, Mechanics())
    load = bin_loads(mesh, sensor)
    np.testing.assert_allclose(np.asarray(load.sum(axis=1)), 1, rtol=1e-12)
    centre = load @ mesh.X  # (B, 3)
    index = np.arange(24)
    np.testing.assert_allclose(
        centre[:, :2], np.column_stack([index % 6 + 0.5, index // 6 + 0.5]) * [2.0, 3.0], atol=1e-9
    )
    assert sp.issparse(load)

    # Regions without gel show no flow
    sensor = sensor_of()
    mesh = operator._even_mesh(sensor, Mechanics())
    wide = flat(0.1, 12.0).model_copy(update={"width_px": 240, "centre_px": [59.5, 59.5]})
    seen = seen_flow(mesh, sensor, wide, 8, None, 0.3)
    shown = np.asarray(np.abs(seen).sum(axis=1)).reshape(2, 8, 8) > 0
    assert shown[:, :, :4].all()
    assert not shown[:, :, 4:].any()
