"""`gelforge model`: which sensors have a study, what its folder holds, which jobs build the model."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from gelforge.cli import main
from gelforge.cli.model import build
from gelforge.cli.study.shipped_sensors import sensor_files
from gelforge.config import load_study
from gelforge.synthesis.draws import shard_count, solution, solution_count

ROOT = Path(__file__).parents[2]
STUDIES = sorted(path.stem for path in (ROOT / "config/models").glob("*.yaml"))


@pytest.fixture
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_sensor_without_a_study_is_told_which_have_one(tmp_path, monkeypatch, capsys):
    assert main(["model", "--sensor", "digit", "--out", str(tmp_path / "mine")]) == 1
    assert f"there is one for {', '.join(STUDIES)}" in capsys.readouterr().err
    assert not (tmp_path / "mine").exists()
    (tmp_path / "config/models").mkdir(parents=True)
    for name in ("b", "a"):
        (tmp_path / f"config/models/{name}.yaml").touch()
    monkeypatch.setattr(build, "EXAMPLES", tmp_path)
    assert main(["model", "--sensor", "digit", "--out", str(tmp_path / "mine")]) == 1
    assert "there is one for a, b." in capsys.readouterr().err


@pytest.mark.parametrize("sensor", STUDIES)
def test_a_folder_is_ready_to_solve_draw_and_train(empty_folder, sensor):
    written = build.write_files(sensor)
    assert {build.MODELS / f"{sensor}.yaml", *sensor_files(sensor), Path("Snakefile")} <= set(written)
    study = load_study(build.model_study(sensor))
    target = str(study.results_folder / "model/model.pt")
    ran = subprocess.run(
        [sys.executable, "-m", "snakemake", target, "-n", "--quiet", "rules"], capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    jobs = dict(line.split() for line in ran.stdout.splitlines() if re.fullmatch(r"\w+ +\d+", line))
    assert int(jobs["solve_synthesis"]) == solution_count(study)
    assert int(jobs["synthesise"]) == shard_count(study)
    assert jobs["train"] == "1"
    assert not {"simulate", "features", "report"} & set(jobs)


@pytest.mark.parametrize("sensor", STUDIES)
def test_every_press_of_a_shipped_study_fits_its_sensor(empty_folder, sensor):
    build.write_files(sensor)
    study = load_study(build.model_study(sensor))
    kinds = {
        solution(study, k).kind for k in range(solution_count(study))
    }  # refused where one leaves the sensor
    assert {"site", "ball", "punch", "edge"} <= kinds


def test_an_edited_study_stays_and_the_last_words_name_the_next_commands(empty_folder):
    # An edited study stays
    build.write_files("gelsight_mini")
    file = build.model_study("gelsight_mini")
    file.write_text(file.read_text().replace("rows: 12000", "rows: 500"))
    assert build.write_files("gelsight_mini") == []
    assert load_study(file).synthesis.rows == 500

    # The last words name the next commands and what was never tried
    words = build.what_next(Path("mini"), Path("config/models/x.yaml"), Path("results/x/model/model.pt"))
    assert "SYNTHETIC" in words and "never tried on real images" in words
    assert "gelforge live 0 --model mini/results/x/model/model.pt" in words
    assert "gelforge adapt --study config/models/x.yaml" in words
