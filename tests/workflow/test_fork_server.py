"""Jobs that are forks of one process: what they print and return, and what happens where none answers."""

import os
import re
import shlex
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from processes import ended
from snakemake import benchmark
from snakemake.shell import shell

from gelforge import __version__
from gelforge.workflow import fork_server
from gelforge.workflow.fork_usage import measure_forks

SCRIPT = Path(fork_server.__file__)
# A server that loads nothing, and whose command is a line of Python.
SERVER = """
import gelforge.cli
from gelforge.workflow import fork_server
gelforge.cli.main = lambda arguments: exec(arguments[0])
true, asked = fork_server.digest, []
def digest():
    asked.append(True)
    return {digest} if len(asked) == 1 else true()
fork_server.digest = digest
fork_server.serve({address!r})
"""


@pytest.fixture
def start(tmp_path):
    """Return a function that starts a server and returns its address; digest: of its code at first, as Python."""
    servers = []

    def server(digest="true()", fails=False):
        (tmp_path / "socket").mkdir()
        address = str(tmp_path / "socket/forks")
        code = SERVER.format(digest=digest, address=address)
        process = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE)
        servers.append((process, fails))
        while not os.path.exists(address):
            assert process.poll() is None
        return address

    yield server
    for process, fails in servers:
        process.stdin.close()
        assert (process.wait() != 0) == fails
        assert (tmp_path / "socket").exists() == fails


