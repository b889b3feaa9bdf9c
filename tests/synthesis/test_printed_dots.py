"""Printed dots on a sensor that is not square: they move as the solved gel does, and rows show the press."""

import numpy as np
import pytest
from small_synthesis import LAWS, motion, place_of

from gelforge.config import study_from
from gelforge.dataset.shard import ShardDataset
from gelforge.indentation.cells.cell_file import write_cell
from gelforge.synthesis.draws import site_places, solution, solution_count
from gelforge.synthesis.frame import MovingFrame
from gelforge.synthesis.moved import MovedPresses
from gelforge.synthesis.rows import solve, write_rows
from gelforge.synthesis.straight import StraightPresses
from gelforge.virtual_lab.particles import VirtualLabError, dots_box, place_particles

WIDTHS, BINS = (18.0, 22.0), (9, 11)
DOTS = {"spacing_mm": 2.0, "depth_mm": 0.2}
SWAP = np.array([[0, 1], [1, 0]])


def study_of(swapped: bool):
    """Return a study of a bare gel with dots, or of its image with x and y swapped."""
    (wx, wy), (nx, ny) = (WIDTHS[::-1], BINS[::-1]) if swapped else (WIDTHS, BINS)
    camera = {"width_px": 200, "height_px": 240, "focal_px": 250.0, "centre_px": [99.5, 119.5]}
    camera["position_mm"] = [wx / 2, wy / 2, -25.0]
    return study_from(
        {
            "study": "dots",
            "materials": {"soft": {"parameters": {"mu_kPa": [10.0], "alpha": [2.0]}}},
            "sensor": {
                "width_x_mm": wx,
                "width_y_mm": wy,
                "layers": [{"name": "gel", "thickness_mm": 4.0, "material": "soft"}],
                "bins": {"nx": nx, "ny": ny},
            },
            "indenter": {"kind": "sphere", "radius_mm": 4.0},
            "plan": {"grid": {"spacing_mm": 6.0, "margin_mm": 6.0}, "depths_mm": [0.5]},
            "mechanics": {"mesh": {"near_mm": 1.0, "near_radius_mm": 4.0, "far_mm": 2.0}},
            "features": {"regions": 20},
            "synthesis": {
                "camera": camera,
                "particles": {"diameter_mm": 0.6, "dots": DOTS},
                "imaging": {"background_grey": 140.0, "particle_grey": 40.0},
                "sites": 2,
                "paths": 1,
                "rows": 40,
                "rows_per_shard": 40,
                "steps": 2,
                "sheared": 1.0,
                "unloaded": 0.0,
                "depth_mm": [0.8, 1.0],
                "margin_mm": 5.0,
                "shapes": {"ball": 0, "punch": 0, "edge": 0, "pair": 0},
            },
        }
    )


STUDY, IMAGE = study_of(False), study_of(True)
PLACED = place_particles(STUDY.synthesis.particles, STUDY.sensor, "tested")


@pytest.fixture(scope="module")
def solved():
    return [solve(solution(STUDY, k), LAWS) for k in range(solution_count(STUDY))]


@pytest.fixture(scope="module")
def straight(solved):
    return StraightPresses(STUDY, solved[:-1])


def test_dots_are_solved_at_all_places_in_their_plane_and_move_as_the_gel_does(solved, straight):
    # All places of an oblong sensor are solved and its whole gel is kept
    places = site_places(STUDY)
    assert sorted(map(tuple, places)) == [(x, y) for x in (5.0, 9.0, 13.0) for y in (5.0, 11.0, 17.0)]
    nodes = solved[0].arrays["gel_node_mm"]
    np.testing.assert_allclose([nodes.min(axis=0), nodes.max(axis=0)], [[0, 0, -4], [18, 22, 0]])

    # The frame of dots is their plane
    frame = MovingFrame(STUDY.sensor, STUDY.synthesis.particles)
    field = frame.field(solved[0])
    assert field.shape[3:] == (1, 3)
    assert frame.heights == [-0.2]
    volume = MovingFrame(STUDY.sensor)
    assert len(frame.lines(9.0, 0)) > 2 * len(
        volume.lines(9.0, 0)
    )  # displacement changes fast under a contact's edge
    assert [volume.heights[0], volume.heights[-1]] == [-4.0, 0.0]

    # Dots move and bins add up as the solved gel does
    for number in (0, 4, 7):
        cell, true = solved[number], motion(solved[number], 9, PLACED)
        moved = straight.at(place_of(cell), 1.0).moved(PLACED)
        # interpolated linearly between grid lines of 0.06 mm beneath an indenter that elements of 0.5 mm resolve
        assert np.abs(moved - true).max() < 0.01 * np.abs(true).max()

    # Bins add up to the solved force near a side
    cell = solved[0]
    press = straight.at(place_of(cell), 1.0)
    np.testing.assert_allclose(
        press.bins(STUDY.sensor).sum(axis=0), cell.arrays["total_force_N"][9], atol=1e-9
    )
    heavy = press.bins(STUDY.sensor)[:, 2].reshape(BINS[1], BINS[0])
    assert np.unravel_index(heavy.argmin(), heavy.shape) == (2, 2)  # the bin at (5, 5) mm


