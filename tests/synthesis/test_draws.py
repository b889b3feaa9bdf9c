"""The presses that a synthesis solves: sites cover the sensor, paths are drawn within their limits."""

import numpy as np
import pytest
from small_synthesis import study_of

from gelforge.config import ConfigError
from gelforge.indentation.sensor.symmetry import D4, transform_points
from gelforge.synthesis.draws import drawn_path, site_places, solution, solution_count

STUDY = study_of()


def test_draws_and_twists_are_within_their_limits_and_depend_on_the_seed():
    # Draws are within their limits and of every kind
    drawn = [drawn_path(STUDY, number) for number in range(60)]
    assert {one.kind for one in drawn} == {"own", "ball", "punch", "edge", "pair"}
    assert all(one.study.indenter == STUDY.indenter for one in drawn if one.kind == "own")
    paths = [one.planned for one in drawn]
    deepest = np.array([path.deepest_mm for path in paths])
    assert 0.3 <= deepest.min() < 0.6
    assert 1.7 < deepest.max() <= 2.0
    moved = [np.linalg.norm(path.shears_mm[-1]) for path in paths if path.shears_mm]
    assert (
        0.35 < len(moved) / len(paths) < 0.65
    )  # asked for half of them; three deviations of 120 draws are 0.14
    assert 0.2 - 1e-5 <= min(moved) < max(moved) <= 1.2 + 1e-5
    for path in paths:
        steps = np.diff(np.array(path.shears_mm or [(0, 0)]), axis=0)
        assert (np.linalg.norm(steps, axis=1) < 0.2 + 1e-6).all()
    assert any("unload" in path.phases for path in paths)
    assert any(path.tilts_deg for path in paths)

    # A draw depends on seed and number and must fit
    again = drawn_path(study_of(paths=7), 5)
    assert again.planned == drawn_path(STUDY, 5).planned
    assert again.planned != drawn_path(study_of(seed=1), 5).planned
    assert again.planned != drawn_path(STUDY, 6).planned

    # What fits nowhere is refused
    with pytest.raises(ConfigError, match="none of 200 draws fits"):
        drawn_path(study_of(depth_mm=[5.5, 5.9]), 0)

    # Twists are drawn as asked
    study = study_of(twisted=0.5, sheared=0.0, tilted=0.0, unloaded=0.0)
    drawn = [drawn_path(study, number).planned for number in range(60)]
    twists = [path.twists_deg for path in drawn if path.twists_deg]
    assert 0.3 < len(twists) / len(drawn) < 0.7  # three deviations of 60 draws are 0.19
    ends = np.array([twist[-1] for twist in twists])
    assert 3 <= np.abs(ends).min() < np.abs(ends).max() <= 15
    assert 0.2 < (ends > 0).mean() < 0.8
    assert max(np.abs(np.diff(twist)).max() for twist in twists) <= 2 + 1e-9


@pytest.mark.parametrize(
    ("number", "known"),
    [
        (0, ("ball", 3.4297, 24.145, 1.8517, 2, "load")),
        (1, ("edge", 27.8694, 4.524, 0.7019, 9, "unload")),
        (2, ("own", 18.6335, 6.7726, 0.496, 4, "shear")),
        (7, ("own", 23.7784, 15.3892, 1.7297, 5, "unload")),
        (8, ("punch", 5.0147, 15.4862, 1.2093, 2, "load")),
    ],
)
def test_drawn_paths_stay(number, known):
    """A path depends on seed and number, so solved presses stay valid when more are asked for."""
    drawn = drawn_path(STUDY, number)
    p = drawn.planned
    assert (drawn.kind, p.x_mm, p.y_mm, p.deepest_mm, len(p.depths_mm), (p.phases or ("load",))[-1]) == known


def test_sites_cover_the_sensor_and_solutions_are_sites_then_paths():
    # Sites cover the sensor with and without symmetry. On a symmetric sensor a triangle is solved; its images are
    # the whole lattice
    study = study_of(sites=5)
    places = site_places(study)
    assert len(places) == 15
    images = {tuple(np.round(transform_points(name, p, 32.0), 3)) for p in places for name in D4}
    assert len(images) == 9**2
    assert np.min(list(images)) == pytest.approx(3.0)
    assert np.max(list(images)) == pytest.approx(29.0)

    # A sensor without symmetry is solved all over
    study = study_of(sites=3)
    oblong = study.model_copy(update={"sensor": study.sensor.model_copy(update={"width_y_mm": 26.0})})
    places = site_places(oblong)
    assert len(np.unique(places, axis=0)) == 25
    np.testing.assert_allclose(places.min(axis=0), [3, 3])
    np.testing.assert_allclose(places.max(axis=0), [29, 23])

    # Solutions are sites then paths
    study = study_of(sites=3, paths=4)
    assert solution_count(study) == 10
    assert [solution(study, k).kind for k in range(6)] == ["site"] * 6
    assert solution(study, 6).planned == drawn_path(study, 0).planned
    assert solution(study, 0).planned.deepest_mm == study.synthesis.depth_mm[1]
    without = study_of(paths=4, classes={"straight": 0, "light": 0})
    assert solution_count(without) == 4
