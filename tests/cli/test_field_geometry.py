"""Shared field cases: geometry and parameters that cannot be meant are refused in one line each."""

import os
from pathlib import Path

import pytest
from field_case import study_file

from gelforge.cli import main

ROOT = Path(__file__).parents[2]
CASES = Path(os.environ.get("GELFORGE_SHARED", ROOT.parent / "shared")) / "field_cases"
pytestmark = pytest.mark.skipif(
    not CASES.is_dir(), reason=f"the shared field cases are not in {CASES}; set GELFORGE_SHARED"
)


@pytest.mark.parametrize(
    ("case", "words"),
    [
        (
            "stl_indenters/study_off_origin",
            ["lies 126 mm next to the position", "origin_mm: [120.0, -40.0, 310.0]"],
        ),
        (
            "stl_sensor/gel_metres",
            ["0.02 x 0.02 mm wide, the sensor 20 x 20 mm", "in metres", "mm_per_unit: 1000"],
        ),
        ("stl_sensor/gel_centred_z_up", ["origin_mm: [-10.0, -10.0, 6.0]"]),
        ("stl_sensor/gap", ["gel and skin do not touch, they are 0.05 mm apart"]),
        ("stl_sensor/sunk", ["gel and skin reach 0.2 mm into one another", "layout_confirmed"]),
        ("stl_sensor/gel_hole", ["not closed: 3 open edges"]),
        ("stl_sensor/gel_one_flipped", ["face opposite ways"]),
        ("parameters_in_pascal/study", ["Young's modulus 120000 kPa", "in Pa?", "stiffness_confirmed"]),
        ("parameters_in_pascal/study_MPa", ["Young's modulus 0.12 kPa", "in MPa?", "stiffness_confirmed"]),
        ("ogden_convention/negative_alpha", ["convention: abaqus", "mu_k/alpha_k", "2 mu_k/alpha_k^2"]),
    ],
)
def test_check_refuses_in_one_line(case, words, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(ROOT)  # the cases name their files from the project's root
    if not Path("../shared/field_cases").is_dir():
        pytest.skip("the cases' files are named from ../shared of the project")
    assert (
        main(
            ["check", str(study_file(CASES / f"{case}.yaml", tmp_path)), "--picture", str(tmp_path / "p.png")]
        )
        == 1
    )
    error = capfd.readouterr().err
    assert len(error.splitlines()) == 1 and error.startswith(
        ("gelforge: sensor: ", "gelforge: indenter: ", "gelforge: /", "gelforge: mat")
    )
    for word in words:
        assert word in error


@pytest.mark.parametrize(
    ("indenter", "words"),
    [
        ("ball_metres", "a body of 0.01 mm on a sensor of 20 mm.* in metres\\? set mm_per_unit: 1000"),
        ("ball_off_origin", "lies 126 mm next to the position"),
        ("ball_open", "not closed: 88 open edges"),
        ("cone", "touches only"),
        ("ball_good", None),
        ("ball_inside_out", None),
        ("ball_and_rod_overlap", None),
        ("sphere", None),
    ],
)
def test_indenters_from_files(indenter, words, monkeypatch):
    from gelforge.cli.by_hand.press import described_press
    from gelforge.config import ConfigError
    from gelforge.indentation.planning.plan import check_inside, press_path

    monkeypatch.chdir(ROOT)
    if not Path("../shared/field_cases").is_dir():
        pytest.skip("the cases' files are named from ../shared of the project")
    study = described_press(CASES / "stl_sensor/block.yaml", CASES / "stl_indenters" / f"{indenter}.yaml")
    planned = {"press": press_path("press", 10.0, 10.0, [0.4, 1.0], None, False)}
    if words:
        with pytest.raises(ConfigError, match=words):
            check_inside(planned, study)
    else:
        check_inside(planned, study)
