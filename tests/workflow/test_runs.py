"""The test study from raw inputs to the report, and what is made again when something changes."""

import os
import signal
import subprocess
import sys
import time

import pytest
import yaml
from conftest import HOSTILE

pytestmark = pytest.mark.workflow
TEST = ("--configfile", "config/test.yaml")
RESULTS = "results/test"
LEARNING = {"train", "evaluate"}


def test_the_study_runs_to_its_report_and_a_second_run_does_nothing(finished):
    for name in (
        "study.yaml",
        "plan.csv",
        "materials/ecoflex_gel/law.json",
        "materials/elastosil_25_1/law.json",
        "recordings/morning.csv",
        "features/evening.h5",
        "dataset/manifest.json",
        "dataset/SHA256SUMS",
        "agreement.csv",
        "model/model.pt",
        "model/predictions.h5",
        "report.html",
    ):
        assert (finished.folder / RESULTS / name).stat().st_size > 0, name
    assert len(finished.files(f"{RESULTS}/cells/*.h5")) == 9
    for table in ("material", "rmse_gt", "rmse", "force_ranges", "baselines", "verification"):
        for suffix in ("csv", "md"):
            assert (finished.folder / RESULTS / "tables" / f"{table}.{suffix}").is_file(), table

    # Checksums hold
    subprocess.run(
        ["sha256sum", "--check", "--quiet", "SHA256SUMS"],
        cwd=finished.folder / RESULTS / "dataset",
        check=True,
    )

    # A second run does nothing
    assert finished.jobs(*TEST) == {}

    # Synthetic recordings say so
    session = yaml.safe_load((finished.folder / HOSTILE / "recordings/morning/session.yaml").read_text())
    assert session["synthetic"] is True
    assert "synthetic" in (finished.folder / RESULTS / "report.html").read_text().lower()
    assert "synthetic" in (finished.folder / RESULTS / "dataset/README.md").read_text().lower()


def test_it_runs_in_a_folder_with_a_space_and_a_quote(finished):
    """And from a data folder that is named like commands, which no shell executes."""
    assert " " in finished.folder.name and "'" in finished.folder.name
    assert (finished.folder / HOSTILE / "virtual_truth/cells/x1_y1.h5").is_file()
    assert [path for name in "YZW" for path in finished.folder.rglob(name)] == []


@pytest.mark.thorough
def test_deleted_tables_need_no_cell_and_no_training(again):
    for path in (again.folder / RESULTS / "tables").iterdir():
        path.unlink()
    assert again.jobs("tables", *TEST) == {"tables": 1}
    again.snakemake("tables", "--cores", "1", *TEST)
    assert (again.folder / RESULTS / "tables/rmse.csv").is_file()


def test_training_settings_rerun_training_and_what_follows(again):
    path = again.folder / "config/test.yaml"
    content = yaml.safe_load(path.read_text())
    content["learning"]["steps"] += 1
    path.write_text(yaml.safe_dump(content))
    jobs = again.jobs(*TEST)
    assert LEARNING <= set(jobs)
    assert not {"simulate", "features", "characterise", "join", "virtual_cell", "virtual_session"} & set(jobs)


@pytest.mark.thorough
def test_every_file_of_a_material_reruns_its_characterisation(again):
    """Whatever decides it: here the sidecar of a press, which is no table; pictures and mappings are listed the same way."""
    folder, law = (
        again.folder / "data/demo/materials/ecoflex_gel",
        f"{RESULTS}/materials/ecoflex_gel/law.json",
    )
    assert "characterise" not in again.jobs(law, *TEST)
    rows = "".join(f"{k / 100 - 0.1},{max(k - 10, 0) ** 1.5 / 100}\n" for k in range(40))
    (folder / "ball.csv").write_text("depth_mm,force_N\n" + rows)
    (folder / "ball.yaml").write_text("ball_radius_mm: 2\n")
    assert again.jobs(law, *TEST)["characterise"] == 1
    again.snakemake(law, "--cores", "1", *TEST)
    assert b"microindentation" in (again.folder / RESULTS / "materials/ecoflex_gel/effects.csv").read_bytes()
    (folder / "ball.yaml").write_text("ball_radius_mm: 3\n")
    assert again.jobs(law, *TEST)["characterise"] == 1


def test_an_image_that_is_overwritten_reruns_the_features_and_stops_a_join_by_hand(again):
    """Of a virtual lab's sessions too, whose images are not there when the first run is planned."""
    images = sorted((again.folder / HOSTILE / "recordings/morning/images").iterdir())
    images[1].write_bytes(images[-1].read_bytes())
    jobs = again.jobs(*TEST)
    assert {"features", "join", "train"} <= set(jobs) and jobs["features"] == 1
    assert not {"simulate", "characterise", "virtual_session"} & set(jobs)
    command = [sys.executable, "-m", "gelforge", "join", "--study", "config/test.yaml", "--shard", "0"]
    refused = subprocess.run([*command, "--out", "x.h5"], cwd=again.folder, capture_output=True, text=True)
    assert refused.returncode == 1 and not (again.folder / "x.h5").exists()
    assert f"snakemake -R {RESULTS}/features/morning.h5" in refused.stderr


