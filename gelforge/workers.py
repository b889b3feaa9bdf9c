"""Work that is done side by side in other processes, which end at once when the command is interrupted."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from typing import Any

from gelforge.progress import tracked

# By this process (a fork has none of its parent's) and their number. A new one takes seconds to import and to load kernels.
_kept: dict[tuple[int, int], ProcessPoolExecutor] = {}


def each(work: Callable, tasks: Sequence, workers: int, what: str) -> list:
    """Return the results of every task, in order, by this process or by several others.

    The others stay for the next call, and end with the command. A signal that ends the command (KeyboardInterrupt, or what
    SIGTERM raises) ends them too, in the middle of a task: a pool by itself waits until they have finished what they have
    begun, which takes minutes where they solve.

    Parameters
    ----------
    work : callable
        Takes one task; it must be importable where `workers` is above 1.
    tasks : sequence
        Arguments.
    workers : int
        Number of processes; 1 for this one.
    what : str
        Words for the line of progress.

    Returns
    -------
    list
        work(task) of every task.
    """
    if workers == 1 or len(tasks) < 2:
        return [work(task) for task in tracked(tasks, what)]
    pool = _pool(workers)
    begun: set[int] = set()
    try:
        results = pool.map(work, tasks)
        begun |= _process_ids(pool)
        return list(tracked(results, what, len(tasks)))
    except BaseException as reason:
        if not isinstance(reason, Exception):  # not of a task: the command is to end
            for process in begun | _process_ids(pool):
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
        _leave((os.getpid(), workers))
        raise


def _pool(workers: int) -> ProcessPoolExecutor:
    key = (os.getpid(), workers)
    if key not in _kept:
        context = multiprocessing.get_context("forkserver")
        _kept[key] = ProcessPoolExecutor(workers, context, initializer=_leave_the_end_to_the_command)
    return _kept[key]


def _leave(key: tuple[int, int]) -> None:
    """End a pool, what it has begun finished, so that the next call has another."""
    _kept.pop(key).shutdown(cancel_futures=True)


def end() -> None:
    """End the processes that stay: a command that is a fork of a loaded process leaves without Python's own farewell."""
    for key in [key for key in _kept if key[0] == os.getpid()]:
        _leave(key)


def _leave_the_end_to_the_command() -> None:
    """A terminal sends Ctrl-C to all processes of a command; here it would only begin the next task."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_the_command, daemon=True).start()


def _end_with_the_command() -> None:
    """Wait for the end of the command, which may be killed, and end in the middle of a task."""
    command = multiprocessing.parent_process()
    assert command is not None
    command.join()
    os._exit(1)


def _process_ids(pool: ProcessPoolExecutor) -> set[int]:
    """Return the ids of a pool's processes: no public name gives them before Python 3.14."""
    processes: dict[int, Any] = getattr(pool, "_processes", None) or {}
    return set(processes)
