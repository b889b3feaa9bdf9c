"""What the jobs of a cluster need: the time that each asks for, from the study's own estimate (gelforge/cli/study/cost.py)."""

from functools import cache

from gelforge.cli.study.cost import Costs
from gelforge.workflow.patient_slurm import make_patient, reaches_jobs

START_S = 60  # a job of a cluster starts Snakemake twice, 10 to 30 s on a busy machine
MARGIN = 2  # machines differ, and so do sites
FIT_S, PICTURES_S = 20, 300  # a material; one whose tests are pictures
VERIFY_S = 90
SHORT_S = 20  # a job that reads, sums and writes


def minutes(seconds, attempt=1):
    """Return the minutes to ask for a job that computes so long; twice as many after each attempt that failed."""
    return math.ceil((START_S + MARGIN * seconds) / 60) * 2 ** (attempt - 1)


def asks(seconds):
    """Return a rule's `runtime`; seconds(wildcards, input, threads) is what it computes.

    Estimated where jobs are submitted only: for a cell a mesh is made.
    """

    def runtime(wildcards, input, threads, attempt):
        return minutes(seconds(wildcards, input, threads), attempt) if workflow.non_local_exec else 1

    return runtime


def counts(seconds):
    """Return a rule's `cpu_ms`, by which a group of sites asks for its time: see gelforge/workflow/patient_slurm.py."""
    return lambda wildcards: math.ceil(1000 * seconds(wildcards)) if workflow.non_local_exec else 1


@cache
def costs():
    return Costs(STUDY, CELLS)


def cell_seconds(wildcards, *_):
    return costs().cell(CELLS[wildcards.cell])


def site_seconds(wildcards, *_):
    return costs().cell(site_of(wildcards))


def variant_seconds(wildcards, *_):
    return costs().variant(wildcards.variant, CELLS[wildcards.cell])


def solution_seconds(*_):
    return costs().synthesis_press()


def synthetic_seconds(*_):
    return costs().synthesis_rows(STUDY.synthesis.rows_per_shard)


def true_seconds(wildcards, *_):
    return costs().true_cell(CELLS[wildcards.cell])


def presses_seconds(wildcards, *_):
    return costs().session_presses(wildcards.session)


def verdict_seconds(wildcards, input, threads):
    return costs().mismatch() / threads


def fit_seconds(wildcards, input, threads):
    return PICTURES_S if {Path(name).suffix for name in input} - TABLES else FIT_S


def features_seconds(wildcards, input, threads):
    return SHORT_S + costs().features(wildcards.session) / threads


def drawing_seconds(wildcards, input, threads):
    return SHORT_S + costs().drawing(wildcards.session) / threads


def training_seconds(wildcards, input, threads):
    return SHORT_S + costs().training()


def evaluation_seconds(wildcards, input, threads):
    return SHORT_S + costs().evaluation(input.size_mb)


def short_seconds(*_):
    return SHORT_S


def check_paths(jobs):
    """Stop at a path that Snakemake cannot hand to the jobs of a cluster as one word: it quotes as Python does."""
    if workflow.local_exec:
        return
    paths = {os.getcwd(), *map(str, workflow.configfiles)}
    paths |= {str(path) for job in jobs for path in (*job.input, *job.output)}
    for path in sorted(paths):
        if not reaches_jobs(path):
            raise WorkflowError(
                f"{path}: a quote beside $, `, a backslash or another quote does not reach the jobs of a cluster; rename it"
            )


if workflow.is_main_process and "snakemake_executor_plugin_slurm" in sys.modules:
    make_patient(sys.modules["snakemake_executor_plugin_slurm"].Executor, minutes)
