"""Error bars: their parts against what they are made of, and what becomes of them in files and images."""

from dataclasses import replace

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.config import ConfigError
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import plan_cells
from gelforge.indentation.solving import companion
from gelforge.indentation.solving.companion import simulate_label, solve_companion
from gelforge.indentation.solving.error_bars import (
    AMOUNT,
    COARSER,
    CROSS_TOTALS,
    LEAST_BINS,
    PART_BINS,
    PART_OF_BINS,
    PART_TOTALS,
    SHARE_BENDING,
    SHARE_BINS,
    SHARE_LAYERS,
    SHARE_STIFF,
    SHARE_TOUCH,
    SHARE_WALLS,
    Companion,
    error_bars,
    layer_totals,
    mesh_totals,
    touch_totals,
)
from gelforge.indentation.solving.mirror import mirror_cell
from gelforge.indentation.solving.resolution import Resolution, resolution_of
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.materials.fitting.law_file import MaterialLaw, moved_laws
from gelforge.mechanics.laws.homogeneous import principal_stretches
from gelforge.mechanics.solving.equilibrium import NotConverged

# mu [kPa], alpha of the soft material: correlated, as two terms of one law always are
DEVIATION = np.array([0.16, 0.03, 0.05, 0.1])
CORRELATION = 0.6 ** np.abs(np.subtract.outer(range(4), range(4)))
COVARIANCE = CORRELATION * np.outer(DEVIATION, DEVIATION)
SOFT = MaterialLaw("soft", specimens.GEL, "", covariance=COVARIANCE)
THROUGH = 7.5  # elements between contact and base
PLANNED = PlannedCell("x", 10.8, 9.6, (0.4, 0.8))


def bars_of(bins, coarse, reached=None, slopes=0):
    rng = np.random.default_rng(5)
    D, B = bins.shape[:2]
    reached = D if reached is None else reached
    companion = Companion(
        coarse.sum(axis=1)[:reached],
        coarse[:reached],
        rng.normal(size=(slopes, reached, 3)),
        rng.normal(size=(slopes, reached, B, 3)),
    )
    many = np.full(len(bins), 10**9)  # nodes in contact: no error of first touch
    return error_bars(bins.sum(axis=1), bins, many, (10, 10), companion, Resolution(THROUGH)), companion


@pytest.fixture
def bins():
    field = np.zeros((3, 10, 10, 3))
    field[:, 3:7, 4:8] = np.random.default_rng(1).normal(size=(3, 4, 4, 3)) * [[[[1]]], [[[2]]], [[[3]]]]
    return field.reshape(3, 100, 3)


def test_equal_solutions_leave_the_least_bars_and_a_uniform_difference_its_part(bins):
    bars, _ = bars_of(bins, bins)
    size, largest = np.linalg.norm(bins, axis=-1, keepdims=True), np.abs(bins).max(axis=(1, 2), keepdims=True)
    expected = np.hypot(SHARE_BINS * size, LEAST_BINS * largest * (size > 0)) * np.ones(3)  # x, y, z alike
    assert_allclose(bars["bin_sigma_mesh_N"], expected, rtol=1e-12)
    uncancelled = PART_OF_BINS * np.sqrt((expected**2).sum(axis=1))
    share = SHARE_LAYERS / THROUGH**2 * np.abs(bins.sum(axis=1))
    assert_allclose(bars["total_sigma_mesh_N"], np.hypot(uncancelled, share), rtol=1e-12)

    # Inside a field that differs by the same vector everywhere the mean square is that of the
    # vector.
    vector = np.array([0.3, -0.1, 0.5])
    bars, _ = bars_of(bins, bins + vector)
    middle = bars["bin_sigma_mesh_N"].reshape(3, 10, 10, 3)[:, 5, 5]
    none, _ = bars_of(bins, bins)
    least = none["bin_sigma_mesh_N"].reshape(3, 10, 10, 3)[:, 5, 5]
    assert_allclose(middle, np.hypot(PART_BINS * np.abs(vector), least), rtol=1e-12)


