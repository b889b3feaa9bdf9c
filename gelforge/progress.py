"""Progress of what takes longer than five seconds: what it does, how far it is, about how long it will still take.

On a terminal it is one line of standard error that is rewritten and cleared at the end. In a log it is a line after five
seconds, and then one whenever a tenth more is done or a minute has passed. The time left is that of the mean step so far.
Shown is the outermost of nested ones, and only in the process of a command (`show`): its workers are silent.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from typing import TypeVar

Item = TypeVar("Item")

FIRST_S = 5.0  # what ends sooner leaves no line in a log
EVERY_S = 60.0
SHARE = 0.1
REWRITTEN_S = 0.1  # on a terminal

_shown_by = 0  # the process that shows progress
_shown: list[Progress] = []  # the outermost that runs


def show() -> None:
    """Let this process, and not those that it starts, show progress."""
    global _shown_by
    _shown_by = os.getpid()
    _shown.clear()


class Progress:
    """How far some work is: `with Progress("images", 340) as progress: ... progress.advance()`.

    total: None where nobody knows. first: how many of it were done before and cost nothing now. rewritten: as on a
    terminal; None: where standard error is one.
    """

    def __init__(
        self,
        what: str,
        total: int | None,
        first: int = 0,
        clock: Callable[[], float] = time.monotonic,
        rewritten: bool | None = None,
    ):
        self.what, self.total, self.done, self._first, self._clock = what, total, first, first, clock
        self._rewritten = sys.stderr.isatty() if rewritten is None else rewritten
        self._start, self._told, self._told_done, self._lines = clock(), -FIRST_S, first, 0

    def __enter__(self) -> Progress:
        if os.getpid() == _shown_by and not _shown:
            _shown.append(self)
            self._tell("")
        return self

    def __exit__(self, *error) -> None:
        if self not in _shown:
            return
        _shown.remove(self)
        if self._rewritten:
            self._print("\r\033[2K", end="")
        elif self._lines:
            end = "stopped after" if error[0] else "took"
            self._print(f"{self.text()}; {end} {duration(self._clock() - self._start)}")

    def advance(self, count: int = 1, note: str = "") -> None:
        """Count steps as done; note: what to say beside the count."""
        self.done += count
        if self in _shown:
            self._tell(note)

    def text(self) -> str:
        """Return what is done, in words."""
        return f"{self.what}: {self.done}" + ("" if self.total is None else f" of {self.total}")

    def _tell(self, note: str) -> None:
        seconds = self._clock() - self._start
        if self.done == self.total or not self._is_time(seconds):
            return
        words = ", ".join(part for part in (self.text(), self.left(seconds), note) if part)
        self._told, self._told_done, self._lines = seconds, self.done, self._lines + 1
        if self._rewritten:
            self._print(f"\r\033[2K{words}", end="")
        else:
            self._print(words)

    @staticmethod
    def _print(words: str, end: str = "\n") -> None:
        print(words, end=end, file=sys.stderr, flush=True)

    def _is_time(self, seconds: float) -> bool:
        if self._rewritten:
            return seconds - self._told >= REWRITTEN_S
        if seconds < FIRST_S:
            return False
        more = self.total is not None and self.done - self._told_done >= SHARE * self.total
        return (
            not self._lines or (more and seconds - self._told >= FIRST_S) or seconds - self._told >= EVERY_S
        )

    def left(self, seconds: float) -> str:
        """Return in words how long the rest will take after so many seconds, "" where that is not known."""
        if self.total is None or self.done == self._first:
            return ""
        step = seconds / (self.done - self._first)
        return f"about {duration(step * (self.total - self.done))} left"


def tracked(items: Iterable[Item], what: str, total: int | None = None) -> Iterator[Item]:
    """Yield items, and show how many of them are done; total: how many there are, where they do not know it."""
    if total is None and isinstance(items, Sized):
        total = len(items)
    with Progress(what, total) as progress:
        for item in items:
            yield item
            progress.advance()


def duration(seconds: float) -> str:
    """Return a time in words, to two figures or so: "8 s", "3 min 20 s", "2 h 15 min"."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 600:
        minutes, rest = divmod(10 * round(whole / 10), 60)
        return f"{minutes} min {rest} s" if rest else f"{minutes} min"
    minutes = round(seconds / 60)
    if minutes < 60:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min" if minutes % 60 else f"{minutes // 60} h"