def job(address, line, **options):
    return subprocess.Popen(
        [sys.executable, "-I", "-S", str(SCRIPT), address, line],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def test_a_fork_has_the_jobs_folder_environment_and_outputs(start, tmp_path):
    line = "import os, sys; print(os.getcwd(), os.environ['HERE'], os.getppid()); print('bad', file=sys.stderr); sys.exit(3)"
    address = start()
    answers = []
    for _ in range(2):
        done = job(address, line, cwd=tmp_path, env=os.environ | {"HERE": "set"})
        printed, errors = done.communicate()
        assert (done.returncode, errors) == (3, "bad\n")
        answers.append(printed.split())
    assert answers[0] == answers[1], "one process forks for both"
    assert answers[0][:2] == [str(tmp_path), "set"]


def test_a_signal_reaches_the_fork(start):
    done = job(start(), "import time; print('running', flush=True); time.sleep(1000)")
    assert done.stdout.readline() == "running\n"
    done.send_signal(signal.SIGTERM)
    done.communicate()
    assert done.returncode == 128 + signal.SIGTERM


def test_a_fork_that_does_not_look_up_is_ended_after_ctrl_c(start):
    """As compiled code may not, for as long as it computes; here nothing would ever end it."""
    deaf = "signal.signal(signal.SIGINT, signal.SIG_IGN)"
    done = job(start(), f"import os, signal, time; {deaf}; print(os.getpid(), flush=True); time.sleep(1000)")
    fork = int(done.stdout.readline())
    done.send_signal(signal.SIGINT)
    assert done.communicate() == ("", "")
    assert done.returncode == 128 + signal.SIGINT
    while not ended(fork):
        pass  # a hanging test would show it


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_the_server_loads_ends_the_job_without_a_word(start, number, tmp_path):
    mark = tmp_path / "loading"
    done = job(
        start(f"__import__('time').sleep(0.2 if open({str(mark)!r}, 'w') else 0) or true()"), "print('ran')"
    )
    while not mark.exists():
        assert done.poll() is None
    done.send_signal(number)
    assert done.communicate() == ("", "")
    assert done.returncode == 128 + number


def test_a_fork_ends_with_its_job(start):
    done = job(start(), "import os, time; print(os.getpid(), flush=True); time.sleep(1000)")
    fork = int(done.stdout.readline())
    done.kill()
    done.wait()
    while not ended(fork):
        pass  # a hanging test would show it


@pytest.mark.parametrize(
    ("line", "said", "status"),
    [
        pytest.param("raise ArithmeticError('no')", "ArithmeticError: no", 1, id="crash"),
        pytest.param("import os; os.kill(os.getpid(), 9)", "the process was killed", 137, id="killed"),
    ],
)
def test_a_fork_that_fails_is_a_failed_job(start, line, said, status):
    done = job(start(), line)
    assert said in done.communicate()[1]
    assert done.returncode == status


BUSY = "import time; held = bytearray(150 << 20)\nwhile time.process_time() < {}: pass\nprint(time.process_time())"


@pytest.mark.parametrize("prefix", ["", "A=1 ", ": ; "])
def test_a_benchmark_record_states_what_the_fork_used(start, monkeypatch, tmp_path, prefix):
    """As Snakemake runs a rule's command: the shell's process is what it measures."""
    monkeypatch.setattr(benchmark, "benchmarked", benchmark.benchmarked)  # put back afterwards
    address = start()
    measure_forks(benchmark, address)
    records = []
    for seconds in (0.5, 0.1):
        said = tmp_path / "said"
        command = [sys.executable, "-I", "-S", str(SCRIPT), address, BUSY.format(seconds)]
        records.append(benchmark.BenchmarkRecord())
        shell(f"{prefix}{shlex.join(command)} &> {said}", bench_record=records[-1])
        own = float(said.read_text())
        assert own <= records[-1].cpu_time < own + 0.1  # what follows the last line
    assert all(150 < record.max_rss < 1500 for record in records)
    columns = dict(zip(benchmark.BenchmarkRecord.get_header(), records[0].to_tsv(False).split("\t")))
    assert columns["cpu_time"] == f"{records[0].cpu_time:.2f}"
    assert columns["max_vms"] == columns["io_in"] == "-"
    assert float(columns["mean_load"]) == pytest.approx(
        100 * records[0].cpu_time / records[0].running_time, abs=0.01
    )


def test_what_a_fork_used_is_found_by_a_job_that_its_shell_has_become(start):
    address = start()
    done = job(address, BUSY.format(0.1))
    own = float(done.communicate()[0])
    cpu_s, memory_MB = map(float, Path(fork_server.usage_file(address, done.pid)).read_text().split())
    assert cpu_s >= own and memory_MB > 150


def test_a_job_without_a_fork_is_measured_by_snakemake_alone(monkeypatch, tmp_path):
    monkeypatch.setattr(benchmark, "benchmarked", benchmark.benchmarked)
    measure_forks(benchmark, str(tmp_path / "nobody"))
    record = benchmark.BenchmarkRecord()
    shell(f"{sys.executable} -c 'import time; time.sleep(0.7)'", bench_record=record)
    assert record.max_vms > 0


def test_edited_sources_leave_the_job_its_own_process(start):
    done = job(start("'of other sources'"), "--version")  # of the true command line
    assert done.communicate() == (f"{__version__}\n", "")


def test_a_server_that_cannot_load_leaves_the_job_its_own_process(start, capfd):
    done = job(start("1 / 0", fails=True), "--version")
    assert done.communicate() == (f"{__version__}\n", "")
    assert "ZeroDivisionError" in capfd.readouterr().err


def test_commands_of_the_rules_are_loaded_and_run_without_server_or_extra(monkeypatch):
    # Commands of the rules are those that are loaded for. A command that is not listed works and loads everything
    # in each of its forks
    rules = "".join(path.read_text() for path in (SCRIPT.parents[2] / "workflow/rules").glob("*.smk"))
    commands = set(re.findall(r"{GELFORGE:q} ([a-z-]+)", rules))
    assert "simulate" in commands
    once = {"report"}  # one job of a study, and nothing of it is another's
    assert commands - once == fork_server.SOLVING | set(fork_server.IMPORTS)
    assert all(find_spec(module) for module in fork_server.IMPORTS.values())

    # Nobody there
    done = job("-", "--version")
    assert done.communicate() == (f"{__version__}\n", "")

    # An extra that is not installed does not end the server. A study of labels alone makes its tables without
    # PyTorch
    monkeypatch.setitem(fork_server.IMPORTS, "of an extra", "gelforge_needs_what_is_not_there")
    fork_server.load("of an extra")
