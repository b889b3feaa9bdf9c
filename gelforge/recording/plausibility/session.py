"""All tests of a session as a whole, run in one place, and what follows from what they found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import Session
from gelforge.indentation.plan import PlannedCell
from gelforge.recording.checks import RecordingError
from gelforge.recording.plausibility.findings import Finding, Findings, collect


@dataclass(frozen=True)
class SessionData:
    """What the tests see of a session: read, in the sensor's frame, force zero subtracted unless tared."""

    folder: Path
    session: Session
    readings: pd.DataFrame  # columns of readings.COLUMNS, index: line of indentations.csv
    cells: Mapping[str, PlannedCell] | None = None  # the plan, where the session was joined to one


Test = Callable[[SessionData], list[Finding]]
TESTS: dict[str, Test] = {}


def examine(data: SessionData, found: list[Finding] | None = None) -> Findings:
    """Return what all tests find in a session; found: what its reading found already (gaps of ft.csv).

    Raises RecordingError in one line where a finding is an error.
    """
    every = list(found or [])
    for test in TESTS.values():
        every += test(data)
    findings = collect(data.session.session, every, data.session.confirmed)
    if errors := findings.lines("error"):
        more = f" ({len(errors) - 1} more finding(s) of this kind)" if len(errors) > 1 else ""
        tests = ", ".join(dict.fromkeys(f.test for f in findings.of("error")))
        raise RecordingError(
            f"{data.folder}: {errors[0]}; if it is right, confirm it: `confirmed: [{tests}]` in session.yaml{more}"
        )
    return findings


def apply_findings(readings: pd.DataFrame, findings: Findings, force: list[str]) -> pd.DataFrame:
    """Return readings without the channels that were excluded; the column `excluded` names the tests, "" elsewhere."""
    out = readings.assign(excluded="")
    out.loc[findings.excluded_rows("force"), force] = np.nan
    out.loc[findings.excluded_rows("image"), "image"] = ""
    for finding in findings.of("excluded"):
        rows = list(finding.rows)
        out.loc[rows, "excluded"] = (out.loc[rows, "excluded"] + " " + finding.test).str.strip()
    return out
