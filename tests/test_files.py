"""Digests that say what made a file: every part of a stage's source counts, what Python compiles does not."""

import pytest

from gelforge.files import digests, source_digest


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Return the folder of a made-up package with a stage of code, template and style."""
    monkeypatch.setattr(digests, "__file__", str(tmp_path / "files" / "digests.py"))
    for name in (
        "report/page.py",
        "report/templates/report.html",
        "report/templates/report.css",
        "other/a.py",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    return tmp_path


@pytest.mark.parametrize(
    "name",
    ["report/page.py", "report/templates/report.html", "report/templates/report.css", "report/new.csv"],
)
def test_an_edit_of_any_file_of_a_stage_is_noticed(package, name):
    before = source_digest("report")
    (package / name).write_text("edited")
    assert source_digest("report") != before


@pytest.mark.parametrize("name", ["report/__pycache__/page.pyc", "report/.page.py.swp", "other/a.py"])
def test_other_files_do_not_count(package, name):
    before = source_digest("report")
    (package / name).parent.mkdir(exist_ok=True)
    (package / name).write_text("edited")
    assert source_digest("report") == before


def test_a_single_file_is_a_part_if_it_is_there(package):
    before = source_digest("report/page.py")
    (package / "report/templates/report.css").write_text("edited")
    assert source_digest("report/page.py") == before
    (package / "report/page.py").write_text("edited")
    assert source_digest("report/page.py") != before

    # A source that is not there is no source
    with pytest.raises(ValueError, match=r"report/moved.py is no file or folder"):
        source_digest("report/page.py", "report/moved.py")
