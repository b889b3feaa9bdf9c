"""The gallery of the site: pages are those of the notebooks, and what cannot go on says why in one line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import gelforge as gf
from gelforge.cli import notebook

FOLDER = Path(__file__).parents[1] / "docs" / "notebooks"
NOTEBOOKS = sorted(path for path in FOLDER.glob("*.py") if path.name != "render.py")
LARGEST = 300_000  # bytes of all pages and pictures together


def code_cells(script: str) -> list[str]:
    """Return the code of each cell of a script of cells."""
    cells = script.split("# %%")[1:]
    return [cell.partition("\n")[2].strip("\n") for cell in cells if not cell.startswith(" [markdown]")]


@pytest.mark.parametrize("script", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_page_shows_its_notebook_as_it_is(script):
    page = script.with_suffix(".md").read_text(encoding="utf-8")
    cells = code_cells(script.read_text(encoding="utf-8"))
    assert len(cells) > 2
    for cell in cells:
        assert f"```python\n{cell}\n```" in page, f"run: make notebooks\n{cell}"


def test_the_gallery_is_small_and_complete():
    assert len(NOTEBOOKS) == 6
    listed = (FOLDER / "index.md").read_text(encoding="utf-8")
    assert all(f"({script.stem}.md)" in listed for script in NOTEBOOKS)
    assert sum(path.stat().st_size for path in FOLDER.rglob("*") if path.suffix in (".md", ".png")) < LARGEST


@pytest.mark.thorough
@pytest.mark.parametrize("script", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_as_a_script(script, tmp_path):
    environment = os.environ | {"MPLBACKEND": "Agg", "TMPDIR": str(tmp_path)}
    ran = subprocess.run(
        [sys.executable, script], env=environment, cwd=tmp_path, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr[-2000:]


def test_a_command_is_shown_and_its_failure_or_a_missing_extra_stops(capsys, monkeypatch):
    # A command is shown and its failure stops
    gf.run("gelforge --version")
    assert gf.__version__ in capsys.readouterr().out
    gf.run("gelforge --version", quiet=True)
    assert gf.__version__ not in capsys.readouterr().out
    with pytest.raises(notebook.NotebookStop, match="status 2: gelforge check: .*no study 'nowhere'"):
        gf.run("gelforge check nowhere")
    with pytest.raises(notebook.NotebookStop, match="'rm' is not run from here"):
        gf.run("rm -r results")
    with pytest.raises(notebook.NotebookStop, match="no extras .'workflows'"):
        gf.require("workflows")

    # Without the workflow extra it stops with one line
    monkeypatch.setattr(notebook, "find_spec", lambda name: None if name == "snakemake" else object())
    gf.require("learning")
    for stop in (lambda: gf.require("workflow", "learning"), lambda: gf.run("snakemake --cores 1")):
        with pytest.raises(notebook.NotebookStop) as stopped:
            stop()
        (line,) = stopped.value._render_traceback_()  # what Jupyter shows
        assert line == 'gelforge: snakemake not installed; pip install "gelforge[workflow]"'