def test_bars_depend_on_no_other_depth_and_on_no_name_of_an_axis(bins):
    coarse = bins + 0.1 * np.random.default_rng(3).normal(size=bins.shape)
    together, _ = bars_of(bins, coarse)
    for depth in range(len(bins)):
        alone, _ = bars_of(bins[depth : depth + 1], coarse[depth : depth + 1])
        for name, values in alone.items():
            assert_allclose(values[0], together[name][depth], rtol=1e-12)

    # X and y changed over: bars are changed over.
    rng = np.random.default_rng(7)
    coarse = bins + 0.1 * rng.normal(size=bins.shape)

    def swapped(field):
        return field.reshape(3, 10, 10, 3).swapaxes(1, 2)[..., [1, 0, 2]].reshape(3, 100, 3)

    straight, _ = bars_of(bins, coarse)
    turned, _ = bars_of(swapped(bins), swapped(coarse))
    assert_allclose(turned["bin_sigma_mesh_N"], swapped(straight["bin_sigma_mesh_N"]), rtol=1e-12)
    assert_allclose(turned["total_sigma_mesh_N"], straight["total_sigma_mesh_N"][:, [1, 0, 2]], rtol=1e-12)


def test_few_nodes_few_elements_stiff_layers_and_walls_widen_the_bar_of_the_total():
    # Few nodes or few elements widen the bar of the total
    total = np.array([[0.1, 0.0, -1.0]])
    few, many = (touch_totals(total, np.array([n])) for n in (4, 40))
    assert_allclose(few, 10 * many, rtol=1e-12)
    assert_allclose(few[0], SHARE_TOUCH / 4 * np.abs(total[0]), rtol=1e-12)

    # Half as many elements through a gel widen the bar of the total fourfold
    few, many = (layer_totals(total, Resolution(n)) for n in (3.0, 6.0))
    assert_allclose(few, 4 * many, rtol=1e-12)
    assert_allclose(many, SHARE_LAYERS / 36 * np.abs(total), rtol=1e-12)

    # Stiff layers and walls widen the bar of the total by their contrast
    plain, stiff, walled = (
        layer_totals(total, resolution)[0]
        for resolution in (Resolution(6.0), Resolution(6.0, 0.5), Resolution(6.0, 0.5, 0.2))
    )
    assert_allclose(stiff[2] ** 2 - plain[2] ** 2, (0.5 * SHARE_STIFF / 6**5) ** 2, rtol=1e-9)
    assert_allclose(np.sqrt(walled**2 - stiff**2), 0.5 * 0.2 * SHARE_WALLS, rtol=1e-9)
    # three elements: the share is at most that of bending
    few = layer_totals(total, Resolution(3.0, 1.0))[0, 2]
    assert few == pytest.approx(np.hypot(SHARE_BENDING, SHARE_LAYERS) / 9)


def test_a_site_is_resolved_as_its_mirror_image_and_better_far_from_walls_and_among_equal_layers():
    study = specimens.study()
    sensor, mesh, laws = study.sensor, study.mechanics.mesh, specimens.STUDY_LAWS
    near, mirrored, middle = (
        resolution_of(sensor, mesh, laws, x, 9.0)
        for x in (3.0, sensor.width_x_mm - 3.0, sensor.width_x_mm / 2)
    )
    assert near == mirrored and near.walls > middle.walls > 0 and 0 < near.contrast < 1
    equal = dict.fromkeys(laws, specimens.GEL)
    assert resolution_of(sensor, mesh, equal, 3.0, 9.0).contrast == 0
    tetrahedra = mesh.model_copy(update={"elements": "tetrahedra"})
    assert resolution_of(sensor, tetrahedra, laws, 3.0, 9.0).walls == 0


