"""What every rule shares: the validated study, the names of its files and the digests of what decides them."""

import json
import math
import os
import sys
from functools import cache
from pathlib import Path

from snakemake import benchmark
from snakemake.exceptions import WorkflowError

from gelforge.cli.extras import missing_for_onnx
from gelforge.config import (
    ConfigError,
    load_session,
    load_virtual_lab,
    session_study,
    study_from,
    variant_study,
    write_yaml,
)
from gelforge.csv_table import TableError
from gelforge.dataset.splits import planned_split
from gelforge.files import atomic, digest, source_digest
from gelforge.indentation.planning.derived import derived_chunks
from gelforge.indentation.planning.lattice import lattice_of, solved_site
from gelforge.indentation.planning.plan import plan_cells, variant_cells
from gelforge.synthesis.draws import shard_count, solution_count
from gelforge.workflow import fork_server
from gelforge.workflow.fork_usage import measure_forks


def _described():
    """Return study, sites, sites by variant and virtual lab, or stop with one plain message before any job."""
    files = map(str, workflow.config_settings.configfiles or ["config/config.yaml"])
    try:
        study = study_from(config, ", ".join(files))
        cells = plan_cells(study)
        variants = {name: variant_cells(cells, study, name) for name in study.variants}
        lab = load_virtual_lab(study.virtual_lab) if study.virtual_lab else None
        for name, material in study.materials.items():
            if material.source and not material.source.exists():
                raise ConfigError(
                    f"{material.source}: no such file or folder; put the tests of {name} there, or run `gelforge examples`"
                    " for those of the examples"
                )
        return study, cells, variants, lab
    except (ConfigError, TableError) as error:
        raise WorkflowError(str(error)) from None


STUDY, CELLS, VARIANTS, LAB = _described()
RESULTS = STUDY.results_folder.as_posix()
DATA = STUDY.data_folder.as_posix()
BETWEEN = [name for name, cell in CELLS.items() if cell.between]  # labels that are interpolated
LATTICE = lattice_of(STUDY, CELLS) if BETWEEN else None
SITES = f"{RESULTS}/solved_sites"  # between which they are interpolated
DERIVED = derived_chunks(CELLS, STUDY.dataset.cells_per_shard)
TRUTH = f"{DATA}/virtual_truth/cells"  # of a virtual lab's sensor
LOGS = f"logs/{STUDY.study}"
BENCHMARKS = f"{RESULTS}/benchmarks"
# In shell commands every value is written {value:q}, a list word by word: what a configuration says is never shell text.
ONE_THREAD = ["OMP_NUM_THREADS=1", "MKL_NUM_THREADS=1", "NUMBA_NUM_THREADS=1"]
os.environ["GELFORGE_RUN"] = os.getcwd()  # marks the jobs of this folder, see gelforge/cli/study/unlock.py
# A command of gelforge, by the environment's own interpreter: a fork of one process where `run_in_forks` has started it.
GELFORGE = [sys.executable, "-I", "-S", fork_server.__file__, fork_server.NOBODY]


def run_in_forks():
    """Let the jobs of this Snakemake be forks of one process, instead of starting Python for each."""
    global _fork_server  # it ends with this process
    GELFORGE[-1], _fork_server = fork_server.started()
    measure_forks(benchmark, GELFORGE[-1])


if not workflow.is_main_process:  # the one inside a cluster's job: `onstart` runs in the user's own only
    run_in_forks()


def _study_file():
    """Return the file that the commands read: this study, whatever happens to the configuration during the run.

    Its name holds its digest. It is no rule's input: an edit of one key must not rerun every rule, and `ancient()`
    inputs that are about to change make Snakemake 9.27 drop the jobs behind them.
    """
    path = Path(".snakemake/studies") / f"{STUDY.study}-{digest(STUDY.model_dump(mode='json'))[:16]}.yaml"
    if not path.is_file():
        with atomic(path) as temporary:
            write_yaml(temporary, STUDY)
    return path.as_posix()


STUDY_FILE = _study_file()
# Where this workflow is a module, Snakemake prints its commands with the names of the main Snakefile: these are given to it.
for name in ("GELFORGE", "ONE_THREAD", "STUDY_FILE", "RESULTS", "DATA"):
    workflow.modifier_stack[0].globals.setdefault(name, globals()[name])


