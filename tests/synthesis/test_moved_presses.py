"""Presses between and from solved ones: equal to the solved where these lie, symmetric, and refused outside."""

from dataclasses import replace

import numpy as np
import pytest
from small_synthesis import LAWS, motion, place_of, study_of

from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.sensor.symmetry import D4, transform_bins, transform_points, transform_vectors
from gelforge.synthesis.draws import solution, solution_count
from gelforge.synthesis.frame import MovingFrame, displaced, turned_field
from gelforge.synthesis.moved import MovedPresses
from gelforge.synthesis.rows import solve
from gelforge.synthesis.straight import StraightPresses
from gelforge.virtual_lab.particles import VirtualLabError, place_particles

STUDY = study_of(
    sites=4, paths=1, sheared=1.0, unloaded=0.0, depth_mm=[1.0, 1.2], shapes={"edge": 0, "pair": 0}
)
# Of the largest bin: nodal forces are moved with square faces, and this coarse mesh has faces twice as long as wide.
SPREAD = 0.12
SENSOR = STUDY.sensor
PARTICLES = place_particles(STUDY.synthesis.particles, STUDY.sensor, "tested")


@pytest.fixture(scope="module")
def solved():
    """Return the solved presses: ten sites, then one sheared path."""
    return [solve(solution(STUDY, k), LAWS) for k in range(solution_count(STUDY))]


@pytest.fixture(scope="module")
def straight(solved):
    return StraightPresses(STUDY, solved[:-1])


