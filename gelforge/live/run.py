"""One live run: the newest frame, its forces, to everybody who listens; until the source ends or somebody stops it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from gelforge.live.capture import Capture, Shot
from gelforge.live.compute import LiveForce, Reading
from gelforge.live.messages import Rates, of_reading
from gelforge.live.notices import Notices
from gelforge.live.record import LIMITS, Limits, Recorder, RecordingLimit
from gelforge.live.server import Server
from gelforge.recording.imaging.frames import Frame

RECORDINGS = "live-recordings"  # folder for the page's record button, where --record names none


@dataclass
class Run:
    """What a run does in addition to computing: commands of clients, recording, and what is reported of both."""

    server: Server
    force: LiveForce
    folder: Path
    say: Callable[[str], None]
    limits: Limits = LIMITS
    recorder: Recorder | None = None
    take_zero: bool = False
    trouble: str = ""  # of the last command, until the next one

    def obey(self) -> None:
        """Carry out what clients have asked for."""
        while not self.server.commands.empty():
            command = self.server.commands.get()
            self.trouble = ""
            if command == "zero":
                self.take_zero = True
            elif command == "record" and self.recorder is None:
                self.start_recording()
            elif command == "stop":
                self.stop_recording()

    def start_recording(self) -> None:
        try:
            self.recorder = Recorder(self.folder, self.server.about, self.limits)
            self.say(f"recording to {self.recorder.path}")
        except (OSError, RuntimeError, RecordingLimit) as error:  # the forces go on
            self.trouble = f"cannot record to {self.folder}: {error}"

    def stop_recording(self) -> None:
        if self.recorder is None:
            return
        self.recorder.close()
        if not self.recorder.problem:
            self.say(f"recorded {self.recorder.path}")
        self.trouble, self.recorder = self.recorder.problem, None

    def reading(self, shot: Shot) -> Reading:
        """Return the reading of a frame, which first becomes the reference where that was asked for."""
        if self.take_zero:
            self.take_zero = False
            try:
                self.force.take_reference(shot.frame)
            except ValueError as error:
                if not type(error).__module__.startswith("gelforge."):
                    raise
                self.trouble = f"not taken as reference: {error}"
        return self.force(shot)

    def state(self, capture: Capture, rates: Rates) -> dict:
        """Return what every message holds in addition to the forces."""
        if self.recorder and self.recorder.problem:
            self.stop_recording()
        return {
            **rates.table(),
            "dropped": capture.dropped,
            "recording": str(self.recorder.path) if self.recorder else None,
            "trouble": self.trouble,
        }


def run_live(
    open_source: Callable[[], Iterable[Frame]],
    force: LiveForce,
    server: Server,
    folder: Path | None,
    say: Callable[[str], None] = print,
    limits: Limits = LIMITS,
) -> None:
    """Compute and publish until the source ends.

    Unusable frames are reported and passed over.

    Parameters
    ----------
    open_source : callable
        As `played` returns it.
    force : LiveForce
        Computes the forces [N] of a frame.
    server : Server
        Publishes readings, and receives commands.
    folder : Path or None
        Of recordings, which then begin at once; None: only clients start one, in RECORDINGS.
    say : callable
        Takes each line that is reported.
    limits : Limits
        Of recordings.

    Raises
    ------
    ImageError
        Where the camera stops, after clients were warned.
    """
    run, rates = Run(server, force, folder or Path(RECORDINGS), say, limits), Rates()
    notices = Notices(say)
    with Capture(open_source) as capture:
        if folder:
            run.start_recording()
        silent_s = 2.0  # without a frame, after which clients are warned
        try:
            while True:
                shot = capture.newest(silent_s)
                run.obey()
                if shot is None and capture.ended:
                    break
                if shot is None:
                    text = f"no frame for {silent_s:g} s; is the camera still connected?"
                    reading = Reading(capture.captured, time.time(), problem=text)
                else:
                    reading = run.reading(shot)
                    rates.add(shot.t_capture)
                server.publish(of_reading(reading, run.state(capture, rates), server.wants_field))
                if run.recorder:
                    run.recorder.add(reading)
                name = shot.frame.name if shot else ""
                notices.tell((reading.problem, run.trouble), reading.warnings, name)
        finally:
            run.stop_recording()
            notices.tell((run.trouble,), ())
            notices.close()
            server.end(str(capture.error or "the source has ended"))
    if capture.error:
        raise capture.error
