"""Shipped sensors: every number has its source, a study of one is ready to run, pictures show the cut."""

import re
import runpy
import shutil
from pathlib import Path

import meshio
import numpy as np
import pytest

from gelforge.api.studies import sensors as sensor_names
from gelforge.cli import main
from gelforge.config import Session, load_session, load_study, section_from
from gelforge.config.foreign.importing import load_import
from gelforge.indentation.planning.plan import plan_cells
from gelforge.mechanics.meshes.mesh import Block
from gelforge.meshing.solids import block_solids
from gelforge.report.figures.simulation.cross_section import cross_section, section_loops

ROOT = Path(__file__).parents[2]
DESCRIPTIONS = [
    path for folder in ("sensors", "cameras") for path in (ROOT / "config" / folder).glob("*.yaml")
]


@pytest.fixture
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def numbers_without_source(text: str) -> list[str]:
    """Return the lines that hold a number and have no comment, nor has the key that they stand under."""
    without, over = [], {}
    for line in text.splitlines():
        key, _, comment = line.partition("#")
        indent = len(key) - len(key.lstrip(" -"))
        over = {depth: said for depth, said in over.items() if depth < indent} | {indent: bool(comment)}
        nearest = [said for depth, said in sorted(over.items()) if depth < indent][-1:]
        if re.search(r":.*\d", key) and not comment and nearest != [True]:
            without.append(line)
    return without


@pytest.mark.parametrize("path", DESCRIPTIONS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_every_number_says_where_it_is_from(path):
    assert numbers_without_source(path.read_text()) == []


def test_every_sensor_has_a_study_and_the_digit_the_surface_of_its_script(tmp_path):
    # Every sensor has a study and the names agree
    assert {"paper", "gelsight_mini", "digit", "9dtact", "dome", "tactip"} == set(sensor_names())
    assert {path.stem for path in (ROOT / "config/sensors").glob("*.yaml")} == set(sensor_names())
    assert {path.stem for path in (ROOT / "config/cameras").glob("*.yaml")} <= set(sensor_names())

    # The surface of the digit is what its script writes
    script = shutil.copy(ROOT / "config/sensors/make_digit.py", tmp_path)
    runpy.run_path(script, run_name="__main__")
    new, shipped = (meshio.read(folder / "digit.stl") for folder in (tmp_path, ROOT / "config/sensors"))
    assert np.array_equal(new.points, shipped.points)
    assert np.allclose([np.ptp(new.points, axis=0)], [[18.4, 25.0, 4.07]], atol=1e-5)

    # A cut through a box is its rectangle
    (box,) = block_solids(Block(4.0, 6.0, (("gel", 3.0),), 0.0)).surfaces
    (loop,) = section_loops(box, 1, 2.0)
    x, z = loop[:, 0], loop[:, 2]
    assert np.allclose(loop[:, 1], 2.0)
    assert abs(np.dot(x, np.roll(z, 1)) - np.dot(z, np.roll(x, 1))) / 2 == pytest.approx(12.0)


@pytest.mark.parametrize("sensor", sensor_names())
def test_a_study_of_a_shipped_sensor_is_complete(empty_folder, capsys, sensor):
    assert main(["init", "mine", "--sensor", sensor]) == 0
    assert capsys.readouterr().out.endswith("gelforge check mine, then: snakemake --cores 2\n")
    study = load_study("config/mine.yaml")
    assert study.study == "mine" and study.results_folder == Path("results/mine")
    assert "config/smoke" not in Path("config/mine.yaml").read_text()
    assert all(path.is_file() for path in study.sensor.shape.files.values())
    middle = (study.sensor.width_x_mm / 2, study.sensor.width_y_mm / 2)
    places = [(cell.x_mm, cell.y_mm) for cell in plan_cells(study).values()]
    assert 3 <= len(places) <= 16 and np.linalg.norm(np.array(places) - middle, axis=1).min() < 0.1
    session = load_session(Path("data/mine/recordings/session1/session.yaml"))
    assert session.indenter == study.indenter.words
    assert (session.camera is not None) == (ROOT / f"config/cameras/{sensor}.yaml").is_file()
    assert 'configfile: "config/mine.yaml"' in Path("Snakefile").read_text()
    logs = load_import("data/mine/logs.yaml")
    described = section_from(Session, {**logs.session, "session": "monday"}, "logs.yaml")
    assert (described.camera, described.indenter) == (session.camera, session.indenter)
    assert list(Path("config/mappings").glob("*.yaml"))


def test_a_second_study_keeps_the_sensor_that_was_edited(empty_folder, capsys):
    assert main(["init", "mine", "--sensor", "dome"]) == 0
    sensor = Path("config/sensors/dome.yaml")
    sensor.write_text(sensor.read_text().replace("thickness_mm: 1.5", "thickness_mm: 1.2"))
    assert main(["init", "other", "--sensor", "dome"]) == 0
    assert capsys.readouterr().out.endswith("snakemake --cores 2 --configfile config/other.yaml\n")
    assert load_study("config/other.yaml").sensor.layers[-1].thickness_mm == 1.2


@pytest.mark.parametrize(
    ("given", "near"), [("gelsight-mni", "gelsight_mini"), ("DIGIT", "digit"), ("tac", "tactip")]
)
def test_an_unknown_sensor_is_answered_with_the_nearest(empty_folder, capsys, given, near):
    assert main(["init", "mine", "--sensor", given]) == 1
    assert (
        f"{given!r} is no sensor that is shipped; did you mean {near}? there are" in capsys.readouterr().err
    )
    assert not list(empty_folder.iterdir())


def test_the_picture_names_sizes_layers_and_stiffness(empty_folder):
    main(["init", "mine", "--sensor", "9dtact"])
    figure = cross_section(load_study("config/mine.yaml"), "mine")
    words = "\n".join(text.get_text() for ax in figure.axes for text in ax.texts)
    for said in ("31.1 mm", "24.1 mm", "0.3", "wall 0.8 mm", "ball of radius 4 mm"):
        assert said in words
    legend = "\n".join(text.get_text() for text in figure.legends[0].get_texts())
    assert "translucent: 2.5 mm of translucent_gel, shear modulus 137.6 kPa" in legend