def test_a_press_swaps_with_its_sensor_and_an_oblong_one_keeps_to_the_identity(straight, solved):
    # A press and that of the sensor with x and y swapped are one
    places = site_places(IMAGE)
    order = np.lexsort((places[:, 1], places[:, 0]))  # as the sites of the other
    assert (places[order][:, ::-1] == site_places(STUDY)).all()
    cells = [solve(solution(IMAGE, int(k)), LAWS) for k in order]
    image = StraightPresses(IMAGE, cells)
    place, depth = np.array([7.3, 12.1]), 0.63
    one, other = straight.at(place, depth), image.at(place[::-1], depth)
    bins = other.bins(IMAGE.sensor).reshape(BINS[0], BINS[1], 3).swapaxes(0, 1)[..., [1, 0, 2]].reshape(-1, 3)
    expected = one.bins(STUDY.sensor)
    np.testing.assert_allclose(bins, expected, atol=2e-5 * np.abs(expected).max())  # the solver's tolerance
    swapped = PLACED[:, [1, 0, 2]]
    np.testing.assert_allclose(other.moved(swapped)[:, [1, 0, 2]], one.moved(PLACED), atol=1e-5)

    # A path keeps to the identity where the sensor has no symmetry
    moved = MovedPresses(STUDY, [solved[-1]], [True])
    source, last = place_of(solved[-1]), len(solved[-1].arrays["depth_mm"]) - 1
    total = solved[-1].arrays["total_force_N"][last]
    drawn = [moved.draw(np.random.default_rng(k)) for k in range(30)]
    steps = [press for press in drawn if press.phase == "shear" and press.depth_mm > 0.5]
    assert min(np.abs(press.bins(STUDY.sensor).sum(axis=0) - total).max() for press in steps) < 1e-9
    width = np.array(WIDTHS)
    wall, near = np.minimum(source, width - source), [np.minimum(p.place, width - p.place) for p in drawn]
    kept = wall < moved.free_mm
    assert np.abs(np.array(near)[:, kept] / wall[kept] - 1).max() < 0.051


def test_rows_of_an_oblong_sensor_show_the_press_and_dots_outside_are_refused(solved, tmp_path):
    # Rows of an oblong sensor show the press
    paths = []
    for k, cell in enumerate(solved):
        paths.append(tmp_path / f"solved{k}.h5")
        write_cell(paths[-1], cell)
    write_rows(STUDY, 0, paths, tmp_path / "0.h5")
    rows = ShardDataset([tmp_path / "0.h5"])
    block = rows.read(np.arange(len(rows)), ["feature", "force_distribution_N", "untouched"])
    assert block["force_distribution_N"].shape == (40, 99, 3)
    flow = block["feature"][:, :400].mean(axis=1)
    total = -block["force_distribution_N"].sum(axis=1, dtype=float)[:, 2]
    assert flow[block["untouched"]].max() < 0.05  # px: noise of the camera alone
    assert np.corrcoef(flow, total)[0, 1] > 0.8

    # Dots outside the layers that are seen are refused
    layers = [
        STUDY.sensor.layers[0].model_copy(update={"thickness_mm": 3.0, "particle_volume_fraction": 0.02}),
        STUDY.sensor.layers[0].model_copy(update={"thickness_mm": 1.0, "name": "skin"}),
    ]
    sensor = STUDY.sensor.model_copy(update={"layers": layers})
    with pytest.raises(VirtualLabError, match=r"0.2 mm deep lie in none of the layers.*\(gel\)"):
        dots_box(STUDY.synthesis.particles.dots, sensor)
