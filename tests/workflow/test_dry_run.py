"""Which jobs a run would do, and what is refused before any job."""

import shutil

import cv2
import numpy as np
import pytest
import yaml
from session_folder import HEADER, press_lines, write_images, write_session

CAMERA = "camera: {width_px: 140, height_px: 120, mm_per_px: 0.2, centre_px: [70, 60], position_mm: [16, 16, -40]}\n"
TEST = ("--configfile", "config/test.yaml")


@pytest.mark.thorough
def test_paper_makes_every_solved_cell_a_job_and_mirrors_in_bulk(checkout):
    jobs = checkout.jobs("--configfile", "config/paper.yaml")
    assert jobs["simulate"] == 231
    assert 100 < sum(name.startswith("derive_") for name in jobs) <= 106  # of a shard
    assert jobs["join"] == 106  # 16 cells a shard
    assert not {"train", "evaluate", "features", "virtual_session", "agreement"} & set(jobs)  # labels only


def test_the_demo_is_the_default_and_the_benchmark_solves_its_octant(checkout):
    jobs = checkout.jobs()
    assert jobs["simulate"] == jobs["virtual_cell"] == 15  # an octant of 9 x 9 positions
    for rule in ("virtual_session", "train", "tables", "export", "onnx_check", "mismatch", "report"):
        assert jobs[rule] == 1

    # Benchmark study solves an octant a corner a side and six between
    jobs = checkout.jobs("--configfile", "config/benchmark.yaml")
    assert jobs["simulate"] == jobs["virtual_cell"] == 28 + 1 + 1 + 6  # of 217
    assert jobs["virtual_session"] == 2
    assert jobs["variant"] == 2 * 2  # two variants at centre and corner


def test_test_study_lists_every_rule(checkout):
    jobs = checkout.jobs(*TEST)
    assert jobs["simulate"] == 3
    assert [name for name in jobs if name.startswith("derive_")] == ["derive_0", "derive_1", "derive_2"]
    assert jobs["variant"] == 1
    assert jobs["join"] == 3  # 4 + 4 + 1 cells
    assert not {"session_cell", "session_presses"} & set(jobs)


def between_sites(checkout, **interpolation):
    """Write a study of labels only, 21 x 21 positions with a label between solved sites; return its arguments."""
    content = yaml.safe_load((checkout.folder / "config/test.yaml").read_text())
    content |= {"study": "between", "sessions": [], "virtual_lab": None, "variants": {}}
    content["materials"]["ecoflex_gel"] = {"parameters": {"mu_kPa": [8.0], "alpha": [2.0]}}
    grid = {"spacing_mm": 1.1, "margin_mm": 5.0}
    content["plan"] = {"grid": grid, "depths_mm": [0.5, 1.0], "interpolation": interpolation}
    (checkout.folder / "config/between.yaml").write_text(yaml.safe_dump(content))
    return ("--configfile", "config/between.yaml")


def test_labels_between_sites_need_the_first_level_and_then_ask_again(checkout):
    jobs = checkout.jobs(*between_sites(checkout, tolerance=0.5))
    assert jobs["solve_site"] == 6 and jobs["level"] == 1
    assert "simulate" not in jobs
    assert {name for name in jobs if name.startswith("derive_")} == {"derive_0", "derive_1"}


@pytest.mark.thorough  # by the configuration itself: tests/indentation/test_lattice.py
def test_one_tolerance_is_asked_for_before_any_job(checkout):
    study = between_sites(checkout, tolerance=0.5, tolerance_N=0.001)
    refused = checkout.snakemake("-n", *study, check=False)
    assert (
        refused.returncode == 1 and "plan.interpolation" in refused.stdout and "tolerance_N" in refused.stdout
    )


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sede": 1}, ["config/wrong.yaml: sede, found 1: unknown key; did you mean seed?"]),
        ({"mechanics": {"friction": -1}}, ["mechanics.friction", "-1", "greater than or equal to 0"]),
        ({"virtual_lab": "config/virtual_lab/none.yaml"}, ["config/virtual_lab/none.yaml", "no such file"]),
        ({"variants": {"v": {"cells": ["x9_y9"]}}}, ["variants.v.cells", "x9_y9", "not in the plan"]),
        ({"plan": {"file": "nowhere.csv"}}, ["nowhere.csv", "no such file"]),
    ],
)
def test_wrong_configurations_stop_before_any_job(checkout, change, words):
    content = yaml.safe_load((checkout.folder / "config/test.yaml").read_text()) | change
    (checkout.folder / "config/wrong.yaml").write_text(yaml.safe_dump(content))
    refused = checkout.snakemake("--cores", "1", "--configfile", "config/wrong.yaml", check=False)
    assert refused.returncode == 1
    for word in words:
        assert word in refused.stdout
    assert not (checkout.folder / "results").exists()


