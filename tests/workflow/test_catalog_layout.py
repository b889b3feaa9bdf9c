"""Where the workflow may be called from: the root, the catalog's place, as a module, from an installed package."""

import yaml
from conftest import ROOT

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
