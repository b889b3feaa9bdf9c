"""What goes over the WebSocket, as JSON in which every number is finite (docs/live.md); docs/columns.md has the table below.

## Messages of gelforge live

| key | meaning |
|:--|:--|
| `type`, `n` | `"force"`, number of the frame |
| `t_capture`, `t_sent`, `latency_ms` | when the frame was there and the message sent [s since 1970], the difference [ms] |
| `state` | `touched`, `untouched` (forces are exactly zero), `no force` (see `problem`) |
| `force_N`, `half_N` | total force on the sensor, x, y, z; half widths of the 90 % interval of the true force |
| `cop_mm` | centre of pressure |
| `contacts` | `force_N` and `cop_mm` of each contact, the strongest first |
| `field_N`, `field_half_N` | with `?field=1`: the same for each bin k = nx iy + ix |
| `warnings` | light, exposure, focus or the total from inverse elasticity differ: forces may be wrong |
| `problem`, `trouble` | why this frame has no force; what went wrong with the last command |
| `zero`, `recording` | how often the reference was taken anew; file |
| `latency_p50_ms`, `latency_p99_ms`, `fps`, `dropped` | over the last 500 frames; over 2 s; so far |
"""

from __future__ import annotations

import json
import time
from collections import deque

import numpy as np

from gelforge.learning.models.reliability import COVER
from gelforge.live.compute import Reading

VERSION = 1  # of the messages in docs/live.md


class Rates:
    """Latency and frames per second of the frames just passed."""

    def __init__(self) -> None:
        # latencies of which percentiles are reported: five lie above the 99th
        self.latencies: deque[float] = deque(maxlen=500)  # s from capture to force
        self.done: deque[float] = deque(maxlen=4096)  # times at which they were ready [s]
        self._told: dict = {}
        self._told_at = -np.inf

    def add(self, t_capture: float) -> None:
        now = time.time()
        self.latencies.append(max(now - t_capture, 0.0))
        self.done.append(now)

    def table(self) -> dict:
        """Return latency_p50_ms, latency_p99_ms and fps; worked out anew four times a second."""
        now = time.time()
        if now - self._told_at > 0.25 and self.latencies:
            p50, p99 = np.percentile(self.latencies, [50, 99])
            recent = [t for t in self.done if t > now - 2.0]  # of the last two seconds
            span = recent[-1] - recent[0] if recent else 0.0
            self._told = {"latency_p50_ms": round(1e3 * p50, 2), "latency_p99_ms": round(1e3 * p99, 2)}
            self._told["fps"] = round((len(recent) - 1) / span, 1) if span else 0.0
            self._told_at = now
        return self._told


def about(settings: dict, model_sha256: str, source: str) -> dict:
    """Return the first message of a connection.

    Parameters
    ----------
    settings : dict
        Of the model's file: bins, sensor_width_mm and what it was trained on.
    model_sha256 : str
        Digest of the model's file.
    source : str
        As of `played`.

    Returns
    -------
    dict
        Type "about", ready for JSON.
    """
    bins = settings["bins"]
    return {
        "type": "about",
        "version": VERSION,
        "source": source,
        "study": settings.get("study", ""),
        "synthetic": bool(settings.get("synthetic")),
        "trained_on": settings.get("trained_on", ""),
        "model_sha256": model_sha256,
        "bins": [bins["nx"], bins["ny"]],
        "sensor_width_mm": settings["sensor_width_mm"],
        "interval": COVER,
        "units": {
            "force": "N, on the sensor, z up: an indentation is negative",
            "cop": "mm",
            "time": "s since 1970",
        },
    }


def of_reading(reading: Reading, state: dict, field: bool) -> dict:
    """Return the message of a reading, but for t_sent and latency_ms; state: rates, dropped frames, recording."""
    fields = {
        "type": "force",
        "n": reading.number,
        "t_capture": round(reading.t_capture, 6),
        "state": "no force" if reading.force_N is None else "touched" if reading.touched else "untouched",
        "force_N": _numbers(reading.total_N),
        "half_N": _numbers(reading.total_half_N),
        "cop_mm": _numbers(reading.cop_mm, 3),
        "contacts": [
            {"force_N": _numbers(one.force_N), "cop_mm": _numbers(one.centre_mm, 3)}
            for one in reading.contacts
        ],
        "zero": reading.zero,
        "warnings": list(reading.warnings),
        "problem": reading.problem,
        **state,
    }
    if field:
        fields["field_N"] = _numbers(reading.force_N)
        fields["field_half_N"] = _numbers(reading.half_N)
    return fields


def text_of(message: dict) -> str:
    """Return a message as JSON, sent now. Raises ValueError for a number that is not finite."""
    if "t_capture" in message:
        now = time.time()
        latency = round(1e3 * max(now - message["t_capture"], 0.0), 3)
        message = {**message, "t_sent": round(now, 6), "latency_ms": latency}
    return json.dumps(message, allow_nan=False, separators=(",", ":"))


def _numbers(values: np.ndarray | None, decimals: int = 6) -> list | None:
    """Return numbers rounded to micronewtons (or micrometres), which no network distinguishes."""
    return None if values is None else np.round(np.asarray(values, float), decimals).tolist()
