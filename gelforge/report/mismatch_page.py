"""The verdict's page: one offline HTML file with one plain sentence first."""

from __future__ import annotations

from pathlib import Path

from gelforge.mismatch.result.verdict import PAGE
from gelforge.report.page import write_page
from gelforge.report.verdict.mismatch_chapters import CHAPTERS
from gelforge.report.verdict.mismatch_reader import MismatchResults
from gelforge.report.verdict.mismatch_words import STATES


def write_mismatch_page(folder: str | Path) -> Path:
    """Write the page of a verdict.

    Parameters
    ----------
    folder : str or Path
        Holds verdict.json, readings.csv and, if made, body_map.csv.

    Returns
    -------
    Path
        report.html in the folder.
    """
    results = MismatchResults(Path(folder))
    chapters = [make(results) for make in CHAPTERS]
    verdict = results.verdict
    state = STATES[verdict.state]
    return write_page(Path(folder) / PAGE, "mismatch.html", chapters, verdict=verdict, state=state)
