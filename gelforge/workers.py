"""Work that is done side by side in other processes, which end at once when the command is interrupted."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from typing import Any

from gelforge.progress import tracked


def each(work: Callable, tasks: Sequence, workers: int, what: str) -> list:
    """Return work(task) of every task, in order, by this process or by so many others; what: for the progress shown.

    A signal that ends the command (KeyboardInterrupt, or what SIGTERM raises) ends the others too, in the middle of a task:
    a pool by itself waits until they have finished what they have begun, which takes minutes where they solve.
    """
    if workers == 1 or len(tasks) < 2:
        return [work(task) for task in tracked(tasks, what)]
    context = multiprocessing.get_context("forkserver")
    with ProcessPoolExecutor(
        min(workers, len(tasks)), context, initializer=_leave_ctrl_c_to_the_command
    ) as pool:
        begun: set[int] = set()
        try:
            results = pool.map(work, tasks)
            begun |= _process_ids(pool)
            return list(tracked(results, what, len(tasks)))
        except Exception:
            raise
        except BaseException:
            for process in begun | _process_ids(pool):
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
            raise


def _leave_ctrl_c_to_the_command() -> None:
    """A terminal sends Ctrl-C to all processes of a command; here it would only begin the next task."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _process_ids(pool: ProcessPoolExecutor) -> set[int]:
    """Return the ids of a pool's processes: no public name gives them before Python 3.14."""
    processes: dict[int, Any] = getattr(pool, "_processes", None) or {}
    return set(processes)
