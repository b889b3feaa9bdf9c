"""A folder with everything a run needs, so that tests run Snakemake next to the checkout and not in it."""

import os
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
import snakemake.cli
import yaml
from fault_kinds.forks import end_with
from filelock import FileLock

ROOT = Path(__file__).parents[2]
HOSTILE = (
    "data/lab's x$(touch Y) `touch Z`;touch W"  # of a data folder: a shell that reads it makes Y, Z and W
)
# What the Snakefile imports, and Snakemake while it reads one.
IMPORTED = (
    "gelforge.materials.readers.material_source",
    "gelforge.cli.study.cost",
    "gelforge.dataset.presses_in_order",
    "gelforge.dataset.recorded_presses",
    "gelforge.virtual_lab.session",
    "smart_open",
)


class Checkout:
    """A copy of the workflow, its configuration and the demo's material tests in a temporary folder."""

    def __init__(self, folder: Path):
        self.folder = folder
        shutil.copy(ROOT / "Snakefile", folder)
        for name in ("workflow", "config"):
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        (folder / "profiles").symlink_to("workflow/profiles")
        shutil.copytree(
            ROOT / "data", folder / "data", ignore=shutil.ignore_patterns("recordings", "virtual_truth")
        )

    def command(self, *arguments: str) -> list[str]:
        return [sys.executable, "-m", "snakemake", *arguments]

    def snakemake(self, *arguments: str, check: bool = True) -> subprocess.CompletedProcess:
        """Run Snakemake here, in a fork of this process, and return what it printed, output and errors together.

        A fork has imported what Snakemake and the Snakefile import, which is most of a dry run's time.
        """
        import_before_forks()
        with tempfile.TemporaryFile("w+", errors="replace") as printed:
            child = os.fork()
            if not child:
                end_with(lambda: run_snakemake(arguments, self.folder, printed.fileno()))
            status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            printed.seek(0)
            done = subprocess.CompletedProcess(["snakemake", *arguments], status, printed.read())
        assert not check or done.returncode == 0, done.stdout[-6000:]
        return done

    def snakemake_alone(self, *arguments: str) -> None:
        """Run Snakemake here in a process of its own, as users do."""
        done = subprocess.run(
            self.command(*arguments),
            cwd=self.folder,
            env=environment(),
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        assert done.returncode == 0, done.stdout[-6000:]

    def jobs(self, *arguments: str) -> dict[str, int]:
        """Return how many jobs of each rule a dry run lists."""
        printed = self.snakemake(*arguments, "-n", "--quiet", "rules").stdout
        table = printed.partition("Job stats:")[2].partition("total")[0].splitlines()
        rows = (line.split() for line in table)
        return {row[0]: int(row[1]) for row in rows if len(row) == 2 and row[1].isdigit()}

    def coarsen(self, name: str = "config/test.yaml") -> None:
        """Make cells of a study and of the test study's virtual lab cheap: laws given, one depth, large elements."""
        mesh = {"near_mm": 2.0, "near_radius_mm": 2.0, "far_mm": 4.0}
        lab, path = self.folder / "config/virtual_lab/test.yaml", self.folder / name
        truth, study = yaml.safe_load(lab.read_text()), yaml.safe_load(path.read_text())
        truth["mechanics"]["mesh"] = study["mechanics"]["mesh"] = mesh
        study["plan"]["depths_mm"] = [0.8]
        study["materials"]["ecoflex_gel"] = {"parameters": truth["materials"]["ecoflex_gel"]}
        lab.write_text(yaml.safe_dump(truth))
        path.write_text(yaml.safe_dump(study))

    def move_data(self, folder: str, name: str = "config/test.yaml") -> None:
        """Let the test study, under this name too, keep its raw data in another folder."""
        content = yaml.safe_load((self.folder / "config/test.yaml").read_text()) | {"data": folder}
        (self.folder / name).write_text(yaml.safe_dump(content))

    def files(self, pattern: str) -> dict[str, bytes]:
        """Return the bytes of files here, by path."""
        return {
            path.relative_to(self.folder).as_posix(): path.read_bytes() for path in self.folder.glob(pattern)
        }


@cache
def import_before_forks() -> None:
    """Import what the Snakefile and a starting Snakemake import, once for all forks of this process.

    Snakemake itself is imported above: it keeps the standard output that it finds, which in a test is a test's own.
    """
    for name in IMPORTED:
        import_module(name)
    snakemake.cli.get_argument_parser()  # looks for plugins in every folder of Python's path, and imports them


def run_snakemake(arguments, folder: Path, output: int) -> None:
    """Be Snakemake in this fork; it ends by SystemExit."""
    for number in (1, 2):
        os.dup2(output, number)
    # not pytest's, which capture what is printed
    sys.stdout, sys.stderr = (open(number, "w", closefd=False, buffering=1) for number in (1, 2))
    sys.stdin = open(os.devnull)
    sys.argv = ["snakemake", *arguments]
    own = environment()
    os.environ.clear()
    os.environ.update(own)
    os.chdir(folder)
    snakemake.cli.main(list(arguments))


def environment() -> dict[str, str]:
    """Return this environment without what pytest's own parent may have set for Snakemake."""
    return {
        key: value for key, value in os.environ.items() if not key.startswith(("SNAKEMAKE", "GELFORGE_RUN"))
    }


@pytest.fixture
def checkout(tmp_path) -> Checkout:
    return Checkout(tmp_path)


@pytest.fixture(scope="session")
def finished(tmp_path_factory, request) -> Checkout:
    """The test study, run to its end once for all processes; tests that change it work in a copy (see `again`).

    Its folder's name has spaces and a quote, its data folder's name commands.
    """
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if hasattr(request.config, "workerinput") else base  # of pytest-xdist's processes
    with FileLock(shared / "finished.lock"):
        run = Checkout.__new__(Checkout)
        run.folder = shared / "user's finished study"
        if not (shared / "finished.done").is_file():
            shutil.rmtree(run.folder, ignore_errors=True)  # of a process that failed
            run.folder.mkdir()
            run = Checkout(run.folder)
            run.move_data(HOSTILE)
            run.snakemake_alone("--cores", "2", "--configfile", "config/test.yaml")
            (shared / "finished.done").touch()
    return run


@pytest.fixture
def again(finished, tmp_path) -> Checkout:
    """A copy of the finished study, time stamps kept."""
    others = shutil.ignore_patterns("faults-*")  # what another process tries out there, see test_faults
    shutil.copytree(finished.folder, tmp_path, symlinks=True, dirs_exist_ok=True, ignore=others)
    run = Checkout.__new__(Checkout)
    run.folder = tmp_path
    return run
