"""Presses with memory: paths in time, relaxation in a wait, softening carried from press to press in recorded order."""

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.config.parts.effects import PressTiming
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.indentation.effects.history import in_time, quadrature_points
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.solving.simulate import simulate_cell, simulate_in_order, simulate_trajectory
from gelforge.mechanics.bodies.peak_grid import PeakGrid
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block

LAWS = specimens.STUDY_LAWS
BY_LAYER = {"gel": specimens.GEL, "skin": specimens.SKIN}
TIMING = {"speed_mm_per_s": 10.0, "dwell_s": 8.0, "step_mm": 0.25, "dwell_steps": 5}
SOFT = {"amount": 0.5, "m_kPa": 1.0, "beta": 0.5}
A, B = (6.5, 8.0), (9.5, 8.0)  # 3 mm apart


def relaxing(**timing):
    branch = {"relative_moduli": [0.5], "times_s": [1.0]}
    keys = {"viscoelastic": {"gel": branch, "skin": branch}, "timing": TIMING | timing}
    return with_keys(specimens.study(), history=keys)


def softening():
    return with_keys(specimens.study(), history={"mullins": {"gel": SOFT, "skin": SOFT}})


def presses(study, *trajectories, grid=None):
    """Return the pressing forces of each trajectory's readings, in the order pressed, and the softening left."""
    solved = list(
        simulate_in_order(study.sensor, study.indenter, study.mechanics, BY_LAYER, trajectories, grid)
    )
    assert all(cell.converged for cell, _ in solved), [cell.attributes["reason"] for cell, _ in solved]
    return [-cell.arrays["total_force_N"][:, 2] for cell, _ in solved], solved[-1][1]


def down(place, depth=0.8):
    return Trajectory(*place, (depth,), ("load",))


def test_paths_have_times_and_planned_depths_are_presses_of_their_own():
    path = in_time(Trajectory(*A, (0.3, 0.6), ("load", "load")), PressTiming(**TIMING))
    assert path.presses == (slice(0, 7), slice(7, 15))
    assert path.readings == (6, 14)
    assert path.trajectory.phases == ("load",) * 2 + ("dwell",) * 5 + ("load",) * 3 + ("dwell",) * 5
    times = np.array(path.trajectory.times_s)
    for press, depth in zip(path.presses, (0.3, 0.6)):
        assert times[press][-1] == pytest.approx(depth / 10 + 8)
        assert (np.diff(times[press]) > 0).all()
        assert np.array(path.trajectory.depths_mm)[press][-1] == depth

    # A path keeps its times and its phases
    stamped = Trajectory(*A, (0.3, 0.3), ("load", "dwell"), times_s=(0.5, 9.0))
    assert in_time(stamped, PressTiming()).trajectory.times_s == (0.5, 9.0)
    moved = Trajectory(*A, (0.3, 0.3, 0.1), ("load", "dwell", "unload"))
    times = in_time(moved, PressTiming(**TIMING)).trajectory.times_s
    assert times == pytest.approx((0.03, 8.03, 8.05))


def test_speed_and_wait_decide_what_is_read_down_to_the_law_at_rest():
    # A wait relaxes a press to the law at rest. Fast down, then held: from nearly 1.5 times the force at rest to
    # that force, as one branch of 1 s does
    study = relaxing()
    depths = (0.25, 0.5, 0.5, 0.5, 0.5)
    waits = (1e-3, 2e-3, 1.0, 3.0, 12.0)
    path = Trajectory(*A, depths, ("load", "load", "dwell", "dwell", "dwell"), times_s=waits)
    cell = simulate_trajectory(study.sensor, study.indenter, study.mechanics, BY_LAYER, path)
    plain = specimens.study()
    rest = simulate_trajectory(
        plain.sensor, plain.indenter, plain.mechanics, BY_LAYER, Trajectory(*A, depths[:2], ("load",) * 2)
    )
    force, known = -cell.arrays["total_force_N"][1:, 2], -rest.arrays["total_force_N"][1, 2]
    assert cell.attributes["time_s"] == list(waits)
    # All layers relax alike, so the surface hardly moves and force follows the modulus; what moves is friction's part.
    times = np.array(waits[1:])
    assert_allclose(force / known, 1 + 0.5 * np.exp(-times), rtol=5e-3)
    assert max(cell.attributes["force_balance"]) < 1e-6

    # Speed and wait decide what is read
    planned = PlannedCell("a", *A, (0.5,))

    def read(**timing):
        return -simulate_cell(relaxing(**timing), LAWS, planned).arrays["total_force_N"][0, 2]

    plain = -simulate_cell(specimens.study(), LAWS, planned).arrays["total_force_N"][0, 2]
    slow, waited, fast = read(speed_mm_per_s=0.01), read(), read(dwell_s=0.0)
    rounding = 1e-6 * plain  # the tolerance of forces
    assert (
        plain - rounding < slow < 1.02 * plain
    )  # 1 % is left of a second at 0.01 mm/s over 0.5 mm: gamma tau / t
    assert plain < waited < 1.02 * plain
    assert 1.4 * plain < fast < 1.51 * plain


