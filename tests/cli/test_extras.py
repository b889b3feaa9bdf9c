"""What a study asks for and the installation lacks is said before any work, with the command that installs it."""

import pytest

from gelforge.cli import extras, main
from gelforge.config import load_study, write_yaml


@pytest.fixture
def without_onnx(monkeypatch):
    there = extras.find_spec
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name == "onnx" else there(name))


def test_nothing_is_missing_where_all_is_installed():
    pytest.importorskip("onnxruntime")
    assert extras.missing_for_onnx() is None


@pytest.mark.parametrize("asked", [True, False])
def test_check_names_the_extra_that_an_export_needs(without_onnx, tmp_path, capsys, asked):
    study = load_study("config/test.yaml")
    learning = study.learning.model_copy(update={"onnx": asked})
    write_yaml(tmp_path / "study.yaml", study.model_copy(update={"learning": learning}))
    code = main(["check", str(tmp_path / "study.yaml"), "--picture", str(tmp_path / "check.png")])
    said = capsys.readouterr().err
    assert (code == 1) == asked
    assert (
        'learning.onnx: true needs onnx, not installed; it comes with: pip install "gelforge[export]"' in said
    ) == asked
