"""Which of the problems and warnings of frames are printed: what lasts, and not every flicker."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

# A warning is printed once it has lasted so long: half a second of flicker is not (tests/learning/test_notices.py).
LASTS_S = 1.0
# At most one line of a kind: three minutes of flicker are seven lines (tests/learning/test_notices.py).
EVERY_S = 30.0


@dataclass
class _Kind:
    """What is known of texts that differ in numbers only."""

    text: str
    since: float | None = None  # when it came, None: it is gone
    printed: bool = False  # since it came
    last: float = float("-inf")  # when a line was printed
    missed: int = 0  # times it came and went without a line
    missed_since: float = 0.0

    def line(self, now: float) -> str:
        """Return the text with how often it was left out since the last line."""
        times = "once" if self.missed == 1 else f"{self.missed} times"
        more = f" ({times} more in the last {now - self.missed_since:.0f} s)" if self.missed else ""
        self.last, self.missed = now, 0
        return self.text + more


class Notices:
    """Prints a text when it comes, a warning when it has lasted LASTS_S; a kind of text at most every EVERY_S.

    What was left out is counted, and stated with the next line of its kind or after EVERY_S.
    """

    def __init__(self, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic):
        self._say, self._clock = say, clock
        self._kinds: dict[str, _Kind] = {}

    def tell(self, problems: Iterable[str], warnings: Iterable[str], frame: str = "") -> None:
        """Take note of what a frame of this name gives; empty texts are none."""
        now, present = self._clock(), set()
        for texts, lasts in ((problems, 0.0), (warnings, LASTS_S)):
            for text in filter(None, texts):
                name = re.sub(r"[0-9.]+", "", text.removeprefix(f"{frame}: "))
                present.add(name)
                self._came(self._kinds.setdefault(name, _Kind(text)), text, lasts, now)
        for name in self._kinds.keys() - present:
            self._gone(name, now)

    def close(self) -> None:
        """State what was left out and not yet stated."""
        now = self._clock()
        for name in list(self._kinds):
            self._gone(name, now, at_once=True)

    def _came(self, kind: _Kind, text: str, lasts: float, now: float) -> None:
        kind.text = text
        if kind.since is None:
            kind.since, kind.printed = now, False
        if not kind.printed and now - kind.since >= lasts and now - kind.last >= EVERY_S:
            kind.printed = True
            self._say(kind.line(now))

    def _gone(self, name: str, now: float, at_once: bool = False) -> None:
        kind = self._kinds[name]
        if kind.since is not None and not kind.printed:
            kind.missed_since = kind.missed_since if kind.missed else kind.since
            kind.missed += 1
        kind.since = None
        waited = now - max(kind.last, kind.missed_since) >= EVERY_S
        if kind.missed and (waited or at_once):
            times, kind.missed = kind.missed, 0
            kind.last = now
            often = "once" if times == 1 else f"{times} times"
            self._say(f"{often} in the last {now - kind.missed_since:.0f} s, for a moment: {kind.text}")
        elif not kind.missed and now - kind.last >= EVERY_S:
            del self._kinds[name]
