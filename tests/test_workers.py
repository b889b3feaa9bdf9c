"""Work side by side in other processes: results in order, and an end in the middle of a task when the command is stopped."""

import os
import signal
import threading
from functools import partial
from pathlib import Path

import pytest

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


def test_an_interruption_ends_the_workers_in_the_middle_of_their_tasks(tmp_path):
    """Without that it would wait for two tasks that never end: a hanging test would show it."""
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
        while Path(f"/proc/{(tmp_path / name).read_text()}").exists():
            pass
