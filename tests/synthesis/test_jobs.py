"""The jobs of a simulated training set, as the workflow calls them."""

import yaml
from small_synthesis import study_of

from gelforge.cli import main
from gelforge.dataset.shard import ShardDataset


def test_a_press_is_solved_for_its_rows_and_a_study_without_a_set_is_refused(tmp_path, capfd):
    # A press is solved and rows are drawn from it
    of_presses = tmp_path / "of_presses"
    of_presses.mkdir()
    study = study_of(
        paths=1, rows=40, rows_per_shard=32, classes={"straight": 0, "light": 0}, depth_mm=[0.4, 0.5]
    )
    file, law = of_presses / "study.yaml", of_presses / "soft" / "law.json"
    file.write_text(yaml.safe_dump(study.model_dump(mode="json")), encoding="utf-8")
    assert main(["fit-law", "--study", str(file), "--material", "soft", "--out", str(law.parent)]) == 0
    solved, rows = of_presses / "solved.h5", of_presses / "rows.h5"
    job = ["solve-synthesis", "--study", str(file), "--laws", str(law), "--out", str(solved)]
    assert main([*job, "--number", "0"]) == 0
    assert "path00000: " in capfd.readouterr().out
    draw = ["synthesise", "--study", str(file), "--solved", str(solved), "--out", str(rows)]
    assert main([*draw, "--number", "1"]) == 0
    assert "8 rows of 1 image series from 1 solved presses" in capfd.readouterr().out
    assert len(ShardDataset([rows])) == 8
    assert main([*job, "--number", "1"]) == 1
    assert main([*draw, "--number", "2"]) == 1
    assert "shard 2 does not exist; the study has 0 to 1" in capfd.readouterr().err

    # A study without a training set is refused
    without_set = tmp_path / "without_set"
    without_set.mkdir()
    study = study_of().model_copy(update={"synthesis": None})
    file = without_set / "study.yaml"
    file.write_text(yaml.safe_dump(study.model_dump(mode="json", exclude={"synthesis"})), encoding="utf-8")
    solved = str(without_set / "solved.h5")
    assert (
        main(["synthesise", "--study", str(file), "--solved", solved, "--out", solved, "--number", "0"]) == 1
    )
    assert "the study has no synthesis; describe a simulated training set there" in capfd.readouterr().err
