"""A whole fake study, written once for the report's tests."""

from __future__ import annotations

import fake_results
import pytest

from gelforge.report.chapters import chapter as chapters
from gelforge.report.page import write_report


@pytest.fixture(scope="session")
def whole(tmp_path_factory):
    """Return study, results folder and paper folder of a study with one synthetic session."""
    return fake_results.write_everything(tmp_path_factory.mktemp("whole"))


@pytest.fixture(scope="session")
def page(whole, tmp_path_factory):
    """Return the HTML of the whole study's report and what was missing."""
    out = tmp_path_factory.mktemp("page") / "report.html"
    missing = write_report(whole[0], whole[1], out, whole[2])
    return out.read_text(encoding="utf-8"), missing


@pytest.fixture
def undrawn(monkeypatch):
    """Let pages be written with empty pictures: to draw them is most of a page's time, and its text needs none."""
    monkeypatch.setattr(chapters, "data_uri", lambda figure: "data:image/svg+xml;base64,")
