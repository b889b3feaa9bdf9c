"""Work side by side in other processes: results in order, and an end in the middle of a task when the command is stopped."""

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path

import pytest
from processes import ended

from gelforge.cli import main
from gelforge.workers import each


def squared(number):
    return number**2


def begun(folder, number):
    """Say who works, and never finish."""
    (folder / f"{number}.new").write_text(str(os.getpid()))
    os.replace(folder / f"{number}.new", folder / str(number))
    threading.Event().wait()


@pytest.mark.parametrize("workers", [1, 2])
def test_results_have_the_order_of_the_tasks(workers):
    assert each(squared, range(5), workers, "squares") == [0, 1, 4, 9, 16]


def own_number(_):
    time.sleep(0.01)  # so that one that is slow to begin has its share
    return os.getpid()


def fails(task):
    raise ValueError(task)


def test_the_workers_stay_for_the_next_call_unless_one_failed_or_was_killed():
    # The workers stay for the next call unless one has failed
    first = set(each(own_number, range(50), 2, "tasks"))
    assert os.getpid() not in first
    assert first & set(each(own_number, range(50), 2, "tasks"))
    with pytest.raises(ValueError, match="0"):
        each(fails, range(3), 2, "tasks")
    assert not first & set(each(own_number, range(50), 2, "tasks"))

    # After a worker was killed the next call has others
    with pytest.raises(BrokenProcessPool):
        each(killed, range(2), 2, "tasks")
    assert each(squared, range(3), 2, "squares") == [0, 1, 4]


def test_they_end_with_a_command(capsys):
    before = set(each(own_number, range(50), 2, "tasks"))
    assert main(["sensors"]) == 0
    assert all(ended(number) for number in before)


def killed(task):
    os.kill(os.getpid(), signal.SIGKILL)


def test_interruptions_and_killed_commands_end_the_workers(tmp_path):
    # An interruption ends the workers in the middle of their tasks. Without that it would wait for two tasks that
    # never end: a hanging test would show it
    before = signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # ignored where tests run in the background

    def interrupt():
        while not all((tmp_path / name).exists() for name in "01"):
            pass
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            each(partial(begun, tmp_path), range(3), 2, "tasks")
    finally:
        signal.signal(signal.SIGINT, before)
    thread.join()
    assert not (tmp_path / "2").exists(), "no further task was begun"
    for name in "01":
        while not ended(int((tmp_path / name).read_text())):
            pass

    # A command that is killed takes its workers with it
    killed_command = tmp_path / "killed_command"
    killed_command.mkdir()
    program = (
        "from functools import partial\nfrom pathlib import Path\nfrom gelforge.workers import each\n"
        f"from test_workers import begun\neach(partial(begun, Path({str(killed_command)!r})), range(2), 2, 'tasks')"
    )
    own = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    with subprocess.Popen([sys.executable, "-c", program], env=own, stderr=subprocess.DEVNULL) as command:
        while not all((killed_command / name).exists() for name in "01"):
            assert command.poll() is None
        command.kill()
    for name in "01":
        while not ended(int((killed_command / name).read_text())):
            pass
