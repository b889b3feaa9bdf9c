"""Cells of the small sensor: complete, balanced, honest about failure, symmetric."""

from dataclasses import replace

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.indentation.cells.cell_file import DATASETS, OPTIONAL, read_cell, read_timings, write_cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.sensor.symmetry import D4, transform_bins, transform_points
from gelforge.indentation.solving.companion import simulate_label
from gelforge.indentation.solving.inputs import inputs_digest
from gelforge.indentation.solving.mirror import mirror_cell
from gelforge.indentation.solving.simulate import simulate_cell, simulate_trajectory
from gelforge.mechanics.laws.models.ogden import Ogden

LAWS = specimens.STUDY_LAWS
PLANNED = PlannedCell("x0_y0", *specimens.CORNER, (0.4, 0.8))
TIGHT = {"solver": {"force_tolerance": 1e-10, "gap_tolerance": 1e-10}}
# What a cell of hexahedra holds that keeps its displacement and no error bars.
HELD = (set(DATASETS) - OPTIONAL) | {"gel_node_mm", "gel_hex", "gel_displacement_mm"}


@pytest.fixture(scope="module")
def cell():
    return simulate_cell(specimens.study(store_displacement=True), LAWS, PLANNED)


def test_a_cell_file_holds_everything_and_says_whether_it_leaves_the_tested_range(cell, tmp_path):
    # A cell file holds everything
    assert set(cell.arrays) == HELD
    write_cell(tmp_path / "cell.h5", cell)
    back = read_cell(tmp_path / "cell.h5")
    assert set(back.arrays) == set(cell.arrays)
    for name in (
        "format cell x_mm y_mm status reason last_good_depth_mm inputs_digest code_version iterations"
        " residual force_balance moment_balance energy_mJ settings source linear_solver smallest_J binning_moment_shift_Nmm"
    ).split():
        assert name in back.attributes, name
    assert back.converged
    assert {"seconds", "cpu_seconds", "peak_memory_MB"} == set(read_timings(tmp_path / "cell.h5"))
    assert (back.attributes["cell"], back.attributes["reason"], back.attributes["source"]) == (
        "x0_y0",
        "",
        "",
    )
    assert back.attributes["last_good_depth_mm"] == 0.8
    assert list(back.arrays["depth_mm"]) == [0.4, 0.8]

    # A cell says whether it leaves the tested range. Pressed 0.4 and 0.8 mm deep; "tested" is what the gel alone
    # reaches at half depth
    assert cell.attributes["leaves_valid_range"].tolist() == [-1, -1]  # the laws came without a range
    extent = cell.attributes["stretch_range"]
    assert extent.shape == (2, len(cell.attributes["regions"]), 2)
    assert (extent[1, :, 0] < extent[0, :, 0]).all() and (extent[1, :, 1] > extent[0, :, 1]).all()
    limit = extent[:, :, 1].max(axis=1).mean()
    outside = {name: lambda lam: lam.max(axis=1) > limit for name in LAWS}
    again = simulate_cell(specimens.study(), LAWS, PLANNED, outside)
    write_cell(tmp_path / "cell.h5", again)
    back = read_cell(tmp_path / "cell.h5").attributes
    assert back["leaves_valid_range"].tolist() == [0, 1]
    assert 0 < back["volume_outside_valid_range"][1].max() < 0.5
    assert not back["volume_outside_valid_range"][0].any()


def test_unloading_keeps_its_phases_and_gel_displacement_is_stored_where_asked():
    # Gel displacement only where asked
    short = replace(PLANNED, depths_mm=(0.1,))
    assert set(simulate_cell(specimens.study(), LAWS, short).arrays) == set(DATASETS) - OPTIONAL

    # An unloading trajectory keeps its phases
    study = specimens.study()
    by_layer = {"gel": specimens.GEL, "skin": specimens.SKIN}
    path = Trajectory(*specimens.CENTRE, (0.3, 0.6, 0.3), ("load", "load", "unload"))
    cell = simulate_trajectory(study.sensor, study.indenter, study.mechanics, by_layer, path)
    assert cell.attributes["phases"] == ["load", "load", "unload"]
    fz = cell.arrays["total_force_N"][:, 2]
    assert fz[1] < 1.5 * fz[0] < 0
    assert fz[2] == pytest.approx(fz[0], rel=0.05)