def test_missing_recordings_and_unusable_material_tests_stop_before_any_job(checkout):
    # A missing recording is named before any job. A study of one's own: no virtual lab, a session whose folder is
    # empty
    content = yaml.safe_load((checkout.folder / "config/test.yaml").read_text()) | {"virtual_lab": None}
    (checkout.folder / "config/own.yaml").write_text(yaml.safe_dump(content))
    refused = checkout.snakemake("--cores", "1", "--configfile", "config/own.yaml", check=False)
    assert refused.returncode == 1
    assert "data/test/recordings/morning/indentations.csv" in refused.stdout
    assert not (checkout.folder / "results").exists()

    # A material test that cannot be used stops before its law is deleted
    law = checkout.folder / "results/test/materials/ecoflex_gel/law.json"
    law.parent.mkdir(parents=True)
    law.write_text("made before")
    edited(checkout.folder / "data/demo/materials/ecoflex_gel", "uniaxial_01.csv", "force_N", "force")
    refused = checkout.snakemake("--cores", "1", *TEST, check=False)
    assert refused.returncode == 1
    assert "uniaxial_01.csv, row 2: columns ['force_N'] are missing" in refused.stdout
    assert law.read_text() == "made before"


@pytest.mark.thorough
@pytest.mark.parametrize("images", ["left_out", "predicted"])
def test_a_verdict_waits_for_the_images_that_it_looks_at(checkout, images):
    study = ("--config", f"mismatch={{images: {images}}}", *TEST)
    listed = checkout.snakemake("results/test/mismatch/verdict.json", "-n", *study).stdout
    inputs = listed.partition("rule mismatch:")[2].partition("input:")[2].splitlines()[0]
    assert "session.yaml" in inputs
    for name in ("images", "reference.png"):
        assert (f"/{name}" in inputs) == (images == "predicted")


def own_study(checkout):
    """Write a study without virtual lab, and its recording of one press at the centre; return the recording's folder."""
    content = yaml.safe_load((checkout.folder / "config/test.yaml").read_text())
    content |= {"virtual_lab": None, "sessions": ["mine"]}
    (checkout.folder / "config/own.yaml").write_text(yaml.safe_dump(content))
    lines = [HEADER, *press_lines("a", 0, 16, 16, 0.8, images=True)]
    folder = write_session(checkout.folder / "data/test/recordings/mine", lines=lines, extra=CAMERA)
    write_images(folder, ["a"])
    return folder


def session_study(checkout, effects, **more):
    """Write a study of two sessions in March and June, both with a press in the middle and one at a mirrored corner."""
    content = yaml.safe_load((checkout.folder / "config/test.yaml").read_text())
    content |= {"virtual_lab": None, "sessions": ["march", "june"], **more}
    content["mechanics"]["effects"] = effects
    (checkout.folder / "config/own.yaml").write_text(yaml.safe_dump(content))
    lines = [HEADER, *press_lines("a", 0, 16, 16, 0.8, False), *press_lines("b", 1, 22, 22, 0.4, False)]
    for session, age in (("march", 10), ("june", 100)):
        folder = checkout.folder / "data/test/recordings" / session
        if not folder.exists():
            write_session(folder, lines=lines, extra=f"sensor_age_days: {age}\n")
    return ("--configfile", "config/own.yaml")


@pytest.mark.thorough
def test_only_a_session_of_another_age_has_cells_of_its_own(checkout):
    """The study is as old as the sensor in March: June has its two pressed cells and the one that the corner mirrors."""
    circumstances = {"ageing_per_day": {"gel": 0.001}, "age_days": 10.0}
    ageing = session_study(checkout, {"material": {"circumstances": circumstances}})
    assert checkout.jobs(*ageing)["session_cell"] == 3
    ageless = session_study(checkout, {"material": {"circumstances": {"ageing_per_day": {"gel": 0.0}}}})
    jobs = checkout.jobs(*ageless)
    assert jobs["simulate"] == 3
    assert not {"session_cell", "session_presses"} & set(jobs)


@pytest.mark.thorough
def test_a_sensor_that_softens_is_followed_session_by_session(checkout):
    plan = {"grid": {"spacing_mm": 6.0, "margin_mm": 10.0}, "depths_mm": [0.4, 0.8]}
    jobs = checkout.jobs(
        *session_study(checkout, {"history": {"mullins": {"gel": {"amount": 0.3}}}}, plan=plan)
    )
    assert jobs["session_presses"] == 2
    assert "session_cell" not in jobs


def smaller_image(folder):
    cv2.imwrite(str(folder / "images/a_1.png"), np.zeros((60, 70), np.uint8))


