"""Faults of the workflow: text of a configuration in commands, jobs that are killed, and a Slurm that cancels or goes away.

The rows with Slurm need `sbatch`; the one with the controller also the shell commands that stop and start it, in the
environment variables STOP_CONTROLLER and START_CONTROLLER (a throw-away Slurm of one's own). Others are left out, by name.
A study of four cells without symmetry, two solved at a time: minutes a row.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import yaml

ROOT = Path(__file__).parents[2]
SLURM = ["--profile", "workflow/profiles/slurm", "--seconds-between-status-checks", "3"]
SLURM += ["--slurm-init-seconds-before-status-checks", "3", "--latency-wait", "5"]
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
CELLS = "results/tiny/cells"
LAWS = [f"results/tiny/materials/{name}/law.json" for name in ("ecoflex_gel", "elastosil_25_1")]
LIMIT_S = 1800.0  # a run of four cells that takes longer hangs
AWAY_S = 60.0
HOSTILE = "data/lab's x$(touch Y) `touch Z`;touch W"


@dataclass
class Run:
    """A copy of the workflow in a folder, with the study `tiny`."""

    folder: Path
    data: str | None = None
    process: subprocess.Popen | None = field(default=None, init=False)

    def __post_init__(self):
        self.folder.mkdir(parents=True)
        for name in ("Snakefile", "workflow", "config", "data/demo/materials"):
            source, target = ROOT / name, self.folder / name
            copy = shutil.copytree if source.is_dir() else shutil.copy
            target.parent.mkdir(parents=True, exist_ok=True)
            copy(source, target)
        (self.folder / "profiles").symlink_to("workflow/profiles")
        study = yaml.safe_load((self.folder / "config/test.yaml").read_text())
        study |= {"study": "tiny", "data": self.data}
        study["plan"] = {"grid": {"spacing_mm": 4.0, "margin_mm": 14.0}, "depths_mm": [0.4, 0.8, 1.2]}
        study["plan"]["symmetry"] = "none"
        del study["variants"]  # these positions have no centre
        (self.folder / "config/tiny.yaml").write_text(yaml.safe_dump(study))

    def start(self, *arguments: str) -> None:
        command = [sys.executable, "-m", "snakemake", *arguments, "--configfile", "config/tiny.yaml"]
        paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH", ""))))
        log = (self.folder / "run.log").open("a")
        environment = os.environ | THREADS | {"PYTHONPATH": paths}
        self.process = subprocess.Popen(command, cwd=self.folder, stdout=log, stderr=log, env=environment)

    def ended(self) -> int | None:
        """Return the exit status, None for a run that hangs; it is killed then."""
        try:
            return self.process.wait(LIMIT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return None

    def said(self) -> str:
        return " ".join((self.folder / "run.log").read_text()[-600:].split())

    def solved(self) -> set[str]:
        """Return the cells that are solved, accepted by Snakemake or not yet."""
        return {path.name.split(".")[0] for path in (self.folder / CELLS).glob(".solved/x*.h5")}

    def wait_for_cells(self, count: int) -> set[str]:
        deadline = time.monotonic() + LIMIT_S
        while len(self.solved()) < count and time.monotonic() < deadline and self.process.poll() is None:
            time.sleep(0.2)
        return self.solved()

    def mark_solved(self) -> dict[str, Path]:
        """Return second names of the files of solved cells, by cell; a cell that is solved again has another file."""
        marked = {}
        for path in (self.folder / CELLS).glob(".solved/x*.h5"):
            cell = path.name.split(".")[0]
            marked[cell] = self.folder / f"before-{cell}.h5"
            os.link(path, marked[cell])
        return marked

    def solved_again(self, marked: dict[str, Path]) -> list[str]:
        cells = {cell: self.folder / CELLS / f"{cell}.h5" for cell in marked}
        return [cell for cell in marked if not (cells[cell].is_file() and cells[cell].samefile(marked[cell]))]


# -------------------------------------------------------------------------------------------------- faults
def running() -> str:
    """Return the number of the Slurm job that runs."""
    listed = ["squeue", "--me", "--noheader", "--states=running", "--format=%i"]
    return subprocess.run(listed, capture_output=True, text=True, check=True).stdout.split()[0]


def cancel(run: Run) -> None:
    subprocess.run(["scancel", running()], check=True)


def run_out_of_time(run: Run) -> None:
    """Leave the job less time than it has used; Slurm ends it as it does at its limit."""
    subprocess.run(["scontrol", "update", f"JobId={running()}", "TimeLimit=1"], check=True)
    time.sleep(60)


def kill_member(run: Run) -> None:
    """SIGKILL to one `gelforge simulate` that solves."""
    for process in psutil.process_iter():
        try:
            if process.cwd() == str(run.folder) and "simulate" in process.cmdline()[:4]:
                return process.kill()
        except (psutil.Error, OSError):
            continue


def kill_main(run: Run) -> None:
    """SIGKILL to Snakemake; then what the documentation says."""
    run.process.send_signal(signal.SIGKILL)
    run.process.wait()
    subprocess.run([sys.executable, "workflow/scripts/unlock.py"], cwd=run.folder, check=True)


def controller_away(run: Run) -> None:
    subprocess.run(os.environ["STOP_CONTROLLER"], shell=True, check=True)
    time.sleep(AWAY_S)
    subprocess.run(os.environ["START_CONTROLLER"], shell=True, check=True)


# ---------------------------------------------------------------------------------------------------- rows
def broken_off(folder: Path, how: list[str], fault: Callable[[Run], None]) -> tuple[str, bool]:
    """Return what a fault cost a run that had solved two of its four cells, and whether that is right."""
    run = Run(folder)
    run.start(*LAWS, "--cores", "1")
    run.ended()
    run.start("cells", *how)
    if not run.wait_for_cells(2):
        return f"no cell was solved: {run.said()}", False
    before = run.mark_solved()
    fault(run)
    status = run.ended()
    if status not in (0, None):  # the same command once more, as a user does
        run.start("cells", *how)
        status = run.ended()
    accepted = {path.stem for path in (folder / CELLS).glob("*.h5")}
    lost = run.solved_again(before)
    told = f"{len(before)} solved before, {len(lost)} of them solved again, {len(accepted)} of 4 cells at the end"
    right = bool(before) and not lost and status == 0 and len(accepted) == 4
    return ("hangs; " if status is None else "") + told + asked_over_used(run), right


def asked_over_used(run: Run) -> str:
    """Return the Slurm jobs that completed, with the time that each asked and used."""
    numbers = re.findall(r"submitted with SLURM jobid (\d+)", (run.folder / "run.log").read_text())
    rows = []
    for number in dict.fromkeys(numbers):
        shown = subprocess.run(["scontrol", "show", "job", number], capture_output=True, text=True).stdout
        known = dict(re.findall(r"(JobState|RunTime|TimeLimit)=(\S+)", shown))
        if known.get("JobState") == "COMPLETED":
            rows.append(f"asked {known['TimeLimit']}, used {known['RunTime']}")
    return "".join(f"; {row}" for row in rows)


def shell_text(folder: Path) -> tuple[str, bool]:
    """Return what came of a data folder named like a command, in a folder with a space and a quote."""
    run = Run(folder / "user's lab data", HOSTILE)
    truth = f"{HOSTILE}/virtual_truth/cells/x0_y0.h5"
    run.start(truth, f"{CELLS}/x0_y0.h5", "--cores", "2")
    status = run.ended()
    executed = [path for name in "YZW" for path in folder.rglob(name)]
    made = [name for name in (truth, f"{CELLS}/x0_y0.h5") if (run.folder / name).is_file()]
    return f"{len(executed)} commands executed, {len(made)} of 2 files made", status == 0 and not executed


LOCAL = ["--cores", "2"]
KINDS = {
    "shell text in `data`, quote and spaces in the folder": shell_text,
    "SIGKILL of Snakemake": lambda folder: broken_off(folder, LOCAL, kill_main),
}
WITH_SLURM = {
    "Slurm: a group is cancelled": cancel,
    "Slurm: a group runs out of time": run_out_of_time,
    "Slurm: a member of a group is killed": kill_member,
    "Slurm: SIGKILL of Snakemake": kill_main,
    "Slurm: the controller is away for 60 s": controller_away,
}


def run(asked: argparse.Namespace) -> int:
    """Make the faults, print their table and return the exit status."""
    kinds = dict(KINDS)
    for name, fault in WITH_SLURM.items():
        kinds[name] = lambda folder, fault=fault: broken_off(folder, SLURM, fault)
    chosen = [name for name in kinds if asked.only in (None, name)]
    if asked.list:
        print("\n".join(chosen))
        return 0
    print("| fault | what came of it | right |\n|---|---|---|", flush=True)
    wrong = 0
    for name in chosen:
        if name in WITH_SLURM and not shutil.which("sbatch"):
            print(f"| {name} | not tried: no Slurm here | |")
            continue
        if WITH_SLURM.get(name) is controller_away and "STOP_CONTROLLER" not in os.environ:
            print(f"| {name} | not tried: STOP_CONTROLLER and START_CONTROLLER are not given | |")
            continue
        with tempfile.TemporaryDirectory() as temporary:
            told, right = kinds[name](Path(temporary) / "study")
        wrong += not right
        print(f"| {name} | {told} | {'yes' if right else 'NO'} |", flush=True)
    return 1 if wrong else 0
