"""Forces and derivatives carried from a mirror image against those solved at the place itself."""

import numpy as np
import pytest
import specimens
from recorded import record

from gelforge.indentation.effects.catalogue import CATALOGUE as SOLVER_EFFECTS
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.symmetry import D4, transform_points
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.effects.wall_side import GRID
from gelforge.mismatch.fem import solver as solver_module
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.fem.solver import base_of
from gelforge.mismatch.model.images_of_presses import image_of, numbers_at_image
from gelforge.mismatch.readings.sessions import observe

SAME = 0.03  # of the largest: at a mirror image a one-sided difference is taken to the other side
# one of every way to turn: not at all, as a vector, as a rotation, as a spin, as a place, as a side
NAMES = ("gel_stiffness", "thickness_gradient", "misregistration", "tilt", "yaw", "void", "wall_side")


def as_it_is(study, paths, solve):
    return solve(list(paths)), ["identity"] * len(paths)


@pytest.mark.parametrize("symmetry", D4)
def test_all_images_of_a_place_are_one_press(symmetry):
    study, place = specimens.study(), np.array([4.0, 5.5])
    width = study.sensor.width_x_mm
    x, y = transform_points(symmetry, place, width)
    image, back = image_of(study, PlannedCell("a", x, y, (0.3,)))
    assert image == image_of(study, PlannedCell("b", *place, (0.3,)))[0]
    np.testing.assert_allclose(
        transform_points(back, np.array([image.x_mm, image.y_mm]), width), [x, y], atol=1e-9
    )


def test_a_study_with_a_direction_has_no_images_and_forces_beside_a_broken_wall_are_mirrored():
    # A study with a direction has no images
    tilted = SOLVER_EFFECTS["tilt"](specimens.study(), 1.0)
    path = PlannedCell("", 3.0, 4.0, (0.3,))
    assert image_of(tilted, path) == (path, "identity")

    # Forces next to a broken wall are mirrored. Full solutions: the wall at the low end of y pressed next to it, and
    # that of x at the image
    study, forces = specimens.study(), []
    for hyperparameters, place in (
        ({"part": "wall", "side": "y_low"}, (6.0, 3.5)),
        ({"part": "wall", "side": "x_low"}, (3.5, 6.0)),
    ):
        broken = CATALOGUE["wall_side"].to_study(study, hyperparameters, [0.9])
        path = PlannedCell("", *place, (0.4,))
        assert image_of(broken, path) == (path, "identity")
        forces.append(simulate_cell(broken, specimens.STUDY_LAWS, path).arrays["total_force_N"][0])
    whole = simulate_cell(study, specimens.STUDY_LAWS, path).arrays["total_force_N"][0]
    np.testing.assert_allclose(forces[0][[1, 0, 2]], forces[1], rtol=1e-4, atol=1e-6)
    assert forces[1][2] > 0.9 * whole[2]  # softer
    assert whole[0] < 0 < forces[1][0]  # the wall is pushed outwards no more


@pytest.mark.parametrize("symmetry", D4)
def test_a_side_goes_with_the_sensor(symmetry):
    """At the image it is the side that the symmetry carries to the path's own, of the same part."""
    grid, width = [*GRID], 16.0
    out = {"x_low": (-1, 0), "x_high": (1, 0), "y_low": (0, -1), "y_high": (0, 1)}
    for hyperparameters, number in zip(grid, numbers_at_image(grid, symmetry, width)):
        image = grid[number]
        assert image["part"] == hyperparameters["part"]
        assert np.array_equal(D4[symmetry] @ out[image["side"]], out[hyperparameters["side"]])


@pytest.mark.thorough
def test_carried_forces_and_derivatives_are_those_of_the_place(tmp_path, monkeypatch):
    study = specimens.study(friction=0.0)  # with friction derivatives are good to a tenth on so coarse a mesh
    middle = study.sensor.width_x_mm / 2
    sites = [(middle + a, middle + b) for a, b in ((1.5, 0.5), (-0.5, 1.5), (-1.5, 0.5))]
    session = record(tmp_path / "session", study, specimens.STUDY_LAWS, sites=sites)
    observations = observe([session], study.sensor, 1.0)
    effects = {name: CATALOGUE[name] for name in NAMES}
    carried = base_of(
        Solver(study, specimens.STUDY_LAWS, {}, tmp_path / "carried"), observations, effects.values()
    )
    monkeypatch.setattr(solver_module, "solved_for_all", as_it_is)
    alone = base_of(
        Solver(study, specimens.STUDY_LAWS, {}, tmp_path / "alone"), observations, effects.values()
    )
    assert len(list((tmp_path / "carried").iterdir())) < len(list((tmp_path / "alone").iterdir()))
    largest = np.abs(alone.context.force).max()
    np.testing.assert_allclose(carried.context.force, alone.context.force, rtol=0, atol=1e-5 * largest)
    assert carried.failed == alone.failed and set(carried.context.at_readings) == set(
        alone.context.at_readings
    )
    for key, own in alone.context.at_readings.items():
        error = np.abs(carried.context.at_readings[key] - own).max()
        assert error <= SAME * np.abs(own).max(), key
