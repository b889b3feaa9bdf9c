"""The mesher's process: what it is asked, and what it says when it cannot."""

import numpy as np
import pytest
import specimens
from small_shapes import SHAPES

from gelforge.config import ConfigError
from gelforge.indentation.sensor.sensor_mesh import sensor_mesh
from gelforge.meshing import tetwild
from gelforge.meshing.tetwild import TetwildError, tetrahedralize


def test_the_sizing_field_and_the_mesh_fill_the_box():
    points, tetrahedra = tetwild._background(np.array([-1.0, 0.0, -2.0]), np.array([3.0, 1.0, 0.5]))
    corner = points[tetrahedra]
    volume = np.linalg.det(corner[:, 1:] - corner[:, :1]) / 6
    assert volume.min() > 0
    assert volume.sum() == pytest.approx(4 * 1 * 2.5)

    # Tetrahedra fill the box around and are upright
    vertices, triangles = SHAPES["block"][0].drafts[-1]
    X, tetrahedra = tetrahedralize(vertices, triangles, lambda p: np.full(len(p), 3.0), 3.0, 0.05)
    corner = X[tetrahedra]
    volume = np.linalg.det(corner[:, 1:] - corner[:, :1]) / 6
    assert volume.min() > 0
    assert volume.sum() == pytest.approx(np.prod(np.ptp(X, axis=0)))


def test_a_mesher_that_is_refused_fails_or_has_no_memory_says_so(tmp_path, monkeypatch):
    # A library without the call is refused. Where std::random_device cannot be held the mesh would not repeat
    library = tmp_path / "library.so"
    library.write_bytes(b"MZ" + bytes(100))
    with pytest.raises(TetwildError, match="meshes repeat on Linux only"):
        tetwild._fix_random_device(str(library))

    # What the mesher says is passed on
    tetwild._meshed.cache_clear()
    monkeypatch.setattr(tetwild.sys, "executable", "/bin/false")
    vertices, triangles = SHAPES["block"][0].drafts[-1]
    with pytest.raises(TetwildError, match=r"exit 1.*it said nothing"):
        tetrahedralize(vertices, triangles, lambda p: np.full(len(p), 3.0), 3.0, 0.05)

    # A mesher without memory is an error of ours on one line
    mesher = tmp_path / "mesher"
    mesher.write_text("#!/bin/sh\nprintf 'terminate called\\n  what():  std::bad_alloc\\n' >&2\nexit 134\n")
    mesher.chmod(0o755)
    monkeypatch.setattr(tetwild.sys, "executable", str(mesher))
    study = specimens.study(sensor={"shape": {"kind": "dome"}, "wall_mm": 0.0})
    with pytest.raises(ConfigError) as refused:
        sensor_mesh(study.sensor, study.mechanics.mesh, *specimens.CENTRE)
    assert "exit 134" in str(refused.value) and "std::bad_alloc, too little memory" in str(refused.value)
    assert "\n" not in str(refused.value)
