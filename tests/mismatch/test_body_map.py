"""The map of the body: boxes fill the layers, their derivatives add up, and a hidden one is found."""

from dataclasses import replace

import artificial_problem
import numpy as np
import pytest
import specimens
from recorded import DEPTHS, SITES, record

from gelforge.config import study_from
from gelforge.config.basis.variants import merged
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.indentation.effects.fields import element_stiffness
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.sensor_mesh import sensor_mesh
from gelforge.indentation.solving.sensitivities import Variation, derivatives
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.candidates import BOX, LEVELS, WIDTH, body_map, box_at, boxes
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.fem.nominal import observations_of, problem_of
from gelforge.mismatch.fem.solutions import Solver

STUDY = specimens.study()
STEP = 1e-3


def stiffness(study):
    """Return mesh and the factors (E,) on the elements' shear moduli."""
    mesh = sensor_mesh(study.sensor, study.mechanics.mesh, *specimens.CORNER)
    shear, bulk = element_stiffness(mesh, study.sensor, study.mechanics)
    assert bulk is shear
    return mesh, shear


@pytest.mark.parametrize(
    ("thickness", "faces"),
    [
        ((4.0,), [-4.0, -3.0, -2.0, 0.0]),
        ((3.0, 1.0), [-4.0, -2.5, -1.0, 0.0]),
        ((1.0, 2.0, 1.0), [-4.0, -3.0, -1.0, 0.0]),
        ((1.0, 1.0, 1.0, 1.0), [-4.0, -3.0, -2.0, -1.0, 0.0]),
    ],
)
def test_levels_are_the_layers_the_thickest_halved(thickness, faces):
    layers = [
        {"name": f"l{k}", "thickness_mm": t, "material": "soft", "particle_volume_fraction": 0.02}
        for k, t in enumerate(thickness)
    ]
    study = study_from(merged(STUDY.model_dump(mode="json"), {"sensor": {"layers": layers}}))
    found = [box_at(study, box) for box in boxes(study)]
    assert sorted({f for box in found for f in (box["low_mm"][2], box["high_mm"][2])}) == faces
    assert len(faces) > LEVELS


def test_boxes_fill_the_layers_by_shares_and_leave_the_wall():
    shares = 0.0
    for box in boxes(STUDY):
        mesh, factor = stiffness(BOX.to_study(STUDY, box, [1.0]))
        shares = shares + factor - 1
    layers = mesh.region < len(STUDY.sensor.layers)
    np.testing.assert_allclose(shares[layers], 1.0, atol=1e-12)
    assert not shares[~layers].any() and (~layers).any()

    # An element that a face cuts takes part by its share
    box = {"low_mm": [6.0, 7.3, -3.1], "high_mm": [9.2, 10.0, -1.7], "factor": 3.0}
    mesh, factor = stiffness(with_keys(STUDY, geometry={"patches": [box]}))
    corner = mesh.X[mesh.elements]
    volume = (corner.max(axis=1) - corner.min(axis=1)).prod(axis=1)
    assert ((factor - 1) / 2 * volume).sum() == pytest.approx(3.2 * 2.7 * 1.4, rel=1e-12)

    # No value is the study itself and a box leaves a square no mirror images
    box = boxes(STUDY)[0]
    assert BOX.to_study(STUDY, box, [0.0]) is STUDY
    assert not BOX.to_study(STUDY, box, [0.1]).has_symmetry_of_square


@pytest.fixture(scope="module")
def along():
    """Return the cell next to which they are taken, and the derivatives of its forces along every box, and along all."""
    planned = PlannedCell("t", *specimens.CORNER, DEPTHS)
    every = {str(k): BOX.to_study(STUDY, box, [STEP]) for k, box in enumerate(boxes(STUDY))}
    names = {layer.name: 1 + STEP for layer in STUDY.sensor.layers} | {"wall": 1.0}
    every["all"] = with_keys(STUDY, material={"stiffness_factor": names})
    variations = {key: Variation(study, specimens.STUDY_LAWS, STEP) for key, study in every.items()}
    return planned, *derivatives(STUDY, specimens.STUDY_LAWS, planned, variations)


