"""The verdict's page: one offline HTML file with one plain sentence first."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from markupsafe import Markup

import gelforge
from gelforge.files import write_text
from gelforge.mismatch.result.verdict import PAGE
from gelforge.report.page import environment
from gelforge.report.verdict.mismatch_chapters import CHAPTERS
from gelforge.report.verdict.mismatch_reader import MismatchResults
from gelforge.report.verdict.mismatch_words import STATES


def write_mismatch_page(folder: str | Path, written: datetime | None = None) -> Path:
    """Write report.html beside verdict.json, readings.csv and body_map.csv (if made) in a folder; return its path."""
    results = MismatchResults(Path(folder))
    chapters = [make(results) for make in CHAPTERS]
    templates = environment()
    html = templates.get_template("mismatch.html").render(
        verdict=results.verdict,
        state=STATES[results.verdict.state],
        chapters=chapters,
        style=Markup(templates.get_template("report.css").render()),
        version=gelforge.__version__,
        written=(written or datetime.now(UTC)).strftime("%Y-%m-%d %H:%M UTC"),
    )
    out = Path(folder) / PAGE
    write_text(out, html)
    return out
