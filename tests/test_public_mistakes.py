"""What `import gelforge as gf` says to a caller who passes something else, and how its results are printed."""

import doctest
import math

import numpy as np
import pytest
from session_folder import write_session
from specimens import ONE_LAYER

import gelforge as gf
from gelforge.api import printed
from gelforge.api.differentiable import PressSlopes
from gelforge.learning.deployment.predictor import Prediction
from gelforge.shipped import EXAMPLES

GEL = str(EXAMPLES / "data/demo/materials/ecoflex_gel")
MISTAKES = {  # what is called in an empty folder: what its message must name
    "a sensor's name": (
        lambda: gf.press(6, 6, [0.4], sensor="gelsight-mini"),
        r"gelforge\.sensor\('gelsight_mini'\)",
    ),
    "a sensor that is none": (
        lambda: gf.press(6, 6, [0.4], sensor="folder"),
        "a folder.*path of a YAML file",
    ),
    "a study as sensor": (lambda: gf.press(6, 6, [0.4], sensor=gf.sensor("digit")), "study="),
    "a number as sensor": (lambda: gf.press(6, 6, [0.4], sensor=3), "mapping"),
    "a kind as indenter": (lambda: gf.press(6, 6, [0.4], indenter="sphere"), "'kind': 'sphere'"),
    "a name as study": (lambda: gf.press(6, 6, [0.4], study="digit"), r"gelforge\.sensor\('digit'\)"),
    "keys as study": (lambda: gf.press(6, 6, [0.4], study={"sensor": {}}), "load_study"),
    "text as depth": (lambda: gf.press(6, 6, "deep"), "depths_mm='deep'"),
    "no depth": (lambda: gf.press(6, 6, []), "depths_mm"),
    "a depth of nan": (lambda: gf.press(6, 6, [math.nan]), "depths_mm"),
    "text as place": (lambda: gf.press("a", 6, [0.4]), "x_mm='a'"),
    "a number as shear": (lambda: gf.press(6, 6, [0.4], shear_mm=0.2), "2 finite numbers"),
    "text as mechanics": (lambda: gf.press(6, 6, [0.4], mechanics="coarse"), "mapping"),
    "a fit as materials": (lambda: gf.press(6, 6, [0.4], materials="neo_hooke"), "'gel'"),
    "constants outside `parameters`": (
        lambda: gf.press(
            6, 6, [0.4], **ONE_LAYER | {"materials": {"gel": {"law": "neo_hooke", "mu_kPa": 20}}}
        ),
        r"parameters: \{law: neo_hooke, mu_kPa: 20\}",
    ),
    "a list of effects": (lambda: gf.press_slopes(6, 6, 0.4, ["friction"]), "gel_stiffness"),
    "half a step": (lambda: gf.press_slopes(6, 6, 0.4, steps=1.5), "whole number"),
    "several depths of one": (lambda: gf.press_slopes(6, 6, [0.4, 0.5]), "depth_mm"),
    "text in a tensor's place": (lambda: gf.torch_press(6, 6, "deep"), "tensors of one element or numbers"),
    "an empty folder of tests": (lambda: gf.fit("folder"), r"samples\.csv.*mapping="),
    "a folder of materials": (
        lambda: gf.fit(EXAMPLES / "data/demo/materials"),
        "ecoflex_gel, elastosil_25_1",
    ),
    "a table as tests": (lambda: gf.fit(np.zeros((3, 3))), "samples.csv"),
    "a model's name that is none": (lambda: gf.fit(GEL, models="neo-hooke"), "'neo_hooke'"),
    "no folder of a recording": (lambda: gf.read_recording("nowhere"), "no such folder"),
    "a number as recording": (lambda: gf.read_recording(3), "session's folder"),
    "a name as judged study": (lambda: gf.judge("folder", "digit", "out"), r"gelforge\.sensor\('digit'\)"),
    "no dataset": (lambda: gf.load_dataset("folder"), r"manifest\.json"),
    "a number as dataset": (lambda: gf.load_dataset(3), r"manifest\.json"),
    "a number as model": (lambda: gf.predict(3, "folder"), r"model\.onnx"),
    "a study's name": (lambda: gf.load_study("dome"), r"gelforge\.sensor\('dome'\)"),
    "a number as sensor's name": (lambda: gf.sensor(3), "digit"),
    "a number as command": (lambda: gf.run(3), "gelforge check"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_answered_in_a_line_that_says_what_to_pass(tmp_path, monkeypatch, name):
    (tmp_path / "folder").mkdir()
    monkeypatch.chdir(tmp_path)
    call, message = MISTAKES[name]
    with pytest.raises(ValueError, match=message) as raised:
        call()
    assert type(raised.value).__module__.startswith("gelforge.") and len(str(raised.value)) < 600


def test_results_of_single_values_are_taken_and_all_printed_in_a_few_lines(tmp_path):
    # One depth and one name may stand by themselves
    answer = gf.press(6.0, 6.0, 0.4, **ONE_LAYER, sensitivities="friction")
    assert answer.depth_mm.tolist() == [0.4] and list(answer.slopes) == ["friction"]

    # Results are printed in a few lines with their totals
    answer = gf.press(6.0, 6.0, [0.2, 0.4], **ONE_LAYER, sensitivities=["friction"])
    depths = np.linspace(0.05, 0.4, 40)
    slopes = PressSlopes(depths, np.ones((40, 3)), np.ones((40, 4, 3)), {"x_mm": np.ones((40, 3))}, {})
    prediction = Prediction("a.png", 0.1, np.ones((4, 3)), np.ones(4), {})
    study = gf.sensor("digit")
    recording = gf.read_recording(write_session(tmp_path / "monday"))
    fitted = gf.fit(GEL, models=["neo_hooke"])
    results = (answer, answer.slopes["friction"], answer.cell, slopes, prediction, study, recording, fitted)
    for one in results:
        assert repr(one) == str(one) and len(str(one).splitlines()) <= 12 and len(str(one)) < 1200
    with_bar = printed.with_error(answer.total_force_N[-1, 2], answer.total_sigma_N[-1, 2])
    assert with_bar in str(answer) and "[N]" in str(answer) and "0.4" in str(answer)
    assert "(4, 4, 4) N" in str(prediction)
    assert "digit_gel" in str(study) and "2 indentations, 12 readings" in str(recording)
    sigma = fitted.law.covariance[0, 0] ** 0.5
    assert f"mu = {printed.with_error(fitted.law.values[0], sigma)} kPa" in str(fitted)

    # ------------------------------------------------------------------------------------------- printed
    # Numbers are printed as the examples say
    found = doctest.testmod(printed)
    assert found.attempted >= 3 and found.failed == 0
