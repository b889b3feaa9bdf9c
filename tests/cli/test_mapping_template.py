"""`gelforge init` leaves a mapping of material tests that reads once its columns are there, and the shipped examples."""

import numpy as np
import pytest

from gelforge.cli import main
from gelforge.config.foreign.mapping import load_mapping


@pytest.mark.parametrize("sensor", [(), ("--sensor", "digit")], ids=["own", "shipped"])
def test_a_new_study_has_a_mapping_that_reads_a_machines_tables(tmp_path, monkeypatch, sensor, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["init", "mine", *sensor]) == 0
    template = tmp_path / "data/mine/materials/mapping.yaml"
    assert load_mapping(template).entry_for("tension_1.csv").kind == "uniaxial"
    assert "data/mine/materials/mapping.yaml" in capsys.readouterr().out
    examples = sorted((tmp_path / "config/mappings").glob("*.yaml"))
    assert len(examples) >= 10 and all(load_mapping(path).tests for path in examples)

    folder = tmp_path / "data/mine/materials/gel"
    folder.mkdir(exist_ok=True)
    (folder / "samples.csv").unlink(missing_ok=True)
    stretch = np.linspace(1, 1.8, 40)
    for k, scale in enumerate((0.98, 1.03)):
        force = scale * 20 * 0.04 * (stretch - stretch**-2)  # N, mu = 40 kPa
        rows = "".join(
            f"{t:.2f},{40 * (lam - 1):.5f},{f:.5f}\n" for t, (lam, f) in enumerate(zip(stretch, force))
        )
        (folder / f"tension_{k}.csv").write_text("Time,Extension,Load\n" + rows)
    arguments = ["--mapping", str(template), "--laws", "neo_hooke", "--out", "try"]
    assert main(["characterise", str(folder), *arguments]) == 0
    assert (tmp_path / "try").is_dir() and list((tmp_path / "try").rglob("law.json"))
