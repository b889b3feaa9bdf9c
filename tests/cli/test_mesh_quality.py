"""Tested errors of the mesh: measured for what is shipped, and in the words of `gelforge check` and `gelforge press`."""

import pytest

from gelforge.api.studies import paper_study, sensor, sensors
from gelforge.cli import main
from gelforge.cli.study.mesh_quality import (
    mesh_error_words,
    read_mesh_errors,
    reference_mesh,
    write_mesh_errors,
)
from gelforge.config.parts.mechanics import QUALITIES


def with_mesh(study, **sizes):
    mesh = study.mechanics.mesh.model_copy(update=sizes)
    return study.model_copy(update={"mechanics": study.mechanics.model_copy(update={"mesh": mesh})})


def error_of(name, quality, near_mm):
    tested = read_mesh_errors()
    own = tested[(tested["sensor"] == name) & (tested["quality"] == quality)]
    return own[(own["near_mm"] - near_mm).abs() < 1e-3]["error_percent"].item()


@pytest.mark.parametrize("quality", QUALITIES)
@pytest.mark.parametrize("name", sensors())
def test_the_mesh_of_every_shipped_study_is_tested_in_every_quality(name, quality):
    study = with_mesh(sensor(name), quality=quality)
    error = error_of(name, quality, study.mechanics.mesh.used.near_mm)
    assert mesh_error_words(study).startswith(f"Fz within {error:.1f} %")


def test_the_articles_mesh_is_tested_and_another_mesh_or_sensor_is_not():
    study, error = paper_study(), error_of("paper", "standard", 0.3)
    assert mesh_error_words(study) == f"Fz within {error:.1f} % of a mesh of 0.15 mm (tested on paper)"
    assert mesh_error_words(with_mesh(study, near_mm=0.31)).startswith("not tested")
    assert mesh_error_words(with_mesh(study, elements="tetrahedra")).startswith("not tested")
    wide = study.sensor.model_copy(update={"width_x_mm": 33.0})
    assert mesh_error_words(study.model_copy(update={"sensor": wide})).startswith("not tested")


def test_words_of_an_untested_mesh_span_the_tested_errors(tmp_path):
    of_paper = read_mesh_errors().to_dict("records")[0] | {"near_mm": 9.0}
    rows = [of_paper | {"quality": "fast", "error_percent": error} for error in (0.4, 2.5)]
    write_mesh_errors(rows, "no machine", tmp_path / "errors.csv")
    words = mesh_error_words(
        with_mesh(paper_study(), quality="fast"), read_mesh_errors(tmp_path / "errors.csv")
    )
    assert "within 0.4 to 2.5 %" in words


def test_the_reference_has_half_the_default_sizes_whatever_the_quality():
    for quality in QUALITIES:
        assert reference_mesh(with_mesh(sensor("paper"), quality=quality)).used.near_mm == 0.15
    dome = sensor("dome")
    assert reference_mesh(dome).near_mm == dome.mechanics.mesh.near_mm / 2


def test_check_and_press_print_error_and_seconds(capsys, tmp_path, monkeypatch):
    assert main(["check", "config/smoke/paper.yaml", "--picture", str(tmp_path / "check.png")]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("mesh"))
    assert mesh_error_words(sensor("paper")) in line and "CPU s" in line
    assert (
        main(["press", "--x", "16", "--y", "16", "--depths", "0.5", "--study", "config/smoke/paper.yaml"])
        == 0
    )
    printed = " ".join(capsys.readouterr().out.split())
    assert mesh_error_words(sensor("paper")) in printed and "CPU s" in printed
