"""The offline report: one HTML page that holds its figures and fetches nothing."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

import gelforge
from gelforge.config import Study
from gelforge.files import write_text
from gelforge.progress import tracked
from gelforge.report.chapters import (
    error_bar_chapter,
    learning_chapters,
    material_chapter,
    recording_chapter,
    study_chapters,
    verification_chapter,
)
from gelforge.report.chapters.chapter import Chapter
from gelforge.report.chapters.results_reader import StudyResults
from gelforge.report.result import result
from gelforge.report.verdict import mismatch_chapters

BACKTICKS = re.compile(r"`([^`]+)`")
CHAPTERS = (
    result,
    study_chapters.glance,
    material_chapter.materials,
    study_chapters.force_depth,
    error_bar_chapter.error_bars,
    study_chapters.inside,
    study_chapters.images,
    recording_chapter.recordings,
    learning_chapters.agreement,
    learning_chapters.predictions,
    learning_chapters.error_tables,
    study_chapters.failed_cells,
    verification_chapter.verification,
    study_chapters.time_per_stage,
    study_chapters.origin,
    mismatch_chapters.mismatch,
)


def write_report(
    study: Study,
    results_folder: str | Path,
    out_html: str | Path,
    paper_folder: str | Path | None = None,
    written: datetime | None = None,
) -> list[str]:
    """Write the report of a study from what its stages left.

    The page is one file: figures are embedded, and it needs no network. The checks of the finite elements have a page of
    their own in the same folder. Nothing is recomputed; a part whose files are not there is named in its place.

    Parameters
    ----------
    study : Study
        The study.
    results_folder : str or Path
        results/<study>.
    out_html : str or Path
        The page.
    paper_folder : str or Path, optional
        The article's numbers (force_depth.csv, paper_tables.json), where the study is the article's.
    written : datetime, optional
        The time that the page states; None for the present.

    Returns
    -------
    list of str
        What is missing.
    """
    out_html, written = Path(out_html), written or datetime.now(UTC)
    results = StudyResults(study, Path(results_folder), None if paper_folder is None else Path(paper_folder))
    chapters = [make(results) for make in tracked(CHAPTERS, "chapters of the report")]
    head = {
        "study": study,
        "synthetic": " and ".join(results.synthetic_parts),
        "failed": len(results.not_converged()),
    }
    write_page(out_html, "report.html", chapters, written, report="", **head)
    if checks := verification_chapter.verification_table(results, out_html.name):
        page = out_html.with_name(verification_chapter.PAGE)
        write_page(page, "report.html", [checks], written, report=out_html.name, **head)
    return [
        block.words for chapter in chapters for block in chapter.blocks if getattr(block, "missing", False)
    ]


def write_page(
    path: Path, template: str, chapters: list[Chapter], written: datetime | None = None, **head
) -> Path:
    """Write a page of chapters under a template's head, and return its path; head: what the template names.

    Text is escaped, and what stands between backticks is code; a name that is not there is an error.
    """
    templates = Environment(
        loader=PackageLoader("gelforge.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["code"] = code
    html = templates.get_template(template).render(
        chapters=chapters,
        style=Markup(templates.get_template("report.css").render()),
        version=gelforge.__version__,
        written=(written or datetime.now(UTC)).strftime("%Y-%m-%d %H:%M UTC"),
        **head,
    )
    write_text(path, html)
    return path


def code(value: object) -> Markup:
    """Return a text for a page: escaped, with what stands between backticks as code."""
    return Markup(BACKTICKS.sub(r"<code>\1</code>", str(escape(str(value)))))
