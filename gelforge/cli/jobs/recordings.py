"""Jobs of a recorded session: its readings, and the features of its images."""

from __future__ import annotations

from pathlib import Path

from gelforge.cli.products import print_findings, recording_of
from gelforge.config import load_study


def readings(study: Path, session: str, out: Path) -> None:
    """Write a session's readings: force on the sensor in the sensor's frame, zero subtracted; and what its tests found."""
    from gelforge.recording.plausibility.findings import write_findings
    from gelforge.recording.readings import write_readings

    described = load_study(study)
    recording = recording_of(described, session)
    write_readings(out, recording)
    write_findings(out.with_suffix(".findings.csv"), recording.findings)
    print_findings(recording)


def features(study: Path, session: str, out: Path, workers: int) -> None:
    """Write the optical-flow features of a session's images."""
    from gelforge.recording.features import found_in, session_features

    described = load_study(study)
    recording = recording_of(described, session)
    count = session_features(recording, described.features, out, workers)
    print_findings(recording)
    for line in found_in(out):
        print(f"{'of all':<10} {session}: {line}")
    print(f"{session}: {count} images")
