"""Release the lock that a killed run left behind, after making sure that no run of this folder is alive.

    python workflow/scripts/unlock.py

Exit status 1, and nothing touched, if a run is alive. Jobs of the killed run that still compute are ended: they would
only do again what the next run does, and their files appear under temporary names until they are whole.
"""

import os
import subprocess
import sys
from pathlib import Path

import psutil

GRACE_S = 10  # a job ended by SIGTERM is gone within its current output write


def main() -> int:
    here = Path.cwd()
    alive = [process.pid for process in psutil.process_iter() if is_run(process, here)]
    if alive:
        print(
            f"a run of {here} is alive (process {alive[0]}); wait for it, or stop it with Ctrl-C",
            file=sys.stderr,
        )
        return 1
    end([process for process in psutil.process_iter() if is_job(process, here)])
    if any((here / ".snakemake" / "locks").glob("*")):
        return subprocess.run([sys.executable, "-m", "snakemake", "--unlock"]).returncode
    return 0


def is_run(process: psutil.Process, folder: Path) -> bool:
    """Return whether a process is a Snakemake that works in a folder."""
    try:
        words = [Path(word).name for word in process.cmdline()[:3]]
        named = "snakemake" in words or words[1:3] == ["-m", "snakemake"]
        return named and process.status() != psutil.STATUS_ZOMBIE and Path(process.cwd()) == folder
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


def end(jobs: list[psutil.Process]) -> None:
    for job in jobs:
        job.terminate()
    _, stubborn = psutil.wait_procs(jobs, timeout=GRACE_S)
    for job in stubborn:
        job.kill()
    psutil.wait_procs(stubborn, timeout=GRACE_S)


if __name__ == "__main__":
    sys.exit(main())
