"""A simulated training set: draws within their limits, rows that agree with their indentation, the same bytes again."""

import numpy as np
import pytest
from artificial_truth import small_study

from gelforge.config import ConfigError, study_from
from gelforge.dataset.shard import ShardDataset, shard_attributes
from gelforge.dataset.simulated import synthesise
from gelforge.indentation.sensor.unrolled import bin_points
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.virtual_lab.drawn_indentations import draw_indentation

LAWS = {"soft": Ogden((0.01,), (2.0,))}
CAMERA = {
    "width_px": 200,
    "height_px": 200,
    "focal_px": 272.0,
    "centre_px": [99.5, 99.5],
    "position_mm": [16.0, 16.0, -46.0],
}


def study_of(**synthesis):
    settings = {
        "camera": CAMERA,
        "mesh": {"near_mm": 1.2, "near_radius_mm": 3.0, "far_mm": 3.2},
        "particles": {"diameter_mm": 0.6},
        "steps": 2,
    }
    described = small_study().model_dump(mode="json")
    return study_from(described | {"synthesis": settings | synthesis})


STUDY = study_of()


def test_draws_are_within_their_limits_and_of_every_kind():
    drawn = [draw_indentation(STUDY, number) for number in range(60)]
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


def test_a_draw_depends_on_seed_and_number_only():
    again = draw_indentation(study_of(indentations=7), 5)
    assert again.planned == draw_indentation(STUDY, 5).planned
    assert again.planned != draw_indentation(study_of(seed=1), 5).planned
    assert again.planned != draw_indentation(STUDY, 6).planned


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
def test_draws_of_older_sets_stay(number, known):
    """As drawn before twists were there: where none is asked for, no random number is taken for them."""
    drawn = draw_indentation(STUDY, number)
    p = drawn.planned
    assert (drawn.kind, p.x_mm, p.y_mm, p.deepest_mm, len(p.depths_mm), (p.phases or ("load",))[-1]) == known
    assert not {"twisted", "twist_deg"} & set(STUDY.synthesis.model_dump(mode="json"))


def test_twists_are_drawn_as_asked():
    study = study_of(twisted=0.5, sheared=0.0, tilted=0.0, unloaded=0.0)
    drawn = [draw_indentation(study, number).planned for number in range(60)]
    twists = [path.twists_deg for path in drawn if path.twists_deg]
    assert 0.3 < len(twists) / len(drawn) < 0.7  # three deviations of 60 draws are 0.19
    ends = np.array([twist[-1] for twist in twists])
    assert 3 <= np.abs(ends).min() < np.abs(ends).max() <= 15
    assert 0.2 < (ends > 0).mean() < 0.8
    assert max(np.abs(np.diff(twist)).max() for twist in twists) <= 2 + 1e-9
    assert study.synthesis.model_dump(mode="json")["twisted"] == 0.5


def test_a_twisted_draw_has_labels_with_a_torque(tmp_path):
    study = study_of(
        twisted=1.0,
        sheared=0.0,
        tilted=0.0,
        unloaded=0.0,
        twist_deg=[3.0, 4.0],
        depth_mm=[1.0, 1.2],
        patterns=1,
    )
    synthesise(study, LAWS, 0, tmp_path / "0.h5")
    rows = ShardDataset([tmp_path / "0.h5"])
    block = rows.read(np.arange(len(rows)), ["force_distribution_N", "phase", "position_mm"])
    assert list(block["phase"]) == ["zero", "load", "load", "twist", "twist"]
    r = bin_points(study.sensor)[:, :2] - block["position_mm"][0]
    f = block["force_distribution_N"]
    torque = (r[:, 0] * f[..., 1] - r[:, 1] * f[..., 0]).sum(axis=1)
    twist = draw_indentation(study, 0).planned.twists_deg[-1]
    assert torque[-1] * np.sign(twist) > 3 * np.abs(torque[:3]).max()


def test_what_fits_nowhere_is_refused():
    with pytest.raises(ConfigError, match="none of 200 draws fits"):
        draw_indentation(study_of(depth_mm=[5.5, 5.9]), 0)


