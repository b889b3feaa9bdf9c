"""What the jobs of a cluster need: the time that each asks for, from the study's own estimate (gelforge/cli/cost.py)."""

from functools import cache

from gelforge.cli.cost import Costs
from gelforge.workflow.patient_slurm import make_patient, reaches_jobs

START_S = 60  # a job of a cluster starts Snakemake twice, 10 to 30 s on a busy machine
MARGIN = 2  # machines differ, and so do cells
FIT_S, PICTURES_S = 20, 300  # a material; one whose tests are pictures
# CPU seconds on the test study: 4.0 and 2.7 for 45 and 36 images of 0.16 megapixels, 3.9 for 45 that are drawn, start included.
FEATURES_S_PER_MPX, DRAWING_S_PER_MPX = 0.5, 0.5
# Of shards, an epoch: 8 to 30 rows a megabyte, 6 operations a weight and row, 4 million weights, 1e10 operations a second; a U-Net is as slow.
TRAINING_S_PER_MB = 0.05
EVALUATION_S_PER_MB = 2.0  # of the shards: baselines are fitted and asked too
VERIFY_S, PAPER_S = 90, 1200
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
    """Return a rule's `cpu_ms`, by which a group of cells asks for its time: see gelforge/workflow/patient_slurm.py."""
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


def synthetic_seconds(*_):
    return costs().drawn_indentation()


def true_seconds(wildcards, *_):
    return costs().true_cell(CELLS[wildcards.cell])


def presses_seconds(wildcards, *_):
    return costs().session_presses(wildcards.session)


def verdict_seconds(wildcards, input, threads):
    return costs().mismatch() / threads


def fit_seconds(wildcards, input, threads):
    return PICTURES_S if {Path(name).suffix for name in input} - TABLES else FIT_S


def features_seconds(wildcards, input, threads):
    """Return the time of a session's images, by their number and size."""
    folder = STUDY.session_folder(wildcards.session)
    camera = load_session(folder / "session.yaml").camera
    count = sum(1 for _ in (folder / "images").iterdir())
    return SHORT_S + FEATURES_S_PER_MPX * count * camera.width_px * camera.height_px / 1e6 / threads


def drawing_seconds(wildcards, input, threads):
    """Return the time of the images of a synthetic session."""
    from gelforge.virtual_lab.session import session_cells

    presses = sum(len(CELLS[name].depths_mm) for name in session_cells(LAB, CELLS)[wildcards.session])
    images = presses * LAB.imaging.images_per_press
    return SHORT_S + DRAWING_S_PER_MPX * images * LAB.camera.width_px * LAB.camera.height_px / 1e6 / threads


def training_seconds(wildcards, input, threads):
    return SHORT_S + TRAINING_S_PER_MB * STUDY.learning.usual.epochs * input.size_mb


def evaluation_seconds(wildcards, input, threads):
    return SHORT_S + EVALUATION_S_PER_MB * input.size_mb


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