def test_derivatives_add_to_that_of_all_layers_and_are_the_solver_s(along):
    _, _, found = along
    total = sum(found[str(k)].total for k in range(len(boxes(STUDY))))
    # 1 %: each derivative may be off by as much as its tolerance and the step's curvature leave.
    np.testing.assert_allclose(total, found["all"].total, atol=0.01 * np.abs(found["all"].total).max())

    # A derivative is that of the solver
    planned, cell, found = along
    size = [np.abs(found[str(k)].total).max() for k in range(len(boxes(STUDY)))]
    k = int(np.argmax(size))
    there = simulate_cell(BOX.to_study(STUDY, boxes(STUDY)[k], [0.01]), specimens.STUDY_LAWS, planned)
    difference = (there.arrays["total_force_N"] - cell.arrays["total_force_N"]) / 0.01
    np.testing.assert_allclose(difference, found[str(k)].total, atol=0.02 * size[k])


def test_a_hidden_box_is_where_the_map_says():
    """With artificial changes, each box's its own: nothing else is near."""
    problem = artificial_problem.problem_of(artificial_problem.artificial.context(5, per_side=3))
    rng, n = np.random.default_rng(2), len(problem.residual)
    places = [{"x_mm": float(k), "y_mm": 0.0, "z_mm": -1.0} for k in range(8)]
    columns = 0.5 * rng.normal(size=(n, 8)) * np.abs(problem.residual).std()
    columns[:, 7] *= 1e-9  # one that no reading feels
    sign = np.array([0])
    observable = [
        Candidate("box_modulus", p, columns[:, [k]], BOX.prior_sd, sign) for k, p in enumerate(places)
    ]
    observations = problem.observations
    hidden = np.zeros(observations.force.shape)
    hidden[observations.read] = 0.4 * columns[:, 3].reshape(-1)[: hidden[observations.read].size].reshape(
        hidden[observations.read].shape
    )
    there = replace(
        problem, observations=replace(observations, force=problem.base + hidden), boxes=observable
    )
    table = body_map(there)
    assert table["change"].abs().idxmax() == 3
    assert abs(table["change"][3] - 0.4) < 2 * table["sigma"][3]
    assert (table["change"].drop(3).abs() < 2 * table["sigma"].drop(3)).all()
    assert table["sigma"][7] == pytest.approx(WIDTH) and table["sigma"][3] < 0.3 * WIDTH
    assert body_map(problem) is None


@pytest.mark.thorough
def test_a_recording_with_a_stiffer_box_shows_it(tmp_path):
    """SYNTHETIC: a box at the bottom of the gel is 60 % stiffer; the map is surest of that one, three sigma."""
    settings = {"sites": 9, "discretisation": 0.002, "leave_out": sorted(set(CATALOGUE) - {"gel_stiffness"})}
    study = study_from(merged(STUDY.model_dump(mode="json"), {"mismatch": settings}))
    hidden = {"x_mm": 6.25, "y_mm": 6.25, "z_mm": -3.25}
    assert hidden in boxes(study)
    sites = [*SITES, (11.0, 11.0), (5.0, 11.0), (11.0, 5.0)]
    sensor = BOX.to_study(study, hidden, [0.6])
    session = record(tmp_path / "s", sensor, specimens.STUDY_LAWS, sites=sites, noise_N=0.001)
    observations, _ = observations_of([session], study)
    problem, _ = problem_of(Solver(study, specimens.STUDY_LAWS, {}, tmp_path / "kept"), observations)
    table = body_map(problem)
    assert table["z_mm"].nunique() == LEVELS
    sure = (table["change"] / table["sigma"]).abs()
    strongest = table.loc[sure.idxmax()]
    assert strongest[["x_mm", "y_mm", "z_mm"]].to_dict() == hidden and sure.max() > 2
    assert 0 < strongest["change"] < 0.6 + 2 * strongest["sigma"]  # the prior draws it to none
