"""The chapter about the recordings: what the tests of each session found, and what was left out."""

from __future__ import annotations

import pandas as pd

from gelforge.report.chapters.chapter import Chapter, count
from gelforge.report.chapters.results_reader import StudyResults

KIND = ["session", "level", "test", "channel", "remedy"]  # what findings of one kind share


def recordings(results: StudyResults) -> Chapter:
    """Return what the tests of the recorded sessions found, by kind."""
    chapter = Chapter("recordings", "What was left out of the recordings")
    if not results.study.sessions:
        return chapter.say("This study has no recordings.")
    findings = results.findings
    if findings is None:
        return chapter.miss("No recordings/<session>.findings.csv: `gelforge readings` writes them.")
    excluded = findings[findings["level"] == "excluded"]
    for channel in ("force", "image"):
        presses = excluded[excluded["channel"] == channel].drop_duplicates(["session", "press"])
        names = [f"{session} {press}" for session, press in zip(presses["session"], presses["press"])]
        more = f" and {len(names) - 20} more" if len(names) > 20 else ""
        many = f"{count(len(names), 'indentation')}: {', '.join(names[:20])}{more}"
        chapter.say(f"Left out: {channel} of {many}." if names else f"No {channel} is left out.")
    if len(findings):
        chapter.tabulate(
            "What the tests of the sessions found. What is `excluded` from one channel stays out of everything that follows;"
            " a `note` is information, and its readings and images are used. `recordings/<session>.findings.csv` has all"
            " findings, indentation by indentation.",
            kinds_table(findings),
        )
    return chapter


def kinds_table(findings: pd.DataFrame) -> pd.DataFrame:
    """Return a row per session, level, test and remedy: how many indentations, and what was found in the first."""
    table = findings.fillna({"remedy": ""}).groupby(KIND, sort=False)
    presses = lambda press: press[press != ""].nunique()  # noqa: E731
    rows = table.agg(indentations=("press", presses), found=("found", "first")).reset_index()
    shown = ["session", "level", "test", "channel", "indentations", "found", "remedy"]
    return rows[shown].rename(columns={"found": "found, the first"})
