"""What an interrupted run has solved, and when it is not used: see gelforge/indentation/cells/kept_solutions.py."""

import shutil

from snakemake.logging import logger

from gelforge.dataset.presses_in_order import part_of
from gelforge.indentation.cells.kept_solutions import forget, tidy
from gelforge.workflow.run_progress import show_stages

# CPU seconds of a job by rule, roughly, for the time left: to know them of this study takes a mesh
WEIGHTS = {
    "mismatch": 200,
    "verify": 60,
    "train": 100,
    "evaluate": 60,
    "features": 60,
    "report": 15,
    "export": 10,
    "onnx_check": 5,
    "characterise": 10,
}
WEIGHTS |= dict.fromkeys(
    ("simulate", "solve_site", "variant", "session_cell", "virtual_cell", "site_sensitivities"), 10
)
TARGETS = {"all", "cells", "labels", "sensitivities"}  # rules that make nothing themselves
SOLVES = {
    "simulate",
    "solve_site",
    "variant",
    "session_cell",
    "virtual_cell",
}  # rules whose output is one solved site


def forced(jobs):
    """Return the jobs that the command line forces (-R, --force, --forceall), and those that follow from them.

    Snakemake's own reason says "forced" of incomplete outputs too. Only the process that the user starts knows this: the
    jobs of a cluster are always started with --force.
    """
    settings = workflow.dag_settings
    named = {name if workflow.is_rule(name) else os.path.relpath(name) for name in settings.forcerun}
    if settings.forcetargets:
        named |= {name if workflow.is_rule(name) else os.path.relpath(name) for name in settings.targets}
    waiting = set(jobs)
    found = {job for job in waiting if settings.forceall or job.rule.name in named or named & set(job.output)}
    front = found
    while front:
        front = {after for job in front for after in workflow.dag.depending[job] if after in waiting} - found
        found = found | front
    return found


def solve_anew(jobs):
    """Remove what was kept for jobs that are forced, before any job starts: nothing is left to be taken up."""
    kept = 0
    for job in forced(jobs):
        name, first = job.rule.name, Path(next(iter(job.output), ""))
        if name in SOLVES:
            kept += forget([first])
        elif name == "session_presses":
            kept += part_of(first).exists()
            shutil.rmtree(part_of(first), ignore_errors=True)
        elif name == "train":
            Path(job.output.model).with_suffix(".checkpoint.pt").unlink(missing_ok=True)
        elif name == "mismatch":
            shutil.rmtree(first.parent / "solves", ignore_errors=True)
    if kept:
        print(f"forced: {kept} kept solutions removed, they are solved anew", file=sys.stderr)


def begin_jobs(jobs):
    """Start what forks the jobs, where they run on this machine, and show the stages of the run."""
    if workflow.local_exec:
        run_in_forks()
    rules = {job.jobid: job.rule.name for job in jobs if job.rule.name not in TARGETS}
    if rules and not workflow.output_settings.verbose:
        show_stages(logger, rules, WEIGHTS)


def solved_files():
    """Return the files of all sites that the study solves, mirrored ones among them."""
    own = [
        f"{RESULTS}/sessions/{session}/cells/{cell}.h5"
        for session, cells in OWN_CELLS.items()
        for cell in cells
    ]
    truth = [f"{TRUTH}/{cell}.h5" for cell in CELLS] if LAB else []
    sites = sorted(Path(SITES).glob("*.h5"))
    return [Path(name) for name in cell_files(CELLS) + variant_files() + own + truth] + sites


def tidy_up():
    """Remove kept solutions whose sites are there: a run that ended well needs them no more."""
    tidy(solved_files())
