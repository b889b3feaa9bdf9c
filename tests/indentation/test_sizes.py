"""Sizes in another unit than mm, origins next to the body: asked about, with the key that mends or confirms."""

import re

import meshio
import numpy as np
import pytest
import specimens
import yaml

from gelforge.cli import main
from gelforge.config import ConfigError, write_yaml
from gelforge.indentation.planning.plan import plan_cells
from gelforge.indentation.sensor.sensor_mesh import sensor_solids
from gelforge.indentation.sensor.sizes import check_sensor_size
from gelforge.mechanics.indenters.closed_surface import SurfaceError
from gelforge.mechanics.indenters.shapes import rotation_about_axes
from gelforge.meshing.solids import _box, block_solids

PLAN = {"grid": {"spacing_mm": 3.0, "margin_mm": 6.0}, "depths_mm": [0.4, 0.8]}


def sensor(width, height, **keys):
    layers = [{"name": "gel", "thickness_mm": height, "material": "soft"}]
    sizes = {"width_x_mm": width, "width_y_mm": width, "layers": layers, "wall_mm": 0.0}
    plan = {"grid": {"spacing_mm": width, "margin_mm": width / 3}, "depths_mm": [height / 20]}
    return specimens.study(plan=plan, sensor=sizes | keys).sensor


@pytest.mark.parametrize(
    ("width", "height", "unit"),
    [
        (0.032, 0.006, "metres"),
        (32 / 25.4, 6 / 25.4, "inches"),
        (32e3, 6e3, "micrometres"),
        (32 * 25.4, 6 * 25.4, None),
        (32.0, 0.006, "metres"),
        (0.5, 0.1, "inches"),
        (1000.0, 20.0, None),
    ],
)
def test_sensors_of_another_unit_are_asked_about_and_can_be_confirmed(width, height, unit):
    with pytest.raises(ConfigError, match="size_confirmed: true") as refused:
        check_sensor_size(sensor(width, height))
    assert (f"in {unit}?" in str(refused.value)) == bool(unit)
    assert "\n" not in str(refused.value)
    check_sensor_size(sensor(width, height, size_confirmed=True))


@pytest.mark.parametrize(
    ("width", "height"), [(4.0, 2.0), (32.0, 6.0), (20.0, 0.3), (12.0, 30.0), (320.0, 60.0)]
)
def test_usual_sensors_pass(width, height):
    check_sensor_size(sensor(width, height))


def test_small_sensors_fine_pins_and_large_plates_can_be_confirmed():
    # A confirmed sensor of half a millimetre is planned
    layers = [{"name": "gel", "thickness_mm": 0.1, "material": "soft"}]
    sizes = {"width_x_mm": 0.5, "width_y_mm": 0.5, "layers": layers, "wall_mm": 0.0, "size_confirmed": True}
    plan = {"grid": {"spacing_mm": 0.1, "margin_mm": 0.2}, "depths_mm": [0.01]}
    small = specimens.study(
        plan=plan, sensor=sizes, indenter={"radius_mm": 0.1}, mesh={"near_mm": 0.02, "far_mm": 0.05}
    )
    assert len(plan_cells(small)) == 4

    # A fine pin and a large plate can be confirmed
    fine = {"mesh": {"near_mm": 0.04, "near_radius_mm": 0.5, "far_mm": 2.0}}
    pin = {"kind": "cylinder", "radius_mm": 0.15, "length_mm": 8.0, "edge_radius_mm": 0.05}
    plate = {"kind": "box", "size_mm": [80.0, 80.0, 4.0], "edge_radius_mm": 0.5}
    for indenter in (pin, plate):
        with pytest.raises(ConfigError, match="size_confirmed: true"):
            planned(indenter, **fine)
        assert planned(indenter | {"size_confirmed": True}, **fine)
    assert planned(pin | {"radius_mm": 0.5}, **fine)  # a pin of 1 mm needs no word


# ---------------------------------------------------------------------------------------------- files of a sensor
def surfaces(folder, move=lambda vertices: vertices, **keys):
    """Return the sensor whose layers are files: the small sensor's, moved."""
    files = {}
    for name, (vertices, triangles) in zip(("gel", "skin"), block_solids(specimens.BLOCK).drafts):
        files[name] = str(folder / f"{name}.stl")
        meshio.write(files[name], meshio.Mesh(move(vertices), [("triangle", triangles)]), binary=True)
    shape = {"kind": "surfaces", "files": files} | keys
    return specimens.study(plan=PLAN, sensor={"shape": shape, "wall_mm": 0.0}).sensor


def mended(sensor, message):
    """Return the sensor with the keys of its shape that a message names."""
    keys = {}
    if found := re.search(r"set shape\.(mm_per_unit|origin_mm): ([^,]*(?:, [-\d.]+, [-\d.]+\])?)", message):
        keys[found[1]] = yaml.safe_load(found[2])
    assert keys, message
    shape = sensor.shape.model_copy(update=keys)
    return sensor.model_copy(update={"shape": shape})


@pytest.mark.parametrize(
    ("factor", "unit"),
    [
        (1e-3, "metres"),
        (1 / 25.4, "inches"),
        (1e3, "micrometres"),
        (0.1, "cent"),
        (25.4, "mm, 25.4 times too large"),
    ],
)
def test_the_unit_of_surface_files_is_asked_about(tmp_path, factor, unit):
    wrong = surfaces(tmp_path, lambda v: v * factor)
    with pytest.raises(SurfaceError, match=f"are the files in {unit}") as refused:
        sensor_solids(wrong)
    low, high = sensor_solids(mended(wrong, str(refused.value))).bounds
    assert np.allclose([low, high], [[0, 0, -4], [16, 16, 0]], atol=2e-3)