def test_totals_bins_nodes_and_displacements_agree(cell):
    a = cell.arrays
    total = a["total_force_N"]
    size = np.linalg.norm(total, axis=1).min()
    assert (total[:, 2] < 0).all()
    assert_allclose((a["node_normal_N"] + a["node_shear_N"]).sum(axis=1), total, rtol=1e-12, atol=1e-15)
    assert_allclose(
        a["bin_normal_N"] + a["bin_shear_N"], a["bin_force_N"], atol=2e-9
    )  # dust is taken off each
    # 1e-9 N of dust in at most 100 bins; before it the sum is kept to 1e-12 (test_binning)
    assert_allclose(a["bin_force_N"].sum(axis=1), total, atol=1e-7 * size)
    assert_allclose(a["reaction_N"], -total, atol=1e-6 * size)
    assert np.abs(a["bin_force_N"][np.abs(a["bin_force_N"]) > 0]).min() >= 1e-9
    assert max(cell.attributes["force_balance"]) < 1e-6
    assert max(cell.attributes["moment_balance"]) < 1e-6
    assert np.isfinite(cell.attributes["binning_moment_shift_Nmm"]).all()

    # Node states and forces belong together
    loaded = np.linalg.norm(a["node_normal_N"], axis=-1) > 0
    assert np.array_equal(loaded, a["node_state"] > 0)
    rubbed = np.linalg.norm(a["node_shear_N"], axis=-1) > 0
    assert not (rubbed & ~loaded).any()

    # Displacements of surface section and gel are of one mesh
    surface = {tuple(np.round(p, 9)): u for p, u in zip(a["node_xy_mm"], a["node_displacement_mm"][-1])}
    top = np.isclose(a["section_node_mm"][:, 2], 0)
    shared = 0
    for p, u in zip(a["section_node_mm"][top], a["section_displacement_mm"][-1][top]):
        key = tuple(np.round(p[:2], 9))
        if key in surface:  # a node that hangs carries no contact and is not among the surface's
            assert np.array_equal(surface[key], u)
            shared += 1
    assert shared > 5
    plane = np.unique(a["section_node_mm"][:, 1])
    assert len(plane) == 1
    assert abs(plane[0] - PLANNED.y_mm) <= 0.6  # half an element of about 1 mm
    gel = a["gel_node_mm"]
    assert (gel[:, 2].min(), gel[:, 2].max()) == pytest.approx((-4.0, -1.0))
    assert (gel[:, 0].min(), gel[:, 0].max()) == pytest.approx((1.0, 15.0))  # inside the wall
    base = np.isclose(gel[:, 2], -4.0)
    assert not a["gel_displacement_mm"][:, base].any()

    # The touched bins lie under the ball
    bins = np.linalg.norm(cell.arrays["bin_force_N"][-1], axis=-1)
    k = int(bins.argmax())
    centre = (np.array([k % 10, k // 10]) + 0.5) * 1.6
    assert np.linalg.norm(centre - [PLANNED.x_mm, PLANNED.y_mm]) < 1.7


# --------------------------------------------------------------------------------------------- symmetry
def test_bins_of_a_centred_cell_have_the_symmetry_of_the_square():
    study = specimens.study(**TIGHT)
    for rule in ("shape_function", "node"):
        study = specimens.study(binning=rule, **TIGHT)
        cell = simulate_cell(study, LAWS, PlannedCell("centre", *specimens.CENTRE, (0.4, 0.8)))
        bins = cell.arrays["bin_force_N"]
        assert np.abs(bins[..., :2]).max() > 1e-3
        for name in D4:
            # the stopping rule, with a margin for the condition of stick and slip
            assert_allclose(transform_bins(name, bins, 10), bins, atol=1e-7 * np.abs(bins).max())
        assert_allclose(cell.arrays["total_force_N"][:, :2], 0, atol=1e-8)


def test_two_solves_give_the_same_bytes(tmp_path):
    """On one machine with one thread; what differs, seconds, stands next to the cell."""
    study = specimens.study(store_displacement=True, error_bars=True)
    uncertain = {"soft": [LAWS["soft"]]}
    for name in ("one", "other"):
        cell = simulate_label(study, LAWS, uncertain, PLANNED)
        write_cell(tmp_path / f"{name}.h5", cell)
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "other.h5").read_bytes()
    assert {"seconds", "cpu_seconds", "error_bar_seconds", "peak_memory_MB"} == set(
        read_timings(tmp_path / "one.h5")
    )
    assert read_cell(tmp_path / "one.h5").attributes.keys().isdisjoint(read_timings(tmp_path / "one.h5"))


@pytest.mark.parametrize("name", ["rotate_90", "mirror_x", "swap_xy_negative"])
def test_a_mirrored_cell_equals_a_solved_one(name):
    study = specimens.study(**TIGHT)
    source = simulate_cell(study, LAWS, PLANNED)
    x, y = transform_points(name, np.array(specimens.CORNER), 16.0)
    there = PlannedCell("there", float(x), float(y), PLANNED.depths_mm, PLANNED.name, name)
    mirrored = mirror_cell(source, study, LAWS, there)
    solved = simulate_cell(study, LAWS, replace(there, source=None, symmetry=None))
    assert mirrored.attributes["source"] == "x0_y0"
    assert mirrored.attributes["source_inputs_digest"] == source.attributes["inputs_digest"]
    assert (mirrored.attributes["cell"], mirrored.attributes["x_mm"]) == ("there", x)
    for key in ("seconds", "cpu_seconds"):  # its own, milliseconds of copying; solving took 0.1 s or more
        assert 0 <= mirrored.attributes[key] < 0.5 * source.attributes[key]
    for key in ("total_force_N", "reaction_N", "bin_force_N", "bin_normal_N", "bin_shear_N"):
        assert_allclose(
            mirrored.arrays[key], solved.arrays[key], atol=1e-8, err_msg=key
        )  # of forces up to 0.3 N
    order, known = (np.lexsort(np.round(c.arrays["node_xy_mm"], 6).T) for c in (mirrored, solved))
    for key, limit in [("node_normal_N", 1e-8), ("node_shear_N", 1e-8), ("node_displacement_mm", 1e-6)]:
        assert_allclose(mirrored.arrays[key][:, order], solved.arrays[key][:, known], atol=limit, err_msg=key)
    assert np.array_equal(mirrored.arrays["node_state"][:, order], solved.arrays["node_state"][:, known])


# -------------------------------------------------------------------------------------------- failing
def test_a_cell_that_fails_says_so_and_keeps_what_converged(tmp_path):
    """0.1 mm converges in four iterations; 2.3 mm does not, and may not be halved."""
    solver = {"max_iterations": 2, "max_halvings": 0, "longest_step": 10.0, "force_tolerance": 1e-4}
    study = specimens.study(solver=solver)
    cell = simulate_cell(study, LAWS, PlannedCell("deep", *specimens.CORNER, (0.1, 2.3)))
    write_cell(tmp_path / "deep.h5", cell)
    back = read_cell(tmp_path / "deep.h5")
    assert not back.converged
    assert (
        "no equilibrium at centre" in back.attributes["reason"] or "definiteness" in back.attributes["reason"]
    )
    assert back.attributes["last_good_depth_mm"] == 0.1
    assert list(back.arrays["depth_mm"]) == [0.1]
    assert all(np.isfinite(array).all() for array in back.arrays.values())
    assert len(back.arrays["bin_force_N"]) == len(back.attributes["iterations"]) == 1

    # A cell that fails at once is empty and whole
    solver = {"max_iterations": 2, "max_halvings": 0, "force_tolerance": 1e-12}
    study = specimens.study(solver=solver, store_displacement=True)
    cell = simulate_cell(study, LAWS, replace(PLANNED, depths_mm=(1.0,)))
    write_cell(tmp_path / "cell.h5", cell)
    back = read_cell(tmp_path / "cell.h5")
    assert (back.attributes["status"], back.attributes["last_good_depth_mm"]) == ("failed", 0.0)
    assert "after 6 iterations" in back.attributes["reason"]
    assert set(back.arrays) == HELD
    assert back.arrays["bin_force_N"].shape == (0, 100, 3)
    assert back.arrays["total_force_N"].shape == (0, 3)
    assert len(back.arrays["node_displacement_mm"]) == 0


# --------------------------------------------------------------------------------------------- digests
CHANGES = {
    "sensor": {"sensor": {"wall_mm": 1.1}},
    "bins": {"sensor": {"bins": {"nx": 20, "ny": 20}}},
    "friction": {"friction": 0.4},
    "bulk": {"bulk_to_shear": 500.0},
    "strain": {"strain": "small"},
    "binning": {"binning": "node"},
    "mesh": {"mesh": {"near_mm": 0.9}},
    "tolerance": {"solver": {"force_tolerance": 1e-7}},
    "contact": {"contact": {"normal_augmentation": 10.0}},
    "displacement": {"store_displacement": True},
}
BASE = inputs_digest(specimens.study(), LAWS, PLANNED)


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_digest_follows_every_setting(change):
    assert inputs_digest(specimens.study(**change), LAWS, PLANNED) != BASE


@pytest.mark.parametrize(
    "planned",
    [
        replace(PLANNED, x_mm=10.91),
        replace(PLANNED, depths_mm=(0.4, 0.9)),
        replace(PLANNED, source="other", symmetry="mirror_x"),
    ],
)
def test_digest_follows_the_position_and_the_depths(planned):
    assert inputs_digest(specimens.study(), LAWS, planned) != BASE


def test_digest_follows_the_laws_that_are_used_and_nothing_else():
    stiffer = LAWS | {"soft": Ogden((8e-3,), (1.3,))}
    assert inputs_digest(specimens.study(), stiffer, PLANNED) != BASE
    assert inputs_digest(specimens.study(), LAWS | {"unused": Ogden((1.0,), (2.0,))}, PLANNED) == BASE

    # The other cells of the plan, the name of the study and the name of the cell change no number.
    other = specimens.study({"grid": {"spacing_mm": 2.0, "margin_mm": 4.0}, "depths_mm": [0.1]})
    assert inputs_digest(other, LAWS, replace(PLANNED, name="renamed")) == BASE