@pytest.mark.parametrize("at", [[3.0, 3.0], [9.0, 20.5], [16.0, 16.0]])
def test_the_lines_of_the_frame_run_from_wall_to_wall_through_the_indenter(at):
    frame = MovingFrame(STUDY.sensor)
    for axis in (0, 1):
        lines = frame.lines(at[axis], axis)
        assert (np.diff(lines) > 0).all()
        assert [lines[0], lines[len(lines) // 2], lines[-1]] == pytest.approx([1.5, at[axis], 30.5])
        np.testing.assert_allclose(frame.lines(32 - at[axis], axis), 32 - lines[::-1], atol=1e-12)
    points = np.column_stack([frame.lines(at[0], 0), frame.lines(at[1], 1), np.full(len(lines), -3.0)])
    index = frame.index(points, np.array(at))
    np.testing.assert_allclose(index[:, 0], np.arange(len(lines)), atol=1e-9)


def test_a_turned_field_is_of_the_turned_press_and_layers_must_form_one_box():
    # A turned field is that of the turned press
    frame, at = MovingFrame(STUDY.sensor), np.array([8.0, 11.0])
    lines = [frame.lines(at[0], 0), frame.lines(at[1], 1), frame.heights]
    x, y, z = np.meshgrid(*lines, indexing="ij")
    field = np.stack([np.sin(x / 5) * z, np.cos(y / 7 + x / 9), x * y * z / 300], axis=-1).astype(np.float32)
    for name in D4:
        image = transform_points(name, at, 32.0)
        turned = displaced(
            turned_field(name, field), frame.index(transform_points(name, PARTICLES, 32.0), image)
        )
        own = displaced(field, frame.index(PARTICLES, at))
        np.testing.assert_allclose(turned, transform_vectors(name, own), atol=1e-6, err_msg=name)

    # Layers with particles must form one box
    layers = STUDY.sensor.layers
    apart = [
        layers[0].model_copy(update={"thickness_mm": 1.5}),
        layers[1],
        layers[0].model_copy(update={"name": "b"}),
    ]
    apart[2] = apart[2].model_copy(update={"thickness_mm": 3.0})
    sensor = STUDY.sensor.model_copy(update={"layers": apart})
    with pytest.raises(VirtualLabError, match="one box"):
        MovingFrame(sensor)


def test_a_press_at_a_solved_site_or_moved_straight_is_the_one_solved_there(straight, solved):
    # A press at a solved site is the solved one
    cell = solved[5]
    for step in (3, 9):
        press = straight.at(place_of(cell), float(cell.arrays["depth_mm"][step]))
        np.testing.assert_allclose(
            press.bins(SENSOR).sum(axis=0), cell.arrays["total_force_N"][step], atol=1e-9
        )
        assert (
            np.abs(press.bins(SENSOR) - cell.arrays["bin_force_N"][step]).max()
            < SPREAD * np.abs(press.bins(SENSOR)).max()
        )
        true = motion(cell, step, PARTICLES)
        away = np.abs(press.moved(PARTICLES) - true).max()
        assert away < 0.03 * np.abs(true).max()  # elements of 1.2 mm and grid lines differ

    # A site that is left out is predicted by the others. The lattice of this test is three times as wide as the
    # usual one; the total is within 2 %
    for number in (4, 5, 8):
        cell = solved[number]
        press = straight.at(place_of(cell), float(cell.arrays["depth_mm"][8]), without=number)
        total = cell.arrays["total_force_N"][8, 2]
        assert press.bins(SENSOR).sum(axis=0)[2] == pytest.approx(total, rel=0.02)

    # A straight press that is moved is the straight press there. Its increments over the straight press are none;
    # another indenter's force changes as the straight press's does
    cell, place = solved[9], np.array([16.0, 9.5])
    depth = float(cell.arrays["depth_mm"][8])
    there = straight.at(place, depth)
    own, other = (
        MovedPresses(STUDY, [cell], [kind], straight).turned(0, 8, place, 0.4) for kind in (True, False)
    )
    np.testing.assert_allclose(own.total_N, there.total_N, atol=1e-9)
    away = own.moved(PARTICLES) - there.moved(PARTICLES)
    assert np.abs(away).max() < 1e-3 * np.abs(there.moved(PARTICLES)).max()
    assert other.total_N[2] == pytest.approx(there.total_N[2], rel=1e-9)


def test_a_press_and_its_images_are_one_at_depths_between_too(straight):
    # A press and its images are one
    place, depth = np.array([5.3, 12.1]), 0.71
    press = straight.at(place, depth)
    for name in D4:
        image = straight.at(transform_points(name, place, 32.0), depth)
        np.testing.assert_allclose(
            image.bins(SENSOR), transform_bins(name, press.bins(SENSOR), 20), atol=1e-9, err_msg=name
        )
        moved = image.moved(transform_points(name, PARTICLES, 32.0))
        np.testing.assert_allclose(moved, transform_vectors(name, press.moved(PARTICLES)), atol=1e-6)

    # A depth between solved ones is that of its own solution
    drawn = solution(STUDY, 9)
    depth = 0.57
    cell = solve(replace(drawn, planned=replace(drawn.planned, depths_mm=(0.3, depth))), LAWS)
    press = straight.at(place_of(cell), depth)
    assert press.bins(SENSOR).sum(axis=0)[2] == pytest.approx(
        cell.arrays["total_force_N"][1, 2], rel=0.02
    )  # of the mesh
    true = motion(cell, 1, PARTICLES)
    assert np.abs(press.moved(PARTICLES) - true).max() < 0.04 * np.abs(true).max()

    # Places and depths outside the solved are refused
    with pytest.raises(ValueError, match="outside the solved"):
        straight.at(np.array([2.9, 16.0]), 0.5)
    with pytest.raises(ValueError, match="outside the solved"):
        straight.at(np.array([16.0, 16.0]), 1.21)
    with pytest.raises(ValueError, match="outside the solved"):
        straight.at(np.array([16.0, 16.0]), 0.01)


def test_a_path_turned_by_a_quarter_is_its_image_and_keeps_its_total_force(solved):
    # A path turned by a quarter is its image. On a sensor that is symmetric a turn about the middle is one of its
    # symmetries
    cell = solved[-1]
    moved = MovedPresses(STUDY, [cell], [True])
    last = len(cell.arrays["depth_mm"]) - 1
    place = place_of(cell)
    same = moved.turned(0, last, place, 0.0)
    np.testing.assert_allclose(same.bins(SENSOR).sum(axis=0), cell.arrays["total_force_N"][last], atol=1e-9)
    assert (
        np.abs(same.bins(SENSOR) - cell.arrays["bin_force_N"][last]).max()
        < SPREAD * np.abs(same.bins(SENSOR)).max()
    )
    true = motion(cell, last, PARTICLES)
    assert np.abs(same.moved(PARTICLES) - true).max() < 0.05 * np.abs(true).max()
    image = transform_points("rotate_90", place, 32.0)
    turned = moved.turned(0, last, image, np.pi / 2)
    np.testing.assert_allclose(
        turned.bins(SENSOR), transform_bins("rotate_90", same.bins(SENSOR), 20), atol=1e-9
    )
    np.testing.assert_allclose(
        turned.moved(transform_points("rotate_90", PARTICLES, 32.0)),
        transform_vectors("rotate_90", same.moved(PARTICLES)),
        atol=1e-6,
    )

    # A moved path keeps its total force and turns it
    total = cell.arrays["total_force_N"][last]
    angle = 0.7
    turned = moved.turned(0, last, np.array([13.0, 17.0]), angle).bins(SENSOR).sum(axis=0)
    assert turned[:2] @ [np.cos(angle), np.sin(angle)] == pytest.approx(total[0], abs=1e-9)
    for name in D4:
        found = (
            moved.mirrored(0, last, transform_points(name, place_of(cell), 32.0), name)
            .bins(SENSOR)
            .sum(axis=0)
        )
        np.testing.assert_allclose(found, transform_vectors(name, total), atol=1e-9)


def test_a_press_keeps_its_distance_from_a_wall_and_a_wide_contact_stays_on(solved):
    # A press near a wall keeps its distance from it
    cell = solved[1]  # at (3, y)
    moved = MovedPresses(STUDY, [cell], [True])
    source, width = place_of(cell), 32.0
    drawn = np.array([moved.draw(np.random.default_rng(k)).place for k in range(40)])
    nearest = np.minimum(drawn, width - drawn).min(axis=1)
    assert np.abs(nearest / source.min() - 1).max() < 0.06
    assert len(np.unique(np.round(drawn, 1), axis=0)) > 20  # along all four walls

    # A wide contact that is turned stays on the sensor. Its nodes reach 12 mm from the middle, farther than walls
    # are felt
    cell = solved[9]  # in the middle
    away = cell.arrays["node_xy_mm"] - place_of(cell)
    loaded = (cell.arrays["node_normal_N"] != 0).any(axis=(0, 2))
    wide = place_of(cell) + away * 12 / np.linalg.norm(away[loaded], axis=1).max()
    moved = MovedPresses(STUDY, [Cell(cell.arrays | {"node_xy_mm": wide}, cell.attributes)], [False])
    for seed in range(30):
        press = moved.draw(np.random.default_rng(seed))
        at = press.place + press.forces.offset_mm
        assert (at > -1e-9).all() and (at < 32 + 1e-9).all()
        assert np.abs(press.place - 16).max() <= 4 + 1e-9
