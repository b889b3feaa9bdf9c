"""The chapter about the recordings: what the tests of each session found, and what was left out."""

from __future__ import annotations

from gelforge.report.chapters.chapter import Chapter, count
from gelforge.report.chapters.results_reader import StudyResults

ROWS = 200  # of the table; recordings/<session>.findings.csv has all
COLUMNS = {
    "session": "session",
    "level": "level",
    "press": "indentation",
    "time_s": "time [s]",
    "channel": "channel",
    "found": "found",
    "value": "value",
    "limit": "limit",
    "unit": "unit",
    "remedy": "remedy",
}


def recordings(results: StudyResults) -> Chapter:
    """Return what the tests of the recorded sessions found, by indentation."""
    chapter = Chapter("recordings", "What was left out of the recordings")
    if not results.study.sessions:
        chapter.say("This study has no recordings.")
        return chapter
    found = results.findings
    if found is None:
        chapter.miss("No recordings/<session>.findings.csv: `gelforge readings` writes them.")
        return chapter
    excluded = found[found["level"] == "excluded"]
    for channel in ("force", "image"):
        presses = excluded[excluded["channel"] == channel].drop_duplicates(["session", "press"])
        many = count(len(presses), "indentation")
        chapter.say(f"Left out: {channel} of {many}." if len(presses) else f"No {channel} is left out.")
    if len(found):
        table = found[list(COLUMNS)].rename(columns=COLUMNS)
        chapter.tabulate(
            "What is left out of one channel stays out of everything that follows; notes are information."
            + (f" The first {ROWS} of {len(table)} findings." if len(table) > ROWS else ""),
            table.head(ROWS),
        )
    return chapter