def edited(folder, name, old, new):
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new))


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (
            lambda folder: (folder / "reference.png").unlink(),
            ["reference.png: the reference frame is missing"],
        ),
        (smaller_image, ["images/a_1.png: 70 x 60 px", "140 x 120 px"]),
        (
            lambda folder: edited(folder, "indentations.csv", ",16,16,", ",17,16,"),
            ["row 2: indentation a", "no planned site"],
        ),
        (
            lambda folder: edited(folder, "indentations.csv", ",0.8,1,0,", ",0.8,1,x,"),
            ["row 4: dwell_s is 'x'"],
        ),
    ],
)
def test_what_is_wrong_with_a_recording_stops_before_any_job(checkout, spoil, words):
    """With keep-going the cells would go on for hours next to the reading that failed."""
    spoil(own_study(checkout))
    refused = checkout.snakemake("--cores", "1", "--configfile", "config/own.yaml", check=False)
    assert refused.returncode == 1
    for word in words:
        assert word in refused.stdout
    assert not (checkout.folder / "results").exists()


OWN = ("--configfile", "config/own.yaml")
FEATURES = "results/test/features/mine.h5"


def test_images_that_are_overwritten_in_place_are_looked_at_again(checkout):
    """Neither the folder's time stamp nor the file's size need change; a touch and a copy are no change."""
    folder = own_study(checkout)
    checkout.snakemake(FEATURES, "--cores", "1", *OWN)
    assert checkout.jobs(FEATURES, *OWN) == {}
    image = folder / "images/a_1.png"
    image.write_bytes(image.read_bytes())
    assert checkout.jobs(FEATURES, *OWN) == {}
    image.write_bytes((folder / "images/a_2.png").read_bytes())
    assert {"readings", "features"} <= set(checkout.jobs(FEATURES, *OWN))


def test_a_plan_that_changes_under_its_name_is_joined_again(checkout):
    """And what it decides is made again: the table of the plan, the split of shards whose sites have not changed."""
    content = yaml.safe_load((checkout.folder / "config/test.yaml").read_text())
    content |= {"virtual_lab": None, "sessions": [], "plan": {"file": "data/test/plan.csv"}, "variants": {}}
    (checkout.folder / "config/own.yaml").write_text(yaml.safe_dump(content))
    plan = checkout.folder / "data/test/plan.csv"
    plan.parent.mkdir(parents=True, exist_ok=True)
    plan.write_text("cell,x_mm,y_mm,depth_mm\nmiddle,16,16,0.8\n")
    checkout.snakemake("results/test/plan.csv", "--cores", "1", *OWN)
    assert checkout.jobs("results/test/plan.csv", *OWN) == {}
    plan.write_text("cell,x_mm,y_mm,depth_mm\nmiddle,16,16,0.8\nside,16,20,0.8\n")
    assert "plan" in checkout.jobs("results/test/plan.csv", *OWN)


def test_a_session_copied_under_another_name_stops_before_any_job(checkout):
    folder = own_study(checkout)
    other = folder.parent / "again"
    shutil.copytree(folder, other)
    edited(other, "session.yaml", "session: mine", "session: again")
    edited(checkout.folder, "config/own.yaml", "- mine", "- mine\n- again")
    refused = checkout.snakemake("--cores", "1", *OWN, check=False)
    assert refused.returncode == 1
    assert "sessions mine and again hold the same recording" in refused.stdout
    assert not (checkout.folder / "results").exists()


def test_a_study_whose_plan_is_what_was_pressed(checkout):
    """A robot that scatters: five visits are one site, and a session that is added brings the sites that are new."""
    content = yaml.safe_load((checkout.folder / "config/test.yaml").read_text())
    content |= {"virtual_lab": None, "sessions": ["mine"], "plan": {"from": "sessions"}, "variants": {}}
    (checkout.folder / "config/own.yaml").write_text(yaml.safe_dump(content))
    recordings, rng = checkout.folder / "data/test/recordings", np.random.default_rng(0)
    for name, places in (("mine", [(12, 10), (20, 23)]), ("more", [(12, 10), (18, 9)])):
        xy = np.repeat(places, 5, axis=0) + rng.normal(0, 0.015, (10, 2))
        presses = [press_lines(f"p{k}", k, *xy[k].round(6), 0.8, False) for k in range(10)]
        lines = [HEADER, *(line for press in presses for line in press)]
        write_session(recordings / name, lines=lines, extra="stage_to_sensor: {repeatability_mm: 0.015}\n")
    assert checkout.jobs("cells", *OWN)["simulate"] == 2
    edited(checkout.folder, "config/own.yaml", "- mine", "- mine\n- more")
    assert checkout.jobs("cells", *OWN)["simulate"] == 3