@pytest.mark.parametrize(
    ("depths", "sensor", "indenter", "sizes"),
    [
        # without the share of stiff layers the error is several times the bar (benchmarks/stiff_layers.py)
        (
            (0.4, 0.8),
            None,
            None,
            {"near_mm": 0.45, "near_radius_mm": 2.0, "growth": 0.3, "far_mm": 1.8},
        ),
        # a gel of 1 mm squeezed by a ball of 4 mm: 3 % is five times the other parts
        (
            (0.2, 0.3),
            {"layers": [{"name": "gel", "thickness_mm": 1.0, "material": "soft"}], "wall_mm": 0.0},
            {"radius_mm": 4.0},
            {"near_mm": 0.25, "near_radius_mm": 1.5, "growth": 0.25, "far_mm": 1.0},
        ),
    ],
    ids=["stiff skin", "gel of few elements"],
)
def test_the_bar_holds_what_elements_of_half_the_size_give(depths, sensor, indenter, sizes):
    planned = PlannedCell("x", 8.0, 8.0, depths)
    plan = {"grid": {"spacing_mm": 3.0, "margin_mm": 5.0}, "depths_mm": list(depths)} if sensor else None

    def study(factor):
        scaled = sizes | {name: factor * sizes[name] for name in ("near_mm", "far_mm")}
        return specimens.study(plan, sensor, indenter, mesh=scaled, contact={})

    label = simulate_label(study(1.0), specimens.STUDY_LAWS, {}, planned).arrays
    finer = simulate_cell(study(0.5), specimens.STUDY_LAWS, planned).arrays["total_force_N"]
    error = np.abs(label["total_force_N"] - finer)[:, 2] / label["total_sigma_mesh_N"][:, 2]
    assert (error < 2).all() and error.max() > 0.5


def test_totals_keep_what_bins_differ_by_in_shares_and_squares(bins):
    # A total that agrees by chance keeps what its bins differ by. Two bins that differ by the same force up and
    # down: the total's own difference is nothing
    coarse = bins.copy()
    coarse[:, 44] += [0.0, 0.0, 0.2]
    coarse[:, 55] -= [0.0, 0.0, 0.2]
    bars, _ = bars_of(bins, coarse)
    together = np.sqrt((bars["bin_sigma_mesh_N"] ** 2).sum(axis=1))
    share = SHARE_LAYERS / THROUGH**2 * np.abs(bins.sum(axis=1))
    assert_allclose(bars["total_sigma_mesh_N"], np.hypot(PART_OF_BINS * together, share), rtol=1e-9)
    assert (bars["total_sigma_mesh_N"][:, 2] > PART_OF_BINS * PART_BINS[2] * 0.2).all()

    # What the total differs by is the same share of the force at every depth
    grown = (bins[:1] * np.array([1.0, 2.0, 4.0])[:, None, None]).sum(axis=1)
    sigma = mesh_totals(grown, 1.1 * grown)
    assert_allclose(sigma, sigma[0] * np.array([1.0, 2.0, 4.0])[:, None], rtol=1e-12)
    assert (sigma > 0).all()

    # Independent directions add in squares
    bars, companion = bars_of(bins, bins, slopes=3)
    assert_allclose(bars["bin_sigma_material_N"] ** 2, (companion.bin_slopes**2).sum(axis=0), rtol=1e-12)
    assert_allclose(bars["total_sigma_material_N"] ** 2, (companion.total_slopes**2).sum(axis=0), rtol=1e-12)


@pytest.mark.parametrize("reached", [0, 1, 2])
def test_a_companion_that_ends_early_leaves_no_depth_without_a_bar(bins, reached):
    bars, _ = bars_of(bins, 1.05 * bins, reached)
    total = np.linalg.norm(bins.sum(axis=1), axis=1)
    for name, values in bars.items():
        assert np.isfinite(values).all() and values.shape[0] == 3, name
    if reached:
        share = bars["total_sigma_mesh_N"] / total[:, None]
        assert_allclose(
            share[reached:], np.broadcast_to(share[reached - 1], share[reached:].shape), rtol=1e-12
        )
    else:
        assert_allclose(bars["bin_sigma_mesh_N"], np.abs(bins), rtol=0)


def test_moved_laws_carry_the_covariance_of_the_stress():
    """The variance of a stress that no direction was chosen for, from the moves and from covariance and gradient."""
    lam = principal_stretches("uniaxial", np.array([1.3]))

    def stress(values):
        beta = SOFT.family.law_of(values).principal_stress(lam)
        return float((beta[:, 0] - beta[:, 2])[0])

    steps = 1e-6 * np.diag(np.abs(SOFT.values))
    gradient = np.array([(stress(SOFT.values + h) - stress(SOFT.values - h)) / (2 * h.sum()) for h in steps])
    expected = gradient @ COVARIANCE @ gradient
    moved = [MaterialLaw("soft", law, "").values for law in moved_laws(SOFT, AMOUNT)]
    found = sum(((stress(values) - stress(SOFT.values)) / AMOUNT) ** 2 for values in moved)
    assert found == pytest.approx(expected, rel=0.02)  # AMOUNT of a deviation is not quite a straight line
    assert len(moved) < 4  # four parameters, of which some make up for others
    assert moved_laws(replace(SOFT, covariance=None), AMOUNT) == []