def test_presses_soften_up_to_the_depth_seen_and_no_further():
    """Ogden & Roxburgh's curves meet again where they were left, so only what the grid and friction's path change is seen.

    That is a tenth of the softening at most: the energy density varies by half within this mesh's elements of 1 mm, and the
    grid cannot know it at every point.
    """
    (first, second, third, shallow), _ = presses(softening(), *[down(A)] * 3, down(A, 0.4))
    (virgin,), _ = presses(softening(), down(A, 0.4))
    softer = 1 - shallow[0] / virgin[0]
    assert softer > 0.2
    assert [second[0], third[0]] == pytest.approx([first[0]] * 2, rel=softer / 10)

    # Beyond what it has seen it is as new
    _, grid = presses(softening(), down(A, 0.4))
    (deeper,), _ = presses(softening(), down(A, 0.8), grid=grid)
    (untouched,), _ = presses(softening(), down(A, 0.8))
    assert deeper[0] == pytest.approx(untouched[0], rel=0.01)


@pytest.mark.thorough
def test_two_presses_3_mm_apart_depend_on_their_order():
    """The later one is softer than alone; by symmetry of the sensor both orders soften the later one alike."""
    study = softening()
    (alone_a,), _ = presses(study, down(A))
    (alone_b,), _ = presses(study, down(B))
    (first_a, then_b), after_ab = presses(study, down(A), down(B))
    (first_b, then_a), after_ba = presses(study, down(B), down(A))
    assert first_a == alone_a and first_b == alone_b
    assert then_b[0] < 0.999 * alone_b[0]
    assert then_a[0] < 0.999 * alone_a[0]
    assert first_a[0] == pytest.approx(first_b[0], rel=1e-3)  # mirror images on mirrored meshes
    assert then_b[0] == pytest.approx(then_a[0], rel=5e-3)
    one, other = (grid.boxes["skin"].values for grid in (after_ab, after_ba))
    assert np.linalg.norm(one - other[::-1]) < 0.05 * np.linalg.norm(
        one
    )  # to how the grid lies in the elements
    assert np.linalg.norm(one - other) > 0.01 * np.linalg.norm(one)  # the order is left in it


def test_the_grid_gives_back_a_smooth_field_and_never_falls():
    extents = {"gel": ([0.0, 0.0, -2.0], [8.0, 8.0, 0.0])}
    empty = PeakGrid.empty(extents, 0.25, ["gel"])
    mesh = layered_block(Block(8.0, 8.0, (("gel", 2.0),)), 4.0, 4.0, Sizes(0.5, far=0.5))
    mesh_points, region = quadrature_points(mesh), mesh.region
    field = np.exp(-((mesh_points - [4, 4, 0]) ** 2).sum(axis=-1) / 8)
    grid = empty.updated(mesh_points, region, ("gel",), np.zeros_like(field), field)
    # A linear field within every element is given back; between grid points 0.25 mm apart exp(-r2 / 8) bends by 4e-3.
    assert_allclose(grid.read(mesh_points, region, ("gel",)), field, atol=0.01)
    read = grid.read(mesh_points, region, ("gel",))
    again = grid.updated(mesh_points, region, ("gel",), read, np.maximum(read, 0.5 * field))
    assert np.array_equal(again.boxes["gel"].values, grid.boxes["gel"].values)
    assert not empty.read(mesh_points, region, ("gel",)).any()
