"""What the machine does to a command: no locks, a signal, a full disk; each is one line, and no file is called broken."""

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

from gelforge.cli import main
from gelforge.hdf5 import writing

NO_LOCKS = """
#include <errno.h>
int flock(int fd, int operation) { (void)fd; (void)operation; errno = ENOLCK; return -1; }
"""


@pytest.fixture
def shard(tmp_path):
    path = tmp_path / "shard-00000.h5"
    with writing(path) as file:
        file.attrs["format"], file.attrs["rows"], file.attrs["labels_only"] = "gelforge-shard-2", 1, True
        file.attrs["cells"], file.attrs["failed_cells"], file.attrs["sessions"] = '{"a": {}}', "{}", "{}"
        file.attrs["synthetic"], file.attrs["study"] = False, "small"
        file["cell"], file["depth_mm"] = np.array([b"a"], object), np.array([1.0])
    return path


@pytest.fixture
def without_locks(tmp_path):
    """The environment of a file system that refuses every lock, as some network file systems do."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    (tmp_path / "flock.c").write_text(NO_LOCKS)
    library = tmp_path / "no_locks.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, tmp_path / "flock.c"], check=True)
    return {k: v for k, v in os.environ.items() if k != "HDF5_USE_FILE_LOCKING"} | {
        "LD_PRELOAD": str(library)
    }


def explain(shard, environment):
    command = [sys.executable, "-m", "gelforge", "explain", str(shard), "0"]
    return subprocess.run(command, env=environment, capture_output=True, text=True)


def test_a_file_system_without_locks_needs_nothing_but_a_variable_at_most(shard, without_locks):
    done = explain(shard, without_locks)
    assert done.returncode == 0, done.stderr

    # Where locks are asked for the variable is named and nothing is to be deleted
    done = explain(shard, without_locks | {"HDF5_USE_FILE_LOCKING": "TRUE"})
    assert done.returncode == 1
    assert "cannot be opened" in done.stderr
    assert "HDF5_USE_FILE_LOCKING=FALSE" in done.stderr
    assert "delete" not in done.stderr
    assert len(done.stderr.splitlines()) == 1


TERMINATED = """
import os, signal, sys
import gelforge.cli.study.show
from gelforge.cli import main
from gelforge.files import atomic

def explain(path, row):
    with atomic(path) as temporary:
        temporary.write_text("half")
        os.kill(os.getpid(), signal.SIGTERM)
        for _ in range(10**9):
            pass

gelforge.cli.study.show.explain = explain
sys.exit(main(["explain", sys.argv[1], "0"]))
"""


INSIDE_HDF5 = """
import os, signal, sys
import numpy as np
import gelforge.cli.study.show
from gelforge import hdf5
from gelforge.cli import main

def kill_once(frame, event, argument):
    if event == "call" and frame.f_code is hdf5._Patient.write.__code__:
        sys.setprofile(None)
        os.kill(os.getpid(), signal.SIGTERM)

def explain(path, row):
    with hdf5.writing(path) as file:
        sys.setprofile(kill_once)
        for number in range(10**6):
            file[f"values {number}"] = np.zeros(10000)

gelforge.cli.study.show.explain = explain
sys.exit(main(["explain", sys.argv[1], "0"]))
"""


@pytest.mark.parametrize(
    ("program", "name"),
    [
        pytest.param(TERMINATED, "product.csv", id="at_once"),
        pytest.param(INSIDE_HDF5, "product.h5", id="while_hdf5_writes"),
    ],
)
def test_sigterm_leaves_nothing_half_written(tmp_path, program, name):
    command = [sys.executable, "-c", program, str(tmp_path / name)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 143
    assert done.stderr.startswith("gelforge: terminated")
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(28, "No space left on device", "results/a"), "results/a: not written, no space is left"),
        (PermissionError(13, "Permission denied", "data/a"), "data/a: permission denied"),
        (OSError(24, "Too many open files", "a"), "too many files are open; raise the limit"),
        (MemoryError(), "no memory is left"),
    ],
)
def test_errors_of_the_machine_are_one_line(monkeypatch, capsys, error, words):
    import gelforge.cli.study.show

    def fail(**_):
        raise error

    monkeypatch.setattr(gelforge.cli.study.show, "explain", fail)
    assert main(["explain", "a", "0"]) == 1
    said = capsys.readouterr().err
    assert words in said
    assert len(said.splitlines()) == 1
    with pytest.raises(type(error)):
        main(["explain", "a", "0", "--debug"])
