"""What `import gelforge as gf` offers: examples as they are printed, and forces that are those of a press by hand."""

import doctest
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydantic import TypeAdapter
from specimens import ONE_LAYER

import gelforge as gf
from gelforge.api import differentiable, materials, predictions, recordings, studies
from gelforge.api import press as pressing
from gelforge.config import ConfigError, LawParameters
from gelforge.mechanics.laws.models import section_of
from gelforge.shipped import EXAMPLES


@pytest.mark.parametrize(
    ("module", "least"), [(pressing, 7), (materials, 5), (studies, 9), (differentiable, 10), (recordings, 4)]
)
def test_examples_are_true(module, least):
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
    """Friction in its place, one force in three sums, error bars in squares, and a derivative next to a difference."""
    sheared = {"shear_mm": (0.2, 0.0), "sensitivities": ["friction"]}
    answer = gf.press(6.0, 6.0, [0.3, 0.6], **ONE_LAYER, **sheared)
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
    mechanics = ONE_LAYER["mechanics"] | {"error_bars": False}
    forces = [
        gf.press(
            6.0,
            6.0,
            [0.3, 0.6],
            **ONE_LAYER | {"mechanics": mechanics | {"friction": 0.45 + d}},
            shear_mm=(0.2, 0),
        )
        for d in (-step, step)
    ]
    assert forces[0].total_sigma_N is None and forces[0].slopes == {}
    difference = (forces[1].total_force_N - forces[0].total_force_N) / (2 * step)
    assert_allclose(slope.total[-1], difference[-1], rtol=0.02, atol=2e-4)


def test_errors_add_in_squares_and_sections_are_taken_as_their_keys():
    # Independent errors are added in squares
    arrays = {"bin_sigma_mesh_N": np.array([3.0]), "bin_sigma_material_N": np.array([4.0])}
    assert pressing._sigma(arrays, "bin") == 5.0

    # Sections and a study are taken as well as their keys
    study = pressing.described_study(None, **ONE_LAYER, sensitivities=())
    again = pressing.described_study(
        study, study.sensor, study.indenter, study.materials, study.mechanics, ()
    )
    assert again == study
    changed = pressing.described_study(study, None, None, None, {"friction": 0.1}, ("friction",))
    assert changed.mechanics.friction == 0.1 and changed.mechanics.mesh == study.mechanics.mesh
    assert changed.mechanics.sensitivities == ["friction"]


@pytest.mark.parametrize(
    ("at", "blocks", "words"),
    [
        ([], {}, r"depths_mm=\[\]"),
        ([0.5, 0.4], {}, r"depths_mm \[0.5, 0.4\]"),
        ([0.5], {"indenter": {"radius": 3}}, "gelforge.press: indenter.radius, found 3: unknown key"),
        ([0.5], {"materials": {}}, "gel"),
        ([0.5], {"sensor": "nowhere.yaml"}, "nowhere.yaml': no such file"),
    ],
)
def test_what_cannot_be_pressed_is_refused_before_anything_is_solved(at, blocks, words):
    with pytest.raises(ConfigError, match=words):
        gf.press(6.0, 6.0, at, **ONE_LAYER | blocks)


def test_a_fit_is_taken_by_a_press_with_its_uncertainty(tmp_path):
    gel = gf.fit(EXAMPLES / "data/demo/materials/ecoflex_gel", models=["neo_hooke"])
    assert gel.law.synthetic and gel.law.covariance is not None and set(gel.parameters.law) == {"neo_hooke"}
    gel.save(tmp_path / "law.json")
    assert '"neo_hooke"' in (tmp_path / "law.json").read_text()
    blocks = ONE_LAYER | {"materials": {"gel": gel}}
    fitted = gf.press(6.0, 6.0, [0.4], **blocks)
    given = gf.press(6.0, 6.0, [0.4], **blocks | {"materials": {"gel": gel.block}})
    assert_allclose(fitted.total_force_N, given.total_force_N, rtol=1e-12)
    assert fitted.total_sigma_N[0, 2] > given.total_sigma_N[0, 2]  # that of the model is in the first alone
    # a force is in proportion to the modulus, and so is its error; it is found on elements of 2 mm, which feel half of it
    share = gel.law.covariance[0, 0] ** 0.5 / gel.block["parameters"]["mu_kPa"]
    material = fitted.cell.arrays["total_sigma_material_N"][0, 2]
    assert 0.4 < material / (share * abs(fitted.total_force_N[0, 2])) < 1.2


@pytest.mark.parametrize(
    "parameters",
    [
        {"law": "ogden", "mu_kPa": [8.0, 0.3], "alpha": [1.3, 3.6]},
        {"law": "mooney_rivlin", "C10_kPa": 5.0, "C01_kPa": 1.0},
        {"law": "yeoh", "C10_kPa": 5.0, "C20_kPa": -0.1, "C30_kPa": 0.01},
        {"law": "gent", "mu_kPa": 9.0, "Jm": 30.0},
    ],
)
def test_a_model_is_written_as_the_section_that_gives_it(parameters):
    section = TypeAdapter(LawParameters).validate_python(parameters)
    again = section_of(section.constitutive_model())
    assert again.constitutive_model() == section.constitutive_model()


def test_a_recording_and_a_fit_are_read_by_what_the_commands_use(tmp_path, monkeypatch):
    # A recording is read judged and predicted by what the commands use
    with pytest.raises(ConfigError, match="no such file"):
        gf.judge(tmp_path, "nowhere.yaml", tmp_path / "out")
    with pytest.raises(Exception, match=r"session\.yaml: missing"):
        gf.read_recording(tmp_path)
    with pytest.raises(Exception, match="model.onnx"):
        next(gf.predict(tmp_path / "model.onnx", tmp_path))
    assert predictions.predict is gf.predict

    # Tests of several materials are no fit of one
    monkeypatch.setattr("gelforge.materials.readers.material_source.read_sources", lambda *_: [])
    with pytest.raises(ConfigError, match="found tests of none.*name its folder"):
        gf.fit(EXAMPLES / "data/demo/materials")