def test_another_mesh_reruns_cells_and_leaves_the_recordings(again):
    path = again.folder / "config/test.yaml"
    content = yaml.safe_load(path.read_text())
    content["mechanics"]["mesh"]["near_mm"] = 0.9
    path.write_text(yaml.safe_dump(content))
    jobs = again.jobs(*TEST)
    assert jobs["simulate"] == 3
    assert not {"characterise", "readings", "features", "virtual_cell", "virtual_session"} & set(jobs)


def test_one_cell_again_and_what_follows(again):
    """The corner of the grid, a mirrored cell: the job of those of its shard, the shard and what is made from that."""
    cell = f"{RESULTS}/cells/x2_y2.h5"
    jobs = again.jobs(*TEST, "-R", cell)
    assert jobs["derive_2"] == jobs["join"] == 1
    assert not {"simulate", "derive_0", "derive_1"} & set(jobs)
    assert LEARNING | {"manifest", "agreement", "tables", "report"} <= set(jobs)
    assert not {"characterise", "features", "readings", "virtual_cell", "virtual_session"} & set(jobs)


@pytest.mark.thorough  # test_resume deletes one and runs it
def test_a_deleted_cell_is_made_again(again):
    (again.folder / RESULTS / "cells/x1_y1.h5").unlink()
    assert again.jobs(*TEST)["simulate"] == 1


@pytest.mark.thorough
def test_shards_need_no_virtual_truth(again):
    """A laboratory has recordings and no truth: without lab and truth the shards have the same bytes."""
    before = again.files(f"{RESULTS}/dataset/shard-*.h5")
    for path in (again.folder / HOSTILE / "virtual_truth").rglob("*.h5"):
        path.unlink()
    for path in (again.folder / RESULTS / "dataset").iterdir():
        path.unlink()
    for folder in ("recordings", "features"):
        for path in (again.folder / RESULTS / folder).iterdir():
            path.unlink()
    content = yaml.safe_load((again.folder / "config/test.yaml").read_text()) | {"virtual_lab": None}
    (again.folder / "config/own.yaml").write_text(yaml.safe_dump(content))
    again.snakemake("labels", "--cores", "2", "--configfile", "config/own.yaml")
    assert again.files(f"{RESULTS}/dataset/shard-*.h5") == before


def test_a_truncated_cell_stops_the_join_by_name(again):
    path = again.folder / RESULTS / "cells/x0_y1.h5"
    path.write_bytes(path.read_bytes()[:-2000])
    failed = again.snakemake("labels", "--cores", "1", *TEST, check=False)
    assert failed.returncode == 1
    assert "cells/x0_y1.h5" in failed.stdout
    assert "Traceback" not in failed.stdout.partition("Error in rule join")[2]


@pytest.mark.thorough
def test_killed_in_the_middle_it_recovers_and_ends_the_same(checkout, finished):
    """kill -9 on Snakemake while cells are computed; the documented two lines bring the same files."""
    checkout.move_data(HOSTILE)
    with (checkout.folder / "killed.log").open("w") as log:
        run = subprocess.Popen(
            checkout.command("labels", "--cores", "2", *TEST), cwd=checkout.folder, stdout=log, stderr=log
        )
        deadline = time.monotonic() + 120
        while not checkout.files(f"{RESULTS}/cells/*.h5") and time.monotonic() < deadline:
            assert run.poll() is None, (checkout.folder / "killed.log").read_text()
            time.sleep(0.05)
        busy = unlock(checkout)
        assert busy.returncode == 1, "an alive run must keep its lock"
        assert "alive" in busy.stderr
        os.kill(run.pid, signal.SIGKILL)
        run.wait()
    locked = checkout.snakemake("labels", "--cores", "2", *TEST, check=False)
    assert "locked" in locked.stdout.lower()

    released = unlock(checkout)
    assert released.returncode == 0, released.stdout + released.stderr
    checkout.snakemake("labels", "--cores", "2", "--rerun-incomplete", *TEST)
    for pattern in ("materials/*/law.json", "recordings/*.csv", "cells/*.h5", "dataset/shard-*.h5"):
        assert checkout.files(f"{RESULTS}/{pattern}") == finished.files(f"{RESULTS}/{pattern}")
    assert not list(checkout.folder.rglob("*.tmp*"))


def unlock(run):
    command = [*run.command()[:1], "workflow/scripts/unlock.py"]
    return subprocess.run(command, cwd=run.folder, capture_output=True, text=True)
