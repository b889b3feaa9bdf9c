"""What Snakemake's Slurm executor lacks: patience with a controller that is away, and the time of a group to the minute.

Seen with snakemake-executor-plugin-slurm 2.8.0: if no query of the jobs' states succeeds in one round, the executor forgets
all active jobs and the workflow waits for ever; a submission that fails uses up the job's retries within seconds. Here a job
stays active until its end is reported, and jobs are submitted when the controller answers.

Snakemake adds the times of a group's jobs in whole minutes, layer by layer: sixteen sites of five seconds and their hundred
mirror images of half a second would ask for an hour. Here a group asks for the sum of its jobs' `cpu_ms` over its cores.
"""

from __future__ import annotations

import shlex
import subprocess
import time
from collections.abc import Callable
from typing import Any

from snakemake_interface_executor_plugins.utils import format_cli_value

PING = ["scontrol", "ping"]
PATIENCE_S = 10  # between two questions whether the controller is back (no result depends on it)


def make_patient(executor: Any, minutes: Callable[[float, int], int]) -> None:
    """Change a class of Slurm executors: see above. minutes(seconds, attempt): what to ask of Slurm."""
    submit, check = executor.run_job, executor.check_active_jobs
    if getattr(executor, "is_patient", False):
        return

    def run_job(self, job):
        if job.is_group():
            ask_for_group(job, minutes)
        wait_for_controller(self.logger)
        submit(self, job)

    async def check_active_jobs(self, active_jobs):
        ended = set()

        def noting(report):
            def noted(job_info, *arguments, **options):
                ended.add(id(job_info))
                return report(job_info, *arguments, **options)

            return noted

        # on this executor for the time of one round; submissions in other threads may report through it too
        self.report_job_success = noting(self.report_job_success)
        self.report_job_error = noting(self.report_job_error)
        try:
            async for _ in check(self, active_jobs):
                pass
        finally:
            del self.report_job_success, self.report_job_error
        for job_info in active_jobs:
            if id(job_info) not in ended:
                yield job_info

    executor.is_patient = True
    executor.run_job, executor.check_active_jobs = run_job, check_active_jobs


def ask_for_group(job, minutes: Callable[[float, int], int]) -> None:
    """Set the time of a group of jobs, where all of them say how long they compute."""
    cores = job.resources["_cores"]  # also adds up Snakemake's way, once; those of the widest layer
    cpu_ms = [member.resources.get("cpu_ms") for member in job.jobs]
    if all(isinstance(value, int) for value in cpu_ms):
        job._resources["runtime"] = minutes((sum(cpu_ms) / max(cores, 1) + max(cpu_ms)) / 1000, job.attempt)


def wait_for_controller(logger) -> None:
    """Return when Slurm's controller answers, or cannot be asked."""
    reported = False
    while not controller_answers():
        if not reported:
            logger.warning("Slurm's controller does not answer; jobs are submitted when it is back")
            reported = True
        time.sleep(PATIENCE_S)


def controller_answers() -> bool:
    try:
        # 0: at least one controller is up; its messages differ between versions
        return subprocess.run(PING, capture_output=True, timeout=60).returncode == 0
    except FileNotFoundError:
        return True  # the submission says what is missing
    except subprocess.TimeoutExpired:
        return False


def reaches_jobs(path: str) -> bool:
    """Return whether Snakemake hands a path to the jobs of a cluster as one word that executes nothing."""
    text = format_cli_value(path, quote=True)  # Python's quotes, in a command that a shell reads
    try:
        return shlex.split(text) == [path] and not (text[0] == '"' and set("$`") & set(path))
    except ValueError:  # a quote without its partner
        return False
