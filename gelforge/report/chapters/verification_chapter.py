"""The checks of the finite elements: their outcome in the report, the table on a page of its own."""

from __future__ import annotations

from gelforge.report.chapters.chapter import Chapter, Link, count
from gelforge.report.chapters.results_reader import StudyResults

TITLE = "Verification of the finite elements"
PAGE = "verification.html"  # in the folder of the report


def verification(results: StudyResults) -> Chapter:
    """Return the outcome of `gelforge verify`, and the way to its table."""
    chapter = Chapter("verification", TITLE)
    table = results.table("verification")
    path = results.folder / "tables" / "verification.csv"
    if table is None and not results.study.verifies:
        chapter.say(
            "Not run: a study of labels only leaves it out. The checks depend on the code and not on the study; the key"
            f" verification asks for some of them, gelforge verify --out {path.parent} runs all in a minute."
        )
    elif table is None:
        chapter.miss(f"No {path}; gelforge verify writes it.")
    else:
        chapter.say(
            f"Compared with independent reference solutions, on this machine and with this version:"
            f" {_outcome(results, table)}."
        )
        chapter.add(Link("All checks, number by number", PAGE))
    return chapter


def verification_table(results: StudyResults, report: str) -> Chapter | None:
    """Return the chapter of the page of its own: the table of `gelforge verify`; None where it is not there.

    report: file name of the study's report in the same folder.
    """
    table = results.table("verification")
    if table is None:
        return None
    chapter = Chapter("verification", TITLE)
    chapter.tabulate(
        "Each number was computed on this machine with this version and is compared with an independent reference; errors"
        f" are relative where the reference is a size, else differences: {_outcome(results, table)}.",
        table,
    )
    return chapter.add(Link("Back to the report of the study", f"{report}#verification"))


def _outcome(results: StudyResults, table) -> str:
    failed = int((~table["passed"]).sum())
    outcome = (
        f"{count(failed, 'check')} of {len(table)} FAILED" if failed else f"all {len(table)} checks passed"
    )
    if results.study.verification:
        outcome += (
            f"; of those of gelforge verify the study asks for {', '.join(results.study.verification)} only"
        )
    return outcome
