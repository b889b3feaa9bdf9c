"""Which jobs a run would do, and what is refused before any job."""

import pytest
import yaml

TEST = ("--configfile", "config/test.yaml")


def test_paper_makes_every_cell_a_job(checkout):
    jobs = checkout.jobs("--configfile", "config/paper.yaml")
    assert jobs["simulate"] == 1681
    assert jobs["join"] == 106  # 16 cells a shard
    assert not {"train", "evaluate", "features", "virtual_session", "agreement"} & set(jobs)  # labels only


def test_demo_is_the_default_and_not_mixed_into_other_studies(checkout):
    jobs = checkout.jobs()
    assert jobs["simulate"] == 13 * 13 + 4 + 4
    assert jobs["virtual_session"] == 2
    assert jobs["variant"] == 2 * 2  # two variants at centre and corner
    assert jobs["train"] == jobs["tables"] == jobs["report"] == 1


def test_symmetric_cells_are_solved_once_for_the_virtual_sensor(checkout):
    assert checkout.jobs()["virtual_cell"] == 28 + 1 + 1  # an octant of 13 x 13 positions, a corner, a side


def test_test_study_lists_every_rule(checkout):
    jobs = checkout.jobs(*TEST)
    assert jobs["simulate"] == 9
    assert jobs["variant"] == 1
    assert jobs["join"] == 3  # 4 + 4 + 1 cells


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sede": 1}, ["sede", "unknown key"]),
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


def test_a_missing_recording_is_named_before_any_job(checkout):
    """A study of one's own: no virtual lab, a session whose folder is empty."""
    content = yaml.safe_load((checkout.folder / "config/test.yaml").read_text()) | {"virtual_lab": None}
    (checkout.folder / "config/own.yaml").write_text(yaml.safe_dump(content))
    refused = checkout.snakemake("--cores", "1", "--configfile", "config/own.yaml", check=False)
    assert refused.returncode == 1
    assert "data/test/recordings/morning/indentations.csv" in refused.stdout
    assert not (checkout.folder / "results").exists()
