"""Frames in a thread of their own, of which only the newest waits: one that comes while another is computed replaces it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from gelforge.recording.imaging.flow import ImageError
from gelforge.recording.imaging.frames import Frame, frames


class LiveError(ValueError):
    """A live run that cannot start or go on: what, why, what to do."""


@dataclass(frozen=True)
class Shot:
    """One frame with its number, from 0, and the time at which it was there [s since 1970]."""

    number: int
    t_capture: float
    frame: Frame


def played(source: str, fps: float, loop: bool) -> Callable[[], Iterator[Frame]]:
    """Return a function that opens a source: a camera at its own pace, a folder or a video at a given one.

    Parameters
    ----------
    source : str
        Number of a camera, or path of a folder or a video.
    fps : float
        Images per second, above 0 and at most 1000; unused for a camera.
    loop : bool
        Begin again at the end.

    Returns
    -------
    callable
        Takes nothing and returns an iterator of Frame.

    Raises
    ------
    LiveError
        For another fps.
    ImageError
        For a source that is missing or cannot be opened.
    """
    if not 0 < fps <= 1000:
        raise LiveError(f"--fps {fps:g}: give a number above 0 and at most 1000")
    first = [frames(source)]
    if source.isdecimal():
        return first.pop

    def play() -> Iterator[Frame]:
        due = time.monotonic()
        while True:
            for frame in first.pop() if first else frames(source):
                due = max(due + 1 / fps, time.monotonic() - 1 / fps)  # a slow disk is not made up for
                time.sleep(max(0.0, due - time.monotonic()))
                yield frame
            if not loop:
                return

    return play


class Capture:
    """The thread that reads frames; a context manager.

    newest() gives the newest frame that was not given before. Frames that were replaced before anybody asked for them are
    counted as dropped.
    """

    def __init__(self, open_source: Callable[[], Iterable[Frame]]):
        self._open = open_source
        self._there = threading.Condition()
        self._waiting: Shot | None = None
        self._stop = threading.Event()
        self.captured = self.dropped = 0
        self.ended = False
        self.error: Exception | None = None
        self._thread = threading.Thread(target=self._read, name="capture", daemon=True)

    def __enter__(self) -> Capture:
        self._thread.start()
        return self

    def __exit__(self, *_) -> None:
        self._stop.set()
        self._thread.join(timeout=2)  # a camera that hangs is left to the end of the process

    def newest(self, timeout: float) -> Shot | None:
        """Return the newest frame, waiting for one; None after timeout [s], or at the end of the source (see ended)."""
        with self._there:
            self._there.wait_for(lambda: self._waiting or self.ended, timeout)
            shot, self._waiting = self._waiting, None
            return shot

    def _read(self) -> None:
        try:
            for frame in self._open():
                if self._stop.is_set():
                    return
                with self._there:
                    self.dropped += self._waiting is not None
                    self._waiting = Shot(self.captured, time.time(), frame)
                    self.captured += 1
                    self._there.notify()
        except ImageError as error:
            self.error = error
        except Exception as error:  # of a driver: the run must learn of it, whatever it is
            self.error = LiveError(f"the source failed: {type(error).__name__} {str(error).splitlines()[:1]}")
        finally:
            with self._there:
                self.ended = True
                self._there.notify()