@pytest.fixture(scope="module")
def sheared(tmp_path_factory):
    """Return the number of a sheared draw and its file."""
    study = study_of(
        sheared=1.0, unloaded=0.0, shear_mm=[0.6, 0.8], depth_mm=[1.0, 1.5], shapes={"edge": 0, "pair": 0}
    )
    out = tmp_path_factory.mktemp("simulated") / "0.h5"
    synthesise(study, LAWS, 0, out)
    return study, out


def test_rows_are_labels_and_features_of_every_step_and_series(sheared):
    study, out = sheared
    drawn = draw_indentation(study, 0)
    rows = ShardDataset([out], "train")
    steps = len(drawn.planned.depths_mm)
    assert len(rows) == study.synthesis.patterns * (steps + 1)
    block = rows.read(
        np.arange(len(rows)), ["feature", "force_distribution_N", "total_force_fem_N", "phase", "untouched"]
    )
    total = block["force_distribution_N"].sum(axis=1, dtype=float)
    np.testing.assert_allclose(total, block["total_force_fem_N"], atol=1e-6)  # labels are float32
    assert (total[block["untouched"]] == 0).all()
    flow = block["feature"][:, :400].mean(axis=1)
    assert flow[~block["untouched"]].min() > 2 * flow[block["untouched"]].max()
    assert list(block["phase"][: steps + 1]) == ["zero", *drawn.planned.phases]
    last, direction = total[steps], np.array(drawn.planned.shears_mm[-1])
    assert last[:2] @ direction / np.linalg.norm(direction) > 0.02  # the gel is dragged along
    assert last[2] < -0.05


def test_series_show_other_particles_of_the_same_labels(sheared):
    rows = ShardDataset([sheared[1]])
    block = rows.read(np.arange(len(rows)), ["feature", "force_distribution_N"])
    half = len(rows) // 2
    np.testing.assert_array_equal(block["force_distribution_N"][:half], block["force_distribution_N"][half:])
    assert not np.allclose(block["feature"][1:half], block["feature"][half + 1 :])
    close = np.corrcoef(block["feature"][half - 1, :400], block["feature"][-1, :400])[0, 1]
    assert close > 0.9


def test_images_are_reduced_as_the_features_ask(sheared, tmp_path):
    study, out = sheared
    features = study.features.model_copy(update={"image_scale": 0.7})
    synthesise(study.model_copy(update={"features": features}), LAWS, 0, tmp_path / "0.h5")
    assert shard_attributes(tmp_path / "0.h5")["sessions"]["simulated"]["view"]["image_scale"] == 0.7
    small, whole = (ShardDataset([path]) for path in (tmp_path / "0.h5", out))
    flow = [
        rows.read(np.arange(len(rows)), ["feature"])["feature"][:, :400].mean(axis=1)
        for rows in (small, whole)
    ]
    deep = flow[1] > 0.5 * flow[1].max()
    np.testing.assert_allclose(flow[0][deep], flow[1][deep], rtol=0.15)  # 0.7 would be 30 % off


def test_a_camera_in_colour_gives_the_features_of_its_grey(tmp_path):
    colours = {"background_rgb": [60.0, 20.0, 10.0], "particle_rgb": [30.0, 220.0, 90.0], "noise_grey": 2.0}
    weights = np.array([0.299, 0.587, 0.114])
    same = {
        "background_grey": weights @ colours["background_rgb"],
        "particle_grey": weights @ colours["particle_rgb"],
        "noise_grey": 2.0 * np.linalg.norm(weights),
    }
    found = []
    for number, imaging in enumerate((colours, same, {})):
        study = study_of(imaging=imaging, sheared=0.0, tilted=0.0, unloaded=0.0, patterns=1)
        synthesise(study, LAWS, 0, tmp_path / f"{number}.h5")
        rows = ShardDataset([tmp_path / f"{number}.h5"])
        found.append(rows.read(np.arange(len(rows)), ["feature"])["feature"])
    np.testing.assert_array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])


def test_the_same_again_to_the_byte_and_said_to_be_synthetic(sheared, tmp_path):
    study, out = sheared
    synthesise(study, LAWS, 0, tmp_path / "0.h5")
    assert (tmp_path / "0.h5").read_bytes() == out.read_bytes()
    assert shard_attributes(out)["synthetic"]