wildcard_constraints:
    cell="[A-Za-z0-9_-]+",
    material="[A-Za-z0-9_-]+",
    session="[A-Za-z0-9_-]+",
    site="[A-Za-z0-9_-]+",
    level=r"\d",
    variant="[A-Za-z0-9_-]+",
    shard=r"\d{5}",
    number=r"\d{5}",


def block(*names, study=STUDY):
    """Return the digest of a study's blocks that a rule uses; an edit elsewhere does not rerun the rule."""
    return digest(study.model_dump(mode="json", include=set(names)))


def cell_files(cells):
    return [f"{RESULTS}/cells/{cell}.h5" for cell in cells]


def variant_files():
    """Return the sites of every variant that the study declares."""
    return [f"{RESULTS}/variants/{name}/{cell}.h5" for name, cells in VARIANTS.items() for cell in cells]


def law_files():
    return [f"{RESULTS}/materials/{material}/law.json" for material in STUDY.materials]


def _described_session(session):
    """Return what a session's session.yaml says, None where it is not there or a virtual lab makes it."""
    path = STUDY.session_folder(session) / "session.yaml"
    if LAB or not path.is_file():
        return None
    try:
        return load_session(path)
    except ConfigError as error:
        raise WorkflowError(str(error)) from None


def _has_images(session):
    """Return whether a session has a camera; a synthetic session that is still to be made has one."""
    described = _described_session(session)
    return described is None or described.camera is not None


def _session_study(session):
    """Return the study at the session's age and temperature; a virtual lab states none."""
    described = _described_session(session)
    return session_study(STUDY, described) if described else STUDY


def _pressed(session):
    """Return the sites that a session with labels of its own needs solved."""
    from gelforge.dataset.recorded_presses import pressed_cells
    from gelforge.recording.readings import RecordingError

    folder = STUDY.session_folder(session)
    if not (folder / "indentations.csv").is_file():
        return []  # the readings' job names what is missing
    try:
        return pressed_cells(folder, CELLS)
    except (RecordingError, TableError) as error:
        raise WorkflowError(str(error)) from None


IMAGE_SESSIONS = [session for session in STUDY.sessions if _has_images(session)]
SESSION_STUDIES = {session: _session_study(session) for session in STUDY.sessions}
IN_ORDER = STUDY.sessions if STUDY.mechanics.effects.history.softens else []  # labels of their own
OWN_CELLS = {
    session: _pressed(session)
    for session, study in SESSION_STUDIES.items()
    if study is not STUDY and session not in IN_ORDER
}
SYNTHETIC = (  # files of training rows
    [f"{RESULTS}/synthetic/{i:05d}.h5" for i in range(shard_count(STUDY))] if STUDY.synthesis else []
)
SOLVED_PRESSES = (  # from which these rows are drawn
    [f"{RESULTS}/synthetic/solved/{i:05d}.h5" for i in range(solution_count(STUDY))]
    if STUDY.synthesis
    else []
)
ONLY_SIMULATED = bool(STUDY.synthesis) and STUDY.synthesis.train_on == "simulated"
# of all sites: one that is added to the plan may move others between training and test
SPLIT, _ = planned_split(CELLS, STUDY.sensor, STUDY.dataset.test_fraction, STUDY.seed)
ONNX_CHECK = f"{RESULTS}/model/onnx_check.json"
SHARDS = [f"{i:05d}" for i in range(math.ceil(len(CELLS) / STUDY.dataset.cells_per_shard))]


def shard_cells(shard):
    """Return the names of a shard's cells: a fixed chunk of the plan."""
    first = int(shard) * STUDY.dataset.cells_per_shard
    return list(CELLS)[first : first + STUDY.dataset.cells_per_shard]


def session_label_files(cells):
    """Return the files with labels that belong to a session: its indentations, or those of these sites that it needs."""
    presses = [f"{RESULTS}/sessions/{session}/presses.h5" for session in IN_ORDER]
    own = [(session, cell) for session, pressed in OWN_CELLS.items() for cell in pressed if cell in cells]
    return presses + [f"{RESULTS}/sessions/{session}/cells/{cell}.h5" for session, cell in own]


