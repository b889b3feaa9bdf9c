"""The mesh of a press in a file that other programs read: what it holds, and what is refused."""

import meshio
import numpy as np
import pytest
import specimens
import yaml
from numpy.testing import assert_allclose

from gelforge.cli import main
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.solving.model import model_of


@pytest.fixture
def study_file(tmp_path):
    """Return a YAML file of the small sensor with a gel that is 0.5 mm thicker than drawn."""
    thicker = {"geometry": {"thickness": {"gel": {"change_mm": 0.5}}}}
    study = specimens.study(effects=thicker)
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(study.model_dump(mode="json")))
    return path, study


def volumes(X, elements):
    """Return the volumes [mm^3] of hexahedra whose edges run along the axes."""
    return np.prod(X[elements].max(axis=1) - X[elements].min(axis=1), axis=1)


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".msh"])
def test_a_mesh_is_written_with_its_layers_as_they_really_are(study_file, tmp_path, capsys, suffix):
    path, study = study_file
    out = tmp_path / "new" / f"mesh{suffix}"
    command = [
        "mesh",
        "--x",
        "10.9",
        "--y",
        "10.3",
        "--depth",
        "0.8",
        "--study",
        str(path),
        "--out",
        str(out),
    ]
    assert main(command) == 0
    printed = capsys.readouterr().out
    assert "region 0: gel" in printed and "region 1: skin" in printed and "region 2: wall" in printed
    read = meshio.read(out)
    (block,) = read.cells
    region = read.cell_data["region"][0]
    assert block.type == "hexahedron"
    # 14 x 14 mm of gel inside a wall of 1 mm, drawn 3 mm thick, really 3.5 mm; 16 x 16 mm of skin, 1 mm
    volume = [volumes(read.points, block.data)[region == number].sum() for number in range(3)]
    assert_allclose(volume, [14 * 14 * 3.5, 16 * 16 * 1.0, (16 * 16 - 14 * 14) * 3.5], rtol=1e-10)
    assert_allclose(read.points[read.point_data["fixed"] == 1, 2], -4.5)
    laws = {"gel": specimens.GEL, "skin": specimens.SKIN}
    solved = model_of(
        study.sensor, study.indenter, study.mechanics, laws, Trajectory(10.9, 10.3, (0.8,), ("load",))
    ).mesh
    assert_allclose(read.points, solved.X, atol=1e-12)  # the very mesh that is solved
    assert (block.data == solved.elements).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"--out": "mesh.stl"}, "meshes are written as .vtu, .vtk, .msh, found '.stl'; rename it"),
        ({"--depth": "2.9"}, "would pierce the soft layers"),
        ({"--x": "17"}, "lies outside the sensor"),
    ],
)
def test_a_mesh_that_cannot_be_made_is_refused(study_file, tmp_path, capsys, monkeypatch, change, words):
    monkeypatch.chdir(tmp_path)
    keys = {
        "--x": "8",
        "--y": "8",
        "--depth": "0.8",
        "--study": str(study_file[0]),
        "--out": "mesh.vtu",
    } | change
    assert main(["mesh", *(part for pair in keys.items() for part in pair)]) == 1
    assert words in capsys.readouterr().err
    assert not list(tmp_path.glob("mesh.*"))
