"""What a test of a recorded session found: values for a table, one line for people, and what is left out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from gelforge.files import read_product_table, write_product_table

Level = Literal["error", "excluded", "note"]
COLUMNS = [
    "session",
    "level",
    "test",
    "press",
    "time_s",
    "channel",
    "value",
    "limit",
    "unit",
    "found",
    "remedy",
]
# Of a finding by chance alone in an honest channel: none of 37 kinds of honest sessions, three channels each, has one
# (tests/recording/test_plausibility.py).
CHANCE = 1e-6
# Of neighbouring readings, to know how often two are equal: where none of 10 pairs is, fewer than 31 % are (95 % interval
# of Clopper and Pearson 1934).
LEAST_PAIRS = 10
# Of a session's indentations without one channel: what is left says little about the session. 12 dead ones of 15 are an
# error, 5 are left out (tests/recording/test_plausibility.py).
MOST = 0.5


@dataclass(frozen=True)
class Finding:
    """One thing that a test found in a session.

    found: what is wrong, as the predicate of a sentence whose subject is the channel ("read 0.24 N before contact"). value
    and limit are what was compared, in `unit` (NaN where a test compares no numbers). remedy: what mends it.
    """

    test: str  # name in `session.TESTS`; what `confirmed` of session.yaml names
    level: Level
    channel: str  # force, image, ft.csv, axes, plan; of an exclusion `force` or `image`
    found: str
    remedy: str
    press: str = ""  # "": the session as a whole
    time_s: float = float("nan")
    value: float = float("nan")
    limit: float = float("nan")
    unit: str = ""
    rows: tuple[int, ...] = ()  # of an exclusion: the labels of the readings that lose the channel

    def __post_init__(self):
        if self.level == "excluded" and (self.channel not in ("force", "image") or not self.rows):
            raise ValueError(f"{self.test}: an exclusion takes rows out of the channel `force` or `image`")


# rows of an indentation lose their force
force_left_out = partial(Finding, level="excluded", channel="force", unit="N")


@dataclass(frozen=True)
class Findings:
    """All findings of a session."""

    session: str = ""
    all: tuple[Finding, ...] = ()

    def __iter__(self) -> Iterator[Finding]:
        return iter(self.all)

    def of(self, level: Level) -> list[Finding]:
        """Return the findings of a level."""
        return [finding for finding in self.all if finding.level == level]

    def excluded_rows(self, channel: str) -> list[int]:
        """Return the labels of the readings without this channel, each once, in order."""
        return sorted({row for f in self.of("excluded") if f.channel == channel for row in f.rows})

    def lines(self, *levels: Level) -> list[str]:
        """Return one line per level, test and remedy, with the count of indentations and the largest value."""
        groups: dict[tuple, list[Finding]] = {}
        for finding in self.all:
            if not levels or finding.level in levels:
                groups.setdefault((finding.level, finding.test, finding.channel, finding.remedy), []).append(
                    finding
                )
        return [_line(group) for group in groups.values()]

    def table(self) -> pd.DataFrame:
        """Return one row per finding, columns as in COLUMNS."""
        rows = [{"session": self.session, **asdict(finding)} for finding in self.all]
        return pd.DataFrame(rows, columns=COLUMNS)


def collect(session: str, findings: Iterable[Finding], confirmed: Sequence[str] = ()) -> Findings:
    """Return findings with those of confirmed tests as notes."""
    return Findings(
        session,
        tuple(
            replace(f, level="note", found=f"{f.found} (confirmed in session.yaml)", rows=())
            if f.test in confirmed and f.level != "note"
            else f
            for f in findings
        ),
    )


def mostly(findings: list[Finding], indentations: int) -> list[Finding]:
    """Return exclusions as they are, or as errors where they are more than MOST of a session's indentations."""
    if len(findings) <= MOST * indentations:
        return findings
    return [replace(finding, level="error", rows=()) for finding in findings]


def write_findings(path: str | Path, findings: Findings) -> None:
    """Write the findings as CSV; a session without any has the header alone.

    Parameters
    ----------
    path : str or Path
        The file.
    findings : Findings
        Of one session.
    """
    write_product_table(path, findings.table(), "%.6g")


def read_findings(path: str | Path) -> pd.DataFrame:
    """Return the table that `write_findings` wrote, columns as in COLUMNS.

    Parameters
    ----------
    path : str or Path
        The CSV file.

    Returns
    -------
    pandas.DataFrame
        A row for each finding.

    Raises
    ------
    FileError
        For a file that is missing, damaged or edited.
    """
    remedy = f"make the readings again (snakemake -R {path})"
    return read_product_table(path, remedy, dtype={"press": str, "session": str}).fillna(
        {"press": "", "unit": ""}
    )


def _line(group: list[Finding]) -> str:
    """Return findings of one test and level as one line; the finding farthest beyond its limit speaks for all."""
    worst = max(group, key=_excess)
    where = "" if not worst.press else f"indentation {worst.press}"
    if where and np.isfinite(worst.time_s):
        where += f" at {worst.time_s:.6g} s"
    limit = f" (limit {worst.limit:.3g} {worst.unit})".replace(" )", ")") if np.isfinite(worst.limit) else ""
    count = ""
    # of an indentation several images may be found
    names = list(dict.fromkeys(finding.press for finding in group))
    if len(names) > 1:
        more = ", ..." if len(names) > 3 else ""
        count = f"; {len(names)} indentations in all: {', '.join(names[:3])}{more}"
    left_out = f"; {worst.channel} left out there" if worst.level == "excluded" else ""
    return f"{where + ': ' if where else ''}{worst.channel} {worst.found}{limit}{count}{left_out}; {worst.remedy}"


def _excess(finding: Finding) -> float:
    """Return by what factor a finding lies beyond its limit, 0 where it compares no numbers."""
    ratio = abs(finding.value) / finding.limit if finding.limit else 0.0
    return ratio if np.isfinite(ratio) else 0.0
