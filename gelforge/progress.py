"""Progress of what takes longer than five seconds: what it does, how far it is, about how long it will still take.

On a terminal it is one line of standard error that is rewritten and cleared at the end. In a log it is a line after five
seconds, and then one whenever a tenth more is done or a minute has passed. The time left is that of the mean step so far.
Shown is the outermost of nested ones, and only in the process of a command (`show`): its workers are silent. Work of several
kinds is shown by stages (`Stages`): the one that runs, and within it how far it is.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from typing import TypeVar

Item = TypeVar("Item")

# Seconds after which a log has its first line, and one again where less than this share more is done (judgement): a command
# that is silent for longer looks broken, and ten hours make 600 lines.
FIRST_S, EVERY_S, SHARE = 5.0, 60.0, 0.1

_shown_by = 0  # the process that shows progress
_shown: list[Progress] = []  # the outermost that runs
_stages: list[Stages] = []  # the outermost around it


def show() -> None:
    """Let this process, and not those that it starts, show progress."""
    global _shown_by
    _shown_by = os.getpid()
    _shown.clear()
    _stages.clear()


class _Shown:
    """What one command shows of a piece of work, on a terminal or in a log."""

    def __init__(self, what: str, clock: Callable[[], float], rewritten: bool | None):
        self.what, self._clock = what, clock
        self._rewritten = sys.stderr.isatty() if rewritten is None else rewritten
        self._start, self._lines = clock(), 0

    def _seconds(self) -> float:
        return self._clock() - self._start

    def _print(self, words: str) -> None:
        self._lines += 1
        print_now(f"\r\033[2K{words}" if self._rewritten else words, end="" if self._rewritten else "\n")

    def _end(self, words: str, failed: bool) -> None:
        """Clear the line of a terminal; say in a log that has lines how long it took."""
        if self._rewritten:
            print_now("\r\033[2K", end="")
        elif self._lines:
            print_now(f"{words} {'stopped after' if failed else 'took'} {duration(self._seconds())}")


class Progress(_Shown):
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
        super().__init__(what, clock, rewritten)
        self.total, self.done, self._first = total, first, first
        self._told, self._told_done = -FIRST_S, first

    def __enter__(self) -> Progress:
        if os.getpid() == _shown_by and not _shown:
            _shown.append(self)
            self._tell("")
        return self

    def __exit__(self, *error) -> None:
        if self in _shown:
            _shown.remove(self)
            self._end(f"{self.text()};", bool(error[0]))
            if self._rewritten:
                for stages in _stages:
                    stages.say()

    def advance(self, count: int = 1, note: str = "") -> None:
        """Count steps as done; note: what to say after the count."""
        self.done += count
        if self in _shown:
            self._tell(note)

    def text(self) -> str:
        """Return what is done, in words."""
        return f"{self.what}: {self.done}" + ("" if self.total is None else f" of {self.total}")

    def _tell(self, note: str) -> None:
        seconds = self._seconds()
        if self.done != self.total and self._is_time(seconds):
            self._told, self._told_done = seconds, self.done
            self._print(", ".join(filter(None, (self.text(), self.left(seconds), note))))

    def _is_time(self, seconds: float) -> bool:
        if self._rewritten:
            # a person sees no faster change
            return seconds - self._told >= 0.1
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


class Stages(_Shown):
    """Work of several kinds, one after the other: `with Stages("verdict", 480.0): ...; stage("fits of effects")`.

    expected_s: how long all of it is expected to take [s]; None where nobody knows. at_most: it may be much less, as some of
    it may have been done before. A log has a line of that as the first stage begins, and one for each that begins after
    five seconds; a terminal has the stage that runs. Stages within stages are not shown.
    """

    def __init__(
        self,
        what: str,
        expected_s: float | None = None,
        clock: Callable[[], float] = time.monotonic,
        rewritten: bool | None = None,
        at_most: bool = False,
    ):
        super().__init__(what, clock, rewritten)
        self.expected_s, self._about, self._now = expected_s, "at most about" if at_most else "about", ""

    def __enter__(self) -> Stages:
        if os.getpid() == _shown_by and not _shown and not _stages:
            _stages.append(self)
        return self

    def __exit__(self, *error) -> None:
        if self in _stages:
            _stages.remove(self)
            self._end(self.what, bool(error[0]))

    def begin(self, stage: str) -> None:
        """Show that a stage begins, in words."""
        self._now = stage
        first = not self._lines and (self.expected_s or 0) >= FIRST_S
        if self._rewritten or first or self._seconds() >= FIRST_S:
            self.say()

    def say(self) -> None:
        """Print what runs and about how long the rest will take."""
        words = ", ".join(filter(None, (self.what, self.left())))
        self._print(words + (f": {self._now}" if self._now else ""))

    def left(self) -> str:
        """Return in words how long the rest is expected to take, "" where that is not known."""
        if self.expected_s is None:
            return ""
        if (left := self.expected_s - self._seconds()) >= 1:
            return f"{self._about} {duration(left)} left"
        return f"{duration(self._seconds())} so far, {duration(self.expected_s)} expected"


def stage(words: str) -> None:
    """Say what the running `Stages` do next; this does nothing in a worker, or where no stages run.

    Parameters
    ----------
    words : str
        Words for the line of progress.
    """
    if os.getpid() == _shown_by and not _shown:
        for stages in _stages:
            stages.begin(words)


def print_now(words: str, end: str = "\n") -> None:
    """Print to standard error at once."""
    print(words, end=end, file=sys.stderr, flush=True)


def tracked(items: Iterable[Item], what: str, total: int | None = None) -> Iterator[Item]:
    """Yield items, and show how many of them are done.

    Parameters
    ----------
    items : iterable
        Anything, a generator too.
    what : str
        Words for the line of progress, such as "sites".
    total : int, optional
        Number of items, where they do not know it.

    Yields
    ------
    object
        The items, unchanged and in their order.
    """
    if total is None and isinstance(items, Sized):
        total = len(items)
    with Progress(what, total) as progress:
        for item in items:
            yield item
            progress.advance()


def duration(seconds: float) -> str:
    """Return a time in words, to two figures or so.

    Parameters
    ----------
    seconds : float
        At least 0.

    Returns
    -------
    str
        Such as "8 s", "3 min 20 s" or "2 h 15 min".

    Examples
    --------
    >>> duration(200)
    '3 min 20 s'
    """
    rounded = round(seconds)
    if rounded < 60:
        return f"{rounded} s"
    if rounded < 600:
        minutes, rest = divmod(10 * round(rounded / 10), 60)
        return f"{minutes} min {rest} s" if rest else f"{minutes} min"
    minutes = round(seconds / 60)
    if minutes < 60:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min" if minutes % 60 else f"{minutes // 60} h"