@pytest.mark.parametrize("turn", [[0.0, 0.0, 0.0], [180.0, 0.0, 0.0], [90.0, 0.0, 90.0]])
def test_a_sensor_drawn_elsewhere_is_moved_by_the_key_that_is_named(tmp_path, turn):
    R = rotation_about_axes(turn)
    drawn = surfaces(tmp_path, lambda v: (v - [8.0, 8.0, -4.0]) @ R + [1.0, 2.0, 3.0], orientation_deg=turn)
    with pytest.raises(SurfaceError, match=r"set shape\.origin_mm") as refused:
        sensor_solids(drawn)
    low, high = sensor_solids(mended(drawn, str(refused.value))).bounds
    assert np.allclose([low, high], [[0, 0, -4], [16, 16, 0]], atol=1e-3)


def test_placing_keys_belong_to_files_whose_unit_is_asked_about(tmp_path):
    # Placing keys belong to files
    with pytest.raises(ConfigError, match=r"\['origin_mm'\] belong to kind: surfaces"):
        specimens.study(sensor={"shape": {"kind": "dome", "origin_mm": [1.0, 0.0, 0.0]}})

    # Files in millimetres that are called metres are asked about
    with pytest.raises(SurfaceError, match=r"are the files in mm\? set shape\.mm_per_unit: 1,"):
        sensor_solids(surfaces(tmp_path, mm_per_unit=1000.0))


# -------------------------------------------------------------------------------------------------- the indenter
def body(folder, factor=1.0, shift=(0.0, 0.0, 0.0), **keys):
    """Return an indenter from a file: a block of 4 x 4 x 5 mm about its lower face's middle, in another unit or moved."""
    vertices, triangles = _box([-2.0, -2.0, 0.0], [2.0, 2.0, 5.0])
    path = folder / "body.stl"
    meshio.write(path, meshio.Mesh(factor * (vertices + shift), [("triangle", triangles)]), binary=True)
    return {"kind": "mesh", "file": str(path), "edge_radius_mm": 0.5} | keys


def planned(indenter, **keys):
    return plan_cells(specimens.study(plan=PLAN, indenter=indenter, **keys))


@pytest.mark.parametrize(("factor", "unit", "key"), [(1e-3, "metres", "1000"), (1 / 25.4, "inches", "25.4")])
def test_the_unit_of_an_indenters_file_is_asked_about(tmp_path, factor, unit, key):
    wrong = body(tmp_path, factor)
    with pytest.raises(ConfigError, match=f"body.stl in {unit}\\? set mm_per_unit: {key};"):
        planned(wrong)
    assert planned(wrong | {"mm_per_unit": float(key)})


@pytest.mark.parametrize(
    ("indenter", "words"),
    [
        ({"radius_mm": 0.005}, "a body of 0.01 mm on a sensor of 16 mm.*in metres"),
        ({"radius_mm": 5000.0}, "in micrometres"),
        ({"kind": "box", "size_mm": [6e3, 6e3, 6e3], "edge_radius_mm": 1.0}, "in micrometres"),
        (
            {
                "kind": "several",
                "parts": [{"radius_mm": 3.0}, {"radius_mm": 0.003, "offset_mm": [5.0, 0.0, 0.0]}],
            },
            "indenter, part 2: a body of 0.006 mm",
        ),
    ],
)
def test_indenters_of_another_unit_are_asked_about(indenter, words):
    with pytest.raises(ConfigError, match=f"{words}.*size_confirmed: true"):
        planned(indenter)


def test_a_file_whose_body_lies_beside_its_origin_is_asked_about(tmp_path):
    away = body(tmp_path, shift=(120.0, -40.0, 310.0))
    with pytest.raises(ConfigError, match=r"lies 126 mm next to the position") as refused:
        planned(away)
    assert "set origin_mm: [120.0, -40.0, 310.0]" in str(refused.value) and "origin_mm: [0, 0, 0]" in str(
        refused.value
    )
    assert planned(away | {"origin_mm": [120.0, -40.0, 310.0]})
    with pytest.raises(ConfigError, match="no depth touches: .* lies next to the sensor, 126 mm"):
        planned(away | {"origin_mm": [0.0, 0.0, 0.0]})

    # A finger that presses 3 mm next to the position on purpose; and one whose file puts the
    # position under its edge.
    beside = body(tmp_path, shift=(3.0, 0.0, 0.0))
    with pytest.raises(ConfigError, match="lies 3 mm next to the position"):
        planned(beside)
    assert planned(beside | {"origin_mm": [0.0, 0.0, 0.0]})
    assert planned(body(tmp_path, shift=(1.9, 0.0, 0.0)))

    # The named origin is that of the file also where it is turned
    turned = body(tmp_path, shift=(30.0, 0.0, 0.0), orientation_deg=[0.0, 0.0, 90.0])
    with pytest.raises(ConfigError, match=re.escape("set origin_mm: [30.0, 0.0, 0.0]")):
        planned(turned)


def test_check_refuses_without_a_warning(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    study = specimens.study(plan=PLAN).model_dump(mode="json")
    write_yaml(tmp_path / "s.yaml", study | {"indenter": body(tmp_path, shift=(120.0, 0.0, 0.0))})
    assert main(["check", "s.yaml"]) == 1
    assert len(capfd.readouterr().err.splitlines()) == 1
