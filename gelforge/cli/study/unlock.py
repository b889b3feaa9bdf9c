"""Release the lock that a killed run left behind, after making sure that no run of this folder is alive.

Nothing is touched if a run is alive. Jobs of the killed run that still compute are ended, those that it
gave to Slurm too: they would only do again what the next run does, and their files appear under temporary names until they
are whole. What they have solved is taken up by the next run.
"""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import psutil


class RunAlive(ValueError):
    """A run works in this folder."""


def unlock() -> None:
    """Release the lock of this folder; raise RunAlive where a run works in it."""
    here = Path.cwd()
    alive = [process.pid for process in psutil.process_iter() if is_run(process, here)]
    if alive:
        raise RunAlive(f"a run of {here} is alive (process {alive[0]}); wait for it, or stop it with Ctrl-C")
    cancel(here)
    end([process for process in psutil.process_iter() if is_job(process, here)])
    # What `snakemake --unlock` does, which reads a study first: the demo's, though another one may have been run.
    shutil.rmtree(here / ".snakemake" / "locks", ignore_errors=True)


def is_run(process: psutil.Process, folder: Path) -> bool:
    """Return whether a process is a Snakemake that works in a folder."""
    try:
        words = [Path(word).name for word in process.cmdline()[:3]]
        named = "snakemake" in words or words[1:3] == ["-m", "snakemake"]
        if not named or "GELFORGE_RUN" in process.environ():  # a run's own job, on a cluster a Snakemake too
            return False
        return process.status() != psutil.STATUS_ZOMBIE and Path(process.cwd()) == folder
    except (psutil.Error, OSError):  # gone meanwhile, or another user's
        return False


def is_job(process: psutil.Process, folder: Path) -> bool:
    """Return whether a process was started by a run of a folder; the workflow marks its jobs with GELFORGE_RUN."""
    try:
        return process.environ().get("GELFORGE_RUN") == str(folder) and process.pid not in own_line()
    except (psutil.Error, OSError):
        return False


def own_line() -> set[int]:
    """Return this process and its ancestors."""
    return {os.getpid(), *(parent.pid for parent in psutil.Process().parents())}


def slurm_jobs(folder: Path) -> list[str]:
    """Return the numbers of the user's Slurm jobs that a run of a folder has submitted; none where there is no Slurm."""
    listed = ["squeue", "--me", "--noheader", "--format=%i|%k|%Z"]
    try:
        lines = subprocess.run(listed, capture_output=True, text=True, timeout=60).stdout.splitlines()
    except (OSError, subprocess.TimeoutExpired):
        return []
    rows = [line.strip().split("|", 2) for line in lines]
    return [row[0] for row in rows if len(row) == 3 and row[1].startswith("rule_") and row[2] == str(folder)]


def cancel(folder: Path) -> None:
    """Cancel a folder's Slurm jobs and wait until they are gone."""
    jobs = slurm_jobs(folder)
    if not jobs:
        return
    subprocess.run(["scancel", *jobs])
    # Slurm ends a job within its KillWait, 30 s where nobody changed it
    deadline = time.monotonic() + 60
    while slurm_jobs(folder) and time.monotonic() < deadline:
        time.sleep(1)
    print(f"cancelled {len(jobs)} Slurm job(s) of the killed run", file=sys.stderr)


def end(jobs: list[psutil.Process], grace_s: float = 10) -> None:
    for job in jobs:
        job.terminate()
    _, stubborn = psutil.wait_procs(jobs, timeout=grace_s)
    for job in stubborn:
        job.kill()
    psutil.wait_procs(stubborn, timeout=grace_s)
