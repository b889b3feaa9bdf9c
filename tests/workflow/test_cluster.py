"""What the jobs of a cluster ask for, and patience with a Slurm controller that is away; no Slurm is needed."""

import asyncio
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from conftest import ROOT

from gelforge.cli.study import unlock
from gelforge.cli.study.cost import JOB_S, VERDICT_CELLS, Costs
from gelforge.config import load_study
from gelforge.indentation.planning.plan import plan_cells
from gelforge.workflow import patient_slurm


def rounded(seconds, attempt):
    return -(-seconds // 60) * attempt


def executor_class():
    """A class like the Slurm executor 2.8.0: without an answer it neither keeps nor reports active jobs."""

    class Executor:
        answers = True
        logger = SimpleNamespace(warning=print)

        def __init__(self):
            self.submitted, self.reported = [], []

        def run_job(self, job):
            self.submitted.append(job)

        def report_job_success(self, job_info):
            self.reported.append(job_info)

        report_job_error = report_job_success

        async def check_active_jobs(self, active_jobs):
            for job_info in active_jobs if self.answers else []:
                if job_info.state == "running":
                    yield job_info
                else:
                    self.report_job_success(job_info)

    return Executor


def still_active(executor, jobs):
    async def collect():
        return [job_info async for job_info in executor.check_active_jobs(jobs)]

    return asyncio.run(collect())


def test_jobs_stay_active_and_groups_ask_for_the_sum_of_their_jobs():
    # Jobs stay active while nobody can tell their state
    kind = executor_class()
    jobs = [SimpleNamespace(state="running"), SimpleNamespace(state="done")]
    plain = kind()
    plain.answers = False
    assert still_active(plain, jobs) == [], "the fault that is mended"
    patient_slurm.make_patient(kind, rounded)
    executor = kind()
    executor.answers = False
    assert still_active(executor, jobs) == jobs
    executor.answers = True
    assert still_active(executor, jobs) == jobs[:1]
    assert executor.reported == jobs[1:]

    # A group asks for the sum of its jobs over its cores
    assert group(*[36_000] * 16, *[500] * 112) == 6  # (16 x 36 + 112 x 0.5) / 2 + 36 = 352 s
    assert group(*[36_000] * 16, attempt=2) == 12
    assert group(36_000) == 1
    assert group(36_000, None) == 99, "a job that says nothing: Snakemake's own sum"


def test_the_plugin_has_what_is_changed():
    """A newer plugin with other names would bring the hang back without a word."""
    plugin = pytest.importorskip("snakemake_executor_plugin_slurm")
    for name in ("run_job", "check_active_jobs", "report_job_success", "report_job_error"):
        assert callable(getattr(plugin.Executor, name))


def test_jobs_are_submitted_when_the_controller_is_back(monkeypatch, tmp_path):
    ping = tmp_path / "ping"
    ping.write_text(f"#!/bin/sh\necho >> {tmp_path}/asked; test $(wc -l < {tmp_path}/asked) -ge 3\n")
    ping.chmod(0o755)
    monkeypatch.setattr(patient_slurm, "PING", [str(ping)])
    monkeypatch.setattr(patient_slurm, "PATIENCE_S", 0.01)
    kind = executor_class()
    patient_slurm.make_patient(kind, rounded)
    executor = kind()
    executor.run_job(SimpleNamespace(is_group=lambda: False))
    assert len(executor.submitted) == 1
    assert (tmp_path / "asked").read_text().count("\n") == 3


def group(*each, cores=2, attempt=1):
    members = [SimpleNamespace(resources={"cpu_ms": value}) for value in each]
    job = SimpleNamespace(
        jobs=members, resources={"_cores": cores}, attempt=attempt, _resources={"runtime": 99}
    )
    patient_slurm.ask_for_group(job, rounded)
    return job._resources["runtime"]


@pytest.mark.parametrize(
    ("path", "reaches"),
    [
        ("data/test", True),
        ("/home/user's lab data/study", True),
        ('a 12" sensor', True),
        ("data/x$(touch Y)", True),  # in single quotes
        ("lab's x$(touch Y)", False),  # Python puts it into double quotes, in which a shell executes
        ("lab's `touch Y`", False),
        ("'a'$(touch Y)", False),  # taken for quoted already
        ("back\\slash", False),
    ],
)
def test_paths_that_a_shell_would_read_otherwise_are_known(path, reaches):
    assert patient_slurm.reaches_jobs(path) == reaches


def test_estimates_follow_the_study_and_its_mirrored_cells():
    study = load_study(ROOT / "config/test.yaml")
    costs = Costs(study, plan_cells(study))
    solved = next(cell for cell in costs.cells.values() if cell.source is None)
    mirrored = next(cell for cell in costs.cells.values() if cell.source)
    assert costs.cell(mirrored) < costs.cell(solved) < costs.true_cell(solved) * 2
    every = study.mismatch.model_copy(update={"sites": 9})
    more = Costs(study.model_copy(update={"mismatch": every}), costs.cells)
    # all 9 positions are mirror images of 3; of 2 positions at least one is solved
    assert more.mismatch() - costs.mismatch() == pytest.approx((3 - 1) * VERDICT_CELLS * costs.cell(solved))
    fitted = study.mismatch.model_copy(update={"images": "fitted"})
    images = Costs(study.model_copy(update={"mismatch": fitted}), costs.cells)
    assert images.mismatch() - costs.mismatch() == pytest.approx(6 * costs.cell(solved))
    blind = Costs(study.model_copy(update={"mismatch": fitted, "sessions": []}), costs.cells)
    assert blind.mismatch() == costs.mismatch()

    # Mirrored cells share the start of their job
    by_cells = sum(map(costs.cell, costs.cells.values()))
    assert costs.cells_of_plan() == pytest.approx(by_cells + (3 + 3) * JOB_S)


@pytest.fixture
def slurm(tmp_path, monkeypatch):
    """A Slurm of two commands: one job of this folder, one of another, one that no run has submitted."""
    bin_folder, here = tmp_path / "bin", tmp_path / "user's study"
    bin_folder.mkdir()
    here.mkdir()
    (tmp_path / "jobs").write_text(f"7|rule_fem_simulate|{here}\n8|rule_train|/elsewhere\n9|(null)|{here}\n")
    for name, does in (
        ("squeue", "cat jobs"),
        ("scancel", 'echo "$@" >> cancelled; grep -v "^$1|" jobs > left; mv left jobs'),
    ):
        (bin_folder / name).write_text(f"#!/bin/sh\ncd '{tmp_path}'\n{does}\n")
        (bin_folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(bin_folder), prepend=os.pathsep)
    return here


def test_unlocking_cancels_the_slurm_jobs_of_this_folder_only(slurm):
    unlock.cancel(slurm)
    assert (slurm.parent / "cancelled").read_text() == "7\n"


def test_a_snakemake_of_a_job_is_no_run(tmp_path):
    """On a cluster of one machine, or on the node where unlock is called, jobs are Snakemakes in the same folder."""
    import psutil

    (tmp_path / "snakemake.py").write_text("import time\ntime.sleep(60)\n")
    command = [sys.executable, "-m", "snakemake"]
    plain = {key: value for key, value in os.environ.items() if key != "GELFORGE_RUN"}
    for marked, is_run in (({}, True), ({"GELFORGE_RUN": str(tmp_path)}, False)):
        process = subprocess.Popen(command, cwd=tmp_path, env=plain | marked)
        try:
            while "snakemake" not in psutil.Process(process.pid).cmdline():
                time.sleep(0.01)
            assert unlock.is_run(psutil.Process(process.pid), Path(tmp_path)) == is_run
            assert unlock.is_job(psutil.Process(process.pid), Path(tmp_path)) != is_run
        finally:
            process.kill()
            process.wait()