def table_files():
    """Return the tables that the study's data allow."""
    names = ["material", "force_ranges"]
    names += ["rmse_gt"] if STUDY.sessions else []
    names += ["rmse", "baselines", "errors_by", "reliability"] if IMAGE_SESSIONS else []
    names += ["error_budget"] if IMAGE_SESSIONS and LAB else []
    return [f"{RESULTS}/tables/{name}.{suffix}" for name in names for suffix in ("csv", "md")]


def material_tests(wildcards):
    """Return every file that decides a material's results, pictures included; nothing where parameters are given.

    What cannot be read is left to the job, which says what is wrong.
    """
    from gelforge.materials.readers.material_source import source_files

    material = STUDY.materials[wildcards.material]
    if material.tests is None:
        return [material.file.as_posix()] if material.file else []
    try:
        files = source_files(material.tests, material.mapping)
    except TableError:
        files = [material.tests / "samples.csv", *material.tests.glob("*.csv")]
    return sorted({path.as_posix() for path in files})


def any_of(names):
    """Return the pattern of a wildcard that is one of these names."""
    return "|".join(names) or "(?!)"


def derived_sources(names):
    """Return what the labels of mirrored and interpolated sites are made from; after the last level is decided, all of it."""
    sources = {CELLS[name].source for name in names if not CELLS[name].between}
    if any(CELLS[name].between for name in names):
        decided, path = last_level()
        return [path, *site_files(decided["solved"] + decided["themselves"]), *cell_files(sorted(sources))]
    return cell_files(sorted(sources))


def site_files(names):
    return [f"{SITES}/{name}.h5" for name in names]


def sites_of_level(wildcards):
    """Return the solved sites that a level's decision reads: its own and those of the levels before."""
    from gelforge.interpolation.levels import first_level

    level = int(wildcards.level)
    if level == 0:
        return site_files(first_level(LATTICE))
    before = decision(level - 1)
    return site_files(before["solved"] + before["more"])


def decision(level):
    """Return what a level decided; Snakemake waits for it, and asks again, where it is not known yet."""
    return json.loads(Path(checkpoints.level.get(level=level).output[0]).read_text(encoding="utf-8"))


def last_level():
    """Return the decision after which no more sites are solved between which labels are interpolated, and its file."""
    level = 0
    while (found := decision(level))["more"]:
        level += 1
    return found, checkpoints.level.get(level=level).output[0]


def site_of(wildcards):
    """Return the site that is solved under a name: a place of the lattice, or one of the plan itself."""
    return solved_site(LATTICE, wildcards.site) or CELLS[wildcards.site]


def mirrored_session_cell(wildcards):
    source = CELLS[wildcards.cell].source
    return f"{RESULTS}/sessions/{wildcards.session}/cells/{source}.h5" if source else []


def solved_settings(_):
    """Return the digest of what decides a solved press of the simulated training set; how many there are is not among it."""
    of_rows = {
        "rows",
        "rows_per_shard",
        "patterns",
        "particles",
        "camera",
        "imaging",
        "views",
        "classes",
        "train_on",
    }
    drawn = STUDY.synthesis.model_dump(mode="json", exclude={"paths", *of_rows})
    return digest([drawn, STUDY.plan.approach, block("sensor", "indenter", "mechanics")])


def drawn_settings(_):
    """Return the digest of what decides drawn rows; how many shards there are is not among it."""
    drawn = STUDY.synthesis.model_dump(mode="json", exclude={"train_on"})
    return digest([drawn, block("sensor", "indenter", "features")])


def planned(wildcards):
    return planned_cell(CELLS[wildcards.cell])


def planned_cell(cell):
    moves = [cell.phases, cell.shears_mm, cell.tilts_deg, *([cell.twists_deg] if cell.twists_deg else [])]
    path = map(list, moves) if cell.follows_a_path else []
    between = [cell.between] if cell.between else []
    return [
        cell.x_mm,
        cell.y_mm,
        list(cell.depths_mm),
        cell.source or "",
        cell.symmetry or "",
        *path,
        *between,
    ]


def planned_site(wildcards):
    site = site_of(wildcards)
    return [site.x_mm, site.y_mm, list(site.depths_mm)]


