"""Tested errors of the mesh: measured for what is shipped, and in the words of `gelforge check` and `gelforge press`."""

import pytest

from gelforge.api.studies import paper_study, sensor
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


TESTED = read_mesh_errors().to_dict("records")


@pytest.mark.parametrize("row", TESTED, ids=lambda row: f"{row['sensor']}-{row['near_mm']:g}")
def test_a_tested_mesh_of_a_shipped_sensor_has_its_own_error(row):
    sizes = {"near_mm": row["near_mm"], "far_mm": row["far_mm"]}
    factor = QUALITIES[row["quality"]].sizes
    study = with_mesh(
        sensor(row["sensor"]),
        quality=row["quality"],
        **{name: value / factor for name, value in sizes.items()},
    )
    assert mesh_error_words(study).startswith(f"Fz within {row['error_percent']:.1f} % of a mesh of ")


@pytest.mark.parametrize("quality", QUALITIES)
def test_the_mesh_of_a_shipped_study_is_tested_in_every_quality(quality):
    words = mesh_error_words(with_mesh(sensor("9dtact"), quality=quality))
    assert words.endswith("% of a mesh of 0.15 mm (tested on 9dtact)")


def test_the_reference_has_half_the_default_sizes_and_other_meshes_are_not_tested(tmp_path):
    # The reference has half the default sizes whatever the quality
    for quality in QUALITIES:
        assert reference_mesh(with_mesh(sensor("paper"), quality=quality)).used.near_mm == 0.15
    dome = sensor("dome")
    assert reference_mesh(dome).near_mm == dome.mechanics.mesh.near_mm / 2

    # Another mesh or sensor is not tested
    study = sensor("9dtact")
    assert mesh_error_words(with_mesh(study, near_mm=0.31)).startswith("not tested")
    assert mesh_error_words(with_mesh(study, elements="tetrahedra")).startswith("not tested")
    wide = study.sensor.model_copy(update={"width_x_mm": 33.0})
    assert mesh_error_words(study.model_copy(update={"sensor": wide})).startswith("not tested")

    # Words of an untested mesh span the tested errors
    of_paper = read_mesh_errors().to_dict("records")[0] | {"near_mm": 9.0}
    rows = [of_paper | {"quality": "fast", "error_percent": error} for error in (0.4, 2.5)]
    write_mesh_errors(rows, "no machine", tmp_path / "errors.csv")
    words = mesh_error_words(
        with_mesh(paper_study(), quality="fast"), read_mesh_errors(tmp_path / "errors.csv")
    )
    assert "within 0.4 to 2.5 %" in words


def test_check_and_press_print_error_and_seconds(capsys, tmp_path):
    study, words = "config/smoke/9dtact.yaml", mesh_error_words(sensor("9dtact"))
    assert main(["check", study, "--picture", str(tmp_path / "check.png")]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("mesh"))
    assert words in line and "CPU s" in line
    assert main(["press", "--x", "12", "--y", "12", "--depths", "0.25", "--study", study]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert words in printed and "CPU s" in printed
