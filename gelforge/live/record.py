"""Readings in an HDF5 file, written by a thread of its own so that a slow disk does not slow the forces."""

from __future__ import annotations

import json
import math
import queue
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from gelforge.files import no_room
from gelforge.live.compute import Reading

FORMAT = "gelforge-live-1"
# name: (shape of a row, type, description)
COLUMNS = {
    "number": ((), "i8", "number of the frame, from 0 [1]"),
    "t_capture": ((), "f8", "when the frame was there [s since 1970]"),
    "zero": ((), "i4", "how often the reference was taken anew before [1]"),
    "warned": ((), "?", "light or focus differed from the reference's [1]"),
    "total_force_N": ((3,), "f8", "force on the sensor [N]"),
    "total_half_N": ((3,), "f8", "half width of its 90 % interval [N]; NaN: the model has none"),
    "cop_mm": ((2,), "f8", "centre of pressure [mm]; NaN: untouched"),
    "force_distribution_N": (("bins", 3), "f4", "force of each bin [N], k = nx iy + ix"),
}


class RecordingLimit(ValueError):
    """A recording that is not begun: what was found, the limit, what to do."""


@dataclass(frozen=True)
class Limits:
    """How much is recorded: whoever reaches the page can start recordings."""

    recordings: int = 100  # files in a folder
    largest_mb: float = 1000.0  # of a file: two hours of 400 bins at 30 frames per second


LIMITS = Limits()


class Recorder:
    """Writes readings into <folder>/live-<time>.h5 until it is closed; what is there stays if the process ends.

    Raises RecordingLimit where the folder holds as many recordings as the limits allow. A recording that is as large as they
    allow ends, and `problem` says so.
    """

    def __init__(self, folder: str | Path, about: dict, limits: Limits = LIMITS):
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        if (there := sum(1 for _ in folder.glob("live-*.h5"))) >= limits.recordings:
            raise RecordingLimit(
                f"it holds {there} recordings, limit {limits.recordings}; move some away, or raise --max-recordings"
            )
        stamp = time.strftime("%Y%m%d-%H%M%S")
        self.path = next(
            path
            for number in range(10_000)
            if not (path := folder / f"live-{stamp}{f'-{number}' if number else ''}.h5").exists()
        )
        self.problem, self.left_out = "", 0
        self._limits, self._bytes, self._row_bytes = limits, 0, 0
        # a minute at 30 frames per second; what a slower disk still misses is counted
        self._queue: queue.Queue[Reading | None] = queue.Queue(2000)
        bins = about["bins"][0] * about["bins"][1]
        self._file = h5py.File(self.path, "x")
        self._file.attrs.update(
            {"format": FORMAT, "about": json.dumps(about), "synthetic": about["synthetic"]}
        )
        for name, (shape, kind, text) in COLUMNS.items():
            shape = tuple(bins if part == "bins" else part for part in shape)
            data = self._file.create_dataset(
                name, (0, *shape), kind, maxshape=(None, *shape), chunks=(64, *shape)
            )
            data.attrs["description"] = text
            self._row_bytes += data.dtype.itemsize * math.prod(data.shape[1:])
        self._thread = threading.Thread(target=self._write, name="record", daemon=True)
        self._thread.start()

    def add(self, reading: Reading) -> None:
        """Queue a reading; one without a force is not recorded."""
        if reading.force_N is None or self.problem:
            return
        try:
            self._queue.put_nowait(reading)
        except queue.Full:
            self.left_out += 1

    def close(self) -> None:
        """Write what waits, and close the file."""
        if self._thread.is_alive():
            self._queue.put(None)
        self._thread.join()

    def _write(self) -> None:
        flushed, going = time.monotonic(), True
        try:
            while going:
                batch = [self._queue.get()]
                while not self._queue.empty() and len(batch) < 64:
                    batch.append(self._queue.get())
                going = None not in batch
                self._append([reading for reading in batch if reading is not None])
                # s of readings are lost at most where the process is killed
                if time.monotonic() - flushed > 1.0:
                    self._file.flush()
                    flushed = time.monotonic()
                full = self._bytes >= 1e6 * self._limits.largest_mb
                going = going and not full
            self._file.attrs["left_out"] = self.left_out
            self._file.close()
            if full:
                self.problem = (
                    f"{self.path}: recording ended at {self._bytes / 1e6:.3g} MB, limit {self._limits.largest_mb:g} MB; "
                    "record anew, or raise --max-recording-mb"
                )
        except (OSError, RuntimeError) as error:  # HDF5 raises both
            self.problem = f"{self.path}: recording stopped, {no_room(error) or error}"

    def _append(self, readings: list[Reading]) -> None:
        if not readings:
            return
        missing = np.full(3, np.nan)
        rows: dict[str, list] = {
            "number": [r.number for r in readings],
            "t_capture": [r.t_capture for r in readings],
            "zero": [r.zero for r in readings],
            "warned": [bool(r.warnings) for r in readings],
            "total_force_N": [r.total_N for r in readings],
            "total_half_N": [missing if r.total_half_N is None else r.total_half_N for r in readings],
            "cop_mm": [missing[:2] if r.cop_mm is None else r.cop_mm for r in readings],
            "force_distribution_N": [r.force_N for r in readings],
        }
        self._bytes += len(readings) * self._row_bytes
        for name, values in rows.items():
            data = self._file[name]
            data.resize(len(data) + len(values), axis=0)
            data[-len(values) :] = np.array(values)
