"""All tests of a session as a whole, run in one place, and what follows from what they found."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import Session
from gelforge.indentation.paths.places import POSITION_MATCH_MM
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.recording.plausibility import forces, positions, saturation, spikes, timing
from gelforge.recording.plausibility.findings import Finding, Findings, collect
from gelforge.recording.plausibility.image_series import ImageSeries, image_series
from gelforge.recording.plausibility.images import IMAGE_TESTS
from gelforge.recording.plausibility.indentations import floor_N, indentation_table
from gelforge.recording.plausibility.repeats import Run, repeats
from gelforge.recording.plausibility.streams import ForceLog
from gelforge.recording.tables.checks import RecordingError


@dataclass(frozen=True)
class SessionData:
    """What the tests see of a session: read, in the sensor's frame, force zero subtracted unless tared."""

    folder: Path
    session: Session
    readings: pd.DataFrame  # columns of readings.COLUMNS, index: line of indentations.csv
    cells: Mapping[str, PlannedCell] | None = None  # the plan, where the session was joined to one
    log: ForceLog | None = None  # ft.csv, where there is one
    tolerance_mm: float = POSITION_MATCH_MM  # within which positions are of one site

    @cached_property
    def indentations(self) -> pd.DataFrame:
        """Return one row per indentation, see `indentation_table`."""
        return indentation_table(self.readings, self.tolerance_mm)

    @cached_property
    def repeats(self) -> list[Run]:
        """Return the runs of readings that cannot repeat one value, see `repeats`."""
        return repeats(self.readings, self.indentations, self.session.force)

    @property
    def repeated_rows(self) -> set[int]:
        """Return the labels of the readings in such runs."""
        return {row for run in self.repeats for row in run.rows}

    @cached_property
    def floor_N(self) -> np.ndarray:
        """Return (3,) [N], the force that is not distinguished from none on each axis."""
        force = self.session.force
        return floor_N(self.readings, force.resolution_N, force.repeatability_N)

    @cached_property
    def images(self) -> ImageSeries:
        """Return a sample of the images with what is measured of them."""
        return image_series(self.folder, self.readings, self.session.camera, self.session.crop_px)


Test = Callable[[SessionData], list[Finding]]


def _of_images(test: Callable[[ImageSeries], list[Finding]]) -> Test:
    """Return a test of a series of images as one of a session's data."""
    return lambda data: test(data.images)


TESTS: dict[str, Test] = {
    "mirrored_axes": positions.mirrored_axes,
    "force_saturates": saturation.force_saturates,  # first: what is cut off seems to lead, and not to grow
    "force_in_step": timing.force_in_step,
    "force_before_touch": forces.force_before_touch,
    "force_repeats": forces.force_repeats,
    "force_answers": forces.force_answers,
    "force_grows": forces.force_grows,
    "force_spikes": spikes.force_spikes,
    **{name: _of_images(test) for name, test in IMAGE_TESTS.items()},
    "planned_count": positions.planned_count,
}


def examine(data: SessionData, lost: Sequence[Finding] = ()) -> Findings:
    """Return what all tests find in a session; lost: what is not there to be confirmed (gaps of ft.csv).

    Raises RecordingError in one line where a finding is an error.
    """
    name, confirmed = data.session.session, data.session.confirmed
    tested = collect(name, (finding for test in TESTS.values() for finding in test(data)), confirmed)
    refuse(data.folder, tested)
    return Findings(name, (*lost, *tested))


def refuse(folder: Path, findings: Findings) -> None:
    """Raise RecordingError in one line where a finding is an error."""
    errors = findings.of("error")
    if not errors:
        return
    lines = findings.lines("error")
    tests = ", ".join(dict.fromkeys(finding.test for finding in errors))
    more = f"; {len(lines) - 1} further error(s) after this one" if len(lines) > 1 else ""
    raise RecordingError(
        f"{folder}: {lines[0]}; if the readings are right, add `confirmed: [{tests}]` to session.yaml{more}"
    )


def apply_findings(readings: pd.DataFrame, findings: Findings, force: list[str]) -> pd.DataFrame:
    """Return readings without the channels that were excluded; the column `excluded` names the tests, "" elsewhere."""
    out = readings.assign(excluded="")
    out.loc[findings.excluded_rows("force"), force] = np.nan
    out.loc[findings.excluded_rows("image"), "image"] = ""
    for finding in findings.of("excluded"):
        rows = list(finding.rows)
        out.loc[rows, "excluded"] = (out.loc[rows, "excluded"] + " " + finding.test).str.strip()
    return out
