"""Where the workflow may be called from: the root, the catalog's place, as a module, from an installed package."""

import shutil
import subprocess

import pytest
import yaml
from conftest import ROOT, Checkout

from gelforge.cli import main

TEST = ("--configfile", "config/test.yaml")
MODULE = """\
configfile: "config/test.yaml"


module gelforge:
    snakefile:
        "{snakefile}"
    config:
        config


use rule * from gelforge
"""


def test_every_way_to_call_the_workflow_lists_the_same_jobs(checkout, monkeypatch):
    root_jobs = checkout.jobs(*TEST)
    assert root_jobs["all"] == 1 and root_jobs["simulate"] == 3
    assert checkout.jobs("--snakefile", "workflow/Snakefile", *TEST) == root_jobs
    for profile in ("profiles/slurm", "workflow/profiles/slurm"):
        assert checkout.jobs("--profile", profile, *TEST) == root_jobs
    cell = "results/test/cells/x1_y1.h5"
    assert checkout.jobs("-R", cell, *TEST) == root_jobs

    deployed = checkout.folder / "workflow/Snakefile"  # as snakedeploy writes it
    (checkout.folder / "Snakefile").unlink()
    deployed.write_text(MODULE.format(snakefile=ROOT / "workflow/Snakefile"))
    assert checkout.jobs() == root_jobs

    deployed.unlink()  # a folder without rules of its own
    monkeypatch.chdir(checkout.folder)
    (checkout.folder / "profiles").unlink()
    assert main(["init", "mine"]) == 0
    assert checkout.jobs(*TEST) == root_jobs


def test_the_catalog_finds_what_it_asks_for():
    """Its rule: workflow/Snakefile, config/README.md and a YAML file with `usage` make a workflow standardised."""
    usage = yaml.safe_load((ROOT / ".snakemake-workflow-catalog.yml").read_text())["usage"]
    assert {"mandatory-flags", "software-stack-deployment"} <= set(usage)
    assert (ROOT / "workflow/Snakefile").is_file() and (ROOT / "config/README.md").is_file()


@pytest.fixture
def deployed(checkout, tmp_path, monkeypatch):
    """Return a folder as `snakedeploy deploy-workflow` leaves it: config/, profiles/, LICENSE and a module of a commit."""
    source, folder = checkout.folder, tmp_path / "deployed"
    for line in ("init --quiet", "add --all", "-c user.name=A -c user.email=a@b.c commit --quiet -m All"):
        subprocess.run(["git", *line.split()], cwd=source, check=True)
    for name in ("config", "profiles"):
        shutil.copytree(source / name, folder / name)
    shutil.copy(ROOT / "LICENSE", folder)
    (folder / "workflow").mkdir()
    declared = f'gitfile("{source}", path="workflow/Snakefile", ref="HEAD")'  # its line for a GitHub repository: github(...)
    snakefile = MODULE.replace("config/test.yaml", "config/config.yaml").replace('"{snakefile}"', declared)
    (folder / "workflow/Snakefile").write_text(snakefile)
    monkeypatch.chdir(folder)
    there = object.__new__(Checkout)
    there.folder = folder
    return there


def test_a_deployed_workflow_runs_the_demo_and_other_studies(deployed, capsys):
    lacking = deployed.snakemake("-n", check=False).stdout
    assert (
        "data/demo/materials/ecoflex_gel: no such file or folder" in lacking and "TableError" not in lacking
    )
    assert main(["examples"]) == 0  # brings data/; what is in config/ stays
    assert deployed.jobs()["all"] == 1
    capsys.readouterr()
    assert main(["init", "mine", "--sensor", "gelsight_mini"]) == 0
    options = capsys.readouterr().out.rpartition("snakemake --cores 2")[2].split()
    assert deployed.jobs(*options)["simulate"] == 9


def test_examples_refuse_to_replace_what_was_edited(deployed, capsys):
    with open("config/paper.yaml", "a") as file:
        file.write("# mine\n")
    assert main(["examples"]) == 1
    assert "config/paper.yaml differ(s) from the example of that name" in capsys.readouterr().err
