"""The documentation site: it builds without a warning, so no link, anchor or page of it is missing."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MISSING = [
    name for name in ("mkdocs", "material", "mkdocstrings", "mkdocstrings_handlers") if not find_spec(name)
]


@pytest.mark.skipif(bool(MISSING), reason=f'{", ".join(MISSING)} not installed: pip install -e ".[docs]"')
def test_the_site_builds_without_a_warning(tmp_path):
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stderr
    assert "WARNING" not in built.stderr
    assert (
        "sequence of float" in (tmp_path / "api" / "index.html").read_text()
    )  # docstrings are on their page
