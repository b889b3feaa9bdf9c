"""What `import gelforge as gf` offers: examples as they are printed, and forces that are those of a press by hand."""

import doctest
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

import gelforge as gf
from gelforge import api, differentiable
from gelforge.config import ConfigError
from gelforge.described import described_study
from gelforge.learning import torch_press

SMALL = {
    "sensor": {
        "width_x_mm": 12,
        "width_y_mm": 12,
        "wall_mm": 0,
        "layers": [{"name": "gel", "thickness_mm": 4, "material": "gel"}],
        "bins": {"nx": 6, "ny": 4},
    },
    "materials": {"gel": {"parameters": {"law": "neo_hooke", "mu_kPa": 20}}},
    "indenter": {"kind": "sphere", "radius_mm": 3},
    "mechanics": {"mesh": {"near_mm": 1, "near_radius_mm": 2, "far_mm": 2}},
}


def test_examples_are_true():
    for module, least in ((api, 7), (differentiable, 4), (torch_press, 5)):
        found = doctest.testmod(module)
        assert found.attempted >= least and found.failed == 0


def test_the_package_is_imported_at_once():
    code = "import sys, gelforge; print('numpy' in sys.modules, *gelforge.__all__)"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert printed.split() == ["False", *gf.__all__]
    assert set(gf.__all__) <= set(dir(gf)) and all(hasattr(gf, name) for name in gf.__all__)
    with pytest.raises(AttributeError, match="no attribute 'pres'"):
        _ = gf.pres


def test_a_sheared_press_by_nodes_bins_and_derivatives():
    """Friction in its place, one force in three sums, error bars in squares, and a derivative beside a difference."""
    sheared = {"shear_mm": (0.2, 0.0), "sensitivities": ["friction"]}
    answer = gf.press(6.0, 6.0, [0.3, 0.6], **SMALL, **sheared)
    assert answer.phase == ("load", "load", "shear", "shear")
    by_bins = answer.bin_force_N.sum(axis=1)
    assert answer.bin_force_N.shape == answer.bin_sigma_N.shape == (4, 24, 3)
    assert_allclose(by_bins + answer.side_force_N, answer.total_force_N, atol=1e-9)
    assert_allclose((answer.node_normal_N + answer.node_friction_N).sum(axis=1), by_bins, atol=1e-9)
    assert_allclose(answer.bin_normal_N + answer.bin_friction_N, answer.bin_force_N, atol=1e-12)
    dragged = answer.node_friction_N[-1, :, 0].sum()
    pressed = np.linalg.norm(answer.node_normal_N[-1], axis=1).sum()
    assert 0.1 * pressed < dragged < 0.45 * pressed  # along +x, with the indenter, within Coulomb's limit
    assert_allclose(
        answer.total_sigma_N, answer.cell.arrays["total_sigma_mesh_N"]
    )  # the law is given, and certain

    slope = answer.slopes["friction"]
    assert slope.total.shape == (4, 3) and slope.bins.shape == (4, 24, 3)
    step = 1e-3
    mechanics = SMALL["mechanics"] | {"error_bars": False}
    forces = [
        gf.press(
            6.0,
            6.0,
            [0.3, 0.6],
            **SMALL | {"mechanics": mechanics | {"friction": 0.45 + d}},
            shear_mm=(0.2, 0),
        )
        for d in (-step, step)
    ]
    assert forces[0].total_sigma_N is None and forces[0].slopes == {}
    difference = (forces[1].total_force_N - forces[0].total_force_N) / (2 * step)
    assert_allclose(slope.total[-1], difference[-1], rtol=0.02, atol=2e-4)


def test_independent_errors_are_added_in_squares():
    arrays = {"bin_sigma_mesh_N": np.array([3.0]), "bin_sigma_material_N": np.array([4.0])}
    assert api._sigma(arrays, "bin") == 5.0


@pytest.mark.parametrize(
    ("at", "blocks", "words"),
    [
        ([], {}, "positive and increase"),
        ([0.5, 0.4], {}, r"depths_mm \[0.5, 0.4\]"),
        ([0.5], {"indenter": {"radius": 3}}, "gelforge.press: indenter.radius, found 3: unknown key"),
        ([0.5], {"materials": {}}, "gel"),
        ([0.5], {"sensor": "nowhere.yaml"}, "nowhere.yaml: no such file"),
    ],
)
def test_what_cannot_be_pressed_is_refused_before_anything_is_solved(at, blocks, words):
    with pytest.raises(ConfigError, match=words):
        gf.press(6.0, 6.0, at, **SMALL | blocks)


def test_sections_and_a_study_are_taken_as_well_as_their_keys():
    study = described_study(None, **SMALL)
    again = described_study(study, study.sensor, study.indenter, study.materials, study.mechanics, ())
    assert again == study
    changed = described_study(study, None, None, None, {"friction": 0.1}, ("friction",))
    assert changed.mechanics.friction == 0.1 and changed.mechanics.mesh == study.mechanics.mesh
    assert changed.mechanics.sensitivities == ["friction"]