def indenter_files():
    """Return the surfaces from which the indenter is read."""
    return [str(part.file) for part in STUDY.indenter.shapes if part.file]


def session_files(session, *names):
    """Return files of a session's folder. What a measured session lacks next to its tables is left to its reader,

    which knows whether it is needed and says what to do.
    """
    folder, needed = f"{DATA}/recordings/{session}", ("session.yaml", "indentations.csv")
    made = (*needed, "reference.png", "images") if LAB else needed
    return [f"{folder}/{name}" for name in names if name in made or os.path.exists(f"{folder}/{name}")]


def image_content(wildcards):
    """Return the digest of a session's images: one that is overwritten in place changes no time stamp of their folder.

    A session that a job is still to make has none yet; Snakemake asks again before a job starts.
    """
    folder = STUDY.session_folder(wildcards.session)
    images = folder / "images"
    return _images_digest(folder, images.stat().st_mtime_ns if images.is_dir() else 0)


@cache
def _images_digest(folder, changed_ns):
    from gelforge.recording.imaging.image_digest import images_digest

    return images_digest(folder)


def joined_sites(wildcards):
    """Return the digest of the sites that a session's indentations join, and of the paths that these follow.

    A plan file, or another session that the plan is made of, may have changed. What cannot be read is left to the job.
    """
    from gelforge.dataset.recorded_presses import read_presses
    from gelforge.recording.readings import RecordingError

    folder = STUDY.session_folder(wildcards.session)
    if not all((folder / name).is_file() for name in ("session.yaml", "indentations.csv")):
        return ""
    try:
        joined = read_presses(folder, CELLS).drop_duplicates("press")
    except (ConfigError, RecordingError, TableError):
        return ""
    paths = {
        name: planned_cell(CELLS[name]) for name in joined["cell"].dropna() if CELLS[name].follows_a_path
    }
    return digest([joined["press"].tolist(), joined["cell"].fillna("").tolist(), paths])


TABLES = {".csv", ".txt", ".tsv", ".yaml", ".yml", ".md"}


def check_extras(jobs):
    """Stop before any job where a job needs what is not installed."""
    if any(job.rule.name == "export" for job in jobs) and (words := missing_for_onnx()):
        raise WorkflowError(words)


def check_raw_data(jobs):
    """Read what these jobs are about to read of a laboratory's own data; stop with one plain message at what is wrong.

    Snakemake deletes a job's former results before the job finds out, and with keep-going spends hours on cells
    next to it. Material tests with pictures are left to their job, which takes minutes to track them.
    """
    from gelforge.materials.readers.material_source import source_of
    from gelforge.recording.copies import check_copies
    from gelforge.recording.readings import RecordingError, read_recording

    try:
        for job in jobs:
            if job.rule.name == "characterise" and {Path(name).suffix for name in job.input} <= TABLES:
                material = STUDY.materials[job.wildcards.material]
                if material.tests:
                    source_of(job.wildcards.material, material.tests, material.mapping)
        recorded = {job.wildcards.session for job in jobs if job.rule.name in ("readings", "features")}
        for session in [] if LAB else sorted(recorded):
            read_recording(STUDY.session_folder(session), CELLS, STUDY.sensor)
        if not LAB and {job.rule.name for job in jobs} & {"readings", "features", "agreement", "mismatch"}:
            check_copies({name: STUDY.session_folder(name) for name in STUDY.sessions})
    except (ConfigError, RecordingError, TableError) as error:
        raise WorkflowError(str(error)) from None


def _pressed_truth(session):
    """Return the truth of the sites that a session presses; a mirrored site is seen through its source."""
    from gelforge.virtual_lab.session import session_cells

    pressed = session_cells(LAB, CELLS)[session]
    return [f"{TRUTH}/{cell}.h5" for cell in dict.fromkeys(CELLS[name].source or name for name in pressed)]


def true_cells(wildcards):
    return _pressed_truth(wildcards.session)


def recorded_truth(_):
    """Return the truth of the sites that the study's sessions press; nothing where no virtual lab makes them."""
    return sorted({path for session in STUDY.sessions for path in _pressed_truth(session)}) if LAB else []


def lab_block(*names):
    """Return the digest of the virtual lab's blocks that a rule uses."""
    return digest(LAB.model_dump(mode="json", include=set(names)))
