"""The chapter about the finite elements themselves: what was found beside what should be found."""

from __future__ import annotations

from gelforge.report.chapters import Chapter, count
from gelforge.report.results_reader import StudyResults


def verification(results: StudyResults) -> Chapter:
    """Return the verification table as `gelforge verify` wrote it."""
    chapter = Chapter("verification", "Verification of the finite elements")
    table = results.table("verification")
    if table is None:
        chapter.miss(f"No {results.folder / 'tables' / 'verification.csv'}; `gelforge verify` writes it.")
        return chapter
    failed = int((~table["passed"]).sum())
    verdict = f"{count(failed, 'check')} FAILED" if failed else f"all {len(table)} checks passed"
    if results.study.verification:
        verdict += (
            f"; of those of `gelforge verify` the study asks for {', '.join(results.study.verification)} only"
        )
    chapter.tabulate(
        "Each number was computed on this machine by this version and stands beside a solution from outside; errors are"
        f" relative where the reference is a size, else differences: {verdict}.",
        table,
    )
    return chapter