def test_the_companion_is_the_coarser_solution_and_its_slopes_those_of_full_solutions():
    fine = {"near_mm": 0.6, "near_radius_mm": 2.5, "growth": 0.3, "far_mm": 1.2}
    exact = {"force_tolerance": 1e-9, "gap_tolerance": 1e-7}
    place = PlannedCell("x", 10.3, 9.2, (0.4, 0.8))
    study = specimens.study(mesh=fine, solver=exact)
    companion, reason, _ = solve_companion(
        study, specimens.STUDY_LAWS, place, {"soft": moved_laws(SOFT, AMOUNT)}
    )
    assert reason == "" and companion.bin_slopes.shape == (len(moved_laws(SOFT, AMOUNT)), 2, 100, 3)
    coarse = fine | {name: COARSER * fine[name] for name in ("near_mm", "far_mm")}
    coarser = specimens.study(mesh=coarse, solver=exact)

    def bins(law):
        return simulate_cell(coarser, specimens.STUDY_LAWS | {"soft": law}, place).arrays["bin_force_N"]

    own = bins(specimens.GEL)
    assert_allclose(companion.bins, own, atol=1e-8 * np.abs(own).max())  # both converged to 1e-9 of the force
    for found, law in zip(companion.bin_slopes, moved_laws(SOFT, AMOUNT)):
        expected = (bins(law) - own) / AMOUNT
        # Far below the 5 % that derivatives of bins are promised to; nodes that join the contact would make it more.
        assert_allclose(found, expected, atol=5e-3 * np.abs(expected).max())


def test_a_label_has_bars_of_both_kinds_and_a_mirrored_one_mirrored_bars():
    # A label has bars of both kinds and says which laws are uncertain
    study = specimens.study()
    uncertain = {"soft": moved_laws(SOFT, AMOUNT)}
    cell = simulate_label(study, specimens.STUDY_LAWS, uncertain, PLANNED)
    a = cell.arrays
    for quantity, values in (("bin", a["bin_force_N"]), ("total", a["total_force_N"])):
        for part in ("mesh", "material"):
            sigma = a[f"{quantity}_sigma_{part}_N"]
            assert sigma.shape == values.shape and (sigma >= 0).all()
            assert sigma[-1, ..., 2].max() > 1e-3 * np.abs(values).max()
    assert cell.attributes["uncertain_materials"] == ["soft"] and cell.attributes["companion_reason"] == ""
    plain = study.model_copy(update={"mechanics": study.mechanics.model_copy(update={"error_bars": False})})
    given = simulate_label(study, specimens.STUDY_LAWS, {}, PLANNED)
    assert given.attributes["uncertain_materials"] == []
    assert_allclose(given.arrays["bin_sigma_material_N"], np.zeros((2, 100, 3)), rtol=0, atol=0)
    without = simulate_label(plain, specimens.STUDY_LAWS, uncertain, PLANNED)
    assert not any("sigma" in name for name in without.arrays)
    assert_allclose(without.arrays["bin_force_N"], a["bin_force_N"], rtol=0, atol=0)

    # Bars are mirrored with their cell
    plan = {"grid": {"spacing_mm": 3.0, "margin_mm": 5.0}, "depths_mm": [0.4], "symmetry": "d4"}
    study = specimens.study(plan=plan)
    planned = plan_cells(study)
    image = next(cell for cell in planned.values() if cell.symmetry == "rotate_90")
    source = simulate_label(study, specimens.STUDY_LAWS, uncertain, planned[image.source])
    mirrored = mirror_cell(source, study, specimens.STUDY_LAWS, image)
    solved = simulate_label(
        study, specimens.STUDY_LAWS, uncertain, replace(image, source=None, symmetry=None)
    )
    for name in (n for n in source.arrays if "sigma" in n):
        size = solved.arrays[name].max()
        # bars follow from differences of two solutions, each converged to 1e-6 of the force
        assert_allclose(mirrored.arrays[name], solved.arrays[name], atol=2e-3 * size, err_msg=name)


@pytest.mark.parametrize(
    "effects",
    [
        {"kinematics": {"frame_compliance_mm_per_N": 0.3}},
        {"geometry": {"prestretch": {"skin": [1.02, 1.02]}}},
        {"history": {"viscoelastic": {"gel": {"relative_moduli": [0.3], "times_s": [1.0]}}}},
    ],
    ids=["yielding", "prestretch", "viscoelastic"],
)
def test_the_companion_has_the_effects_of_its_cell(effects):
    """Otherwise an effect would be taken for an error of the mesh."""
    study = specimens.study(effects=effects)
    uncertain = {"soft": moved_laws(SOFT, AMOUNT)[:1]}
    companion, _, _ = solve_companion(study, specimens.STUDY_LAWS, PLANNED, uncertain)
    plain, _, _ = solve_companion(specimens.study(), specimens.STUDY_LAWS, PLANNED, uncertain)
    with_effects = simulate_cell(study, specimens.STUDY_LAWS, PLANNED).arrays["total_force_N"]
    without = simulate_cell(specimens.study(), specimens.STUDY_LAWS, PLANNED).arrays["total_force_N"]
    change = (with_effects - without)[-1, 2]
    # Elements of half the ball's radius see the effect to some ten per cent; without it the ratio would be 0.
    assert 0.5 < (companion.total - plain.total)[-1, 2] / change < 2
    assert companion.total_slopes.shape == (1, 2, 3) and np.abs(companion.total_slopes).max() > 0


def test_what_fails_beside_a_cell_is_recorded_and_the_cell_stays(monkeypatch):
    """The cell itself is solved: nothing is known of its errors, so its bars are as large as its forces."""

    def unmeshable(*_):
        raise ConfigError("the mesher fails")

    monkeypatch.setattr(companion, "solve_companion", unmeshable)
    cell = simulate_label(specimens.study(), specimens.STUDY_LAWS, {}, PLANNED)
    assert cell.converged
    assert cell.attributes["companion_reason"] == "the mesher fails"
    assert cell.attributes["companion_unknowns"] == 0
    assert_allclose(cell.arrays["total_sigma_mesh_N"], np.abs(cell.arrays["total_force_N"]))

    # Derivatives that do not converge are recorded and the cell stays
    def lost(*_):
        raise NotConverged("no equilibrium next to it")

    monkeypatch.setattr(companion, "sensitivities", lost)
    study = specimens.study(sensitivities=["gel_stiffness"], error_bars=False)
    cell = simulate_label(study, specimens.STUDY_LAWS, {}, PLANNED)
    assert cell.converged and "sensitivity_total" not in cell.arrays
    assert cell.attributes["sensitivity_reason"] == "no equilibrium next to it"


def test_a_released_press_has_finite_bars_and_does_not_spoil_the_others():
    """After release the force is nothing: a share of it says nothing, and what the companion still has left is the bar."""
    total = np.array([[0.0, 0.0, -0.1], [0.0, 0.0, -0.4], [0.0, 0.0, -0.1], [0.0, 0.0, 0.0]])
    coarse = total * 1.02
    coarse[3, 2] = -1e-5
    companion = Companion(coarse, np.zeros((4, 4, 3)), np.zeros((0, 4, 3)), np.zeros((0, 4, 4, 3)))
    touched = np.array([20, 60, 20, 0])
    found = error_bars(total, np.zeros((4, 4, 3)), touched, (2, 2), companion, Resolution(THROUGH))[
        "total_sigma_mesh_N"
    ]
    loaded = Companion(coarse[:3], np.zeros((3, 4, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3, 4, 3)))
    alone = error_bars(total[:3], np.zeros((3, 4, 3)), touched[:3], (2, 2), loaded, Resolution(THROUGH))[
        "total_sigma_mesh_N"
    ]
    np.testing.assert_array_equal(found[:3], alone)
    assert_allclose(found[3], np.array([CROSS_TOTALS, CROSS_TOTALS, PART_TOTALS[2]]) * 1e-5)
