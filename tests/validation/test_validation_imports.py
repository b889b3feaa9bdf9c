"""The analysis knows nothing of the generator, and the generator nothing of the analysis."""

import ast
from pathlib import Path

import pytest

import gelforge
import validation

GENERATOR = Path(validation.__file__).parent
CHECKS = GENERATOR / "checks"  # these compare both, so they import both
ALLOWED = ("gelforge.config",)  # the file format of a session


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("checks"):
            names.add(f"validation.{node.module}")
    return names


def foreign(names: set[str]) -> list[str]:
    """Return what of the package the generator imports next to the file format, and what of the checks."""
    return sorted(
        name
        for name in names
        if (name.split(".")[0] == "gelforge" and not name.startswith(ALLOWED))
        or name.startswith("validation.checks")
    )


MODULES = sorted(path for path in GENERATOR.rglob("*.py") if CHECKS not in path.parents)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.name)
def test_the_generator_uses_only_the_file_format(path):
    assert foreign(imported(path)) == []


def test_modules_of_the_generator_are_found_with_their_imports(tmp_path):
    assert {"draw.py", "kinds.py", "recording.py", "score.py"} <= {path.name for path in MODULES}

    # The package imports nothing of the generator
    for path in Path(gelforge.__file__).parent.rglob("*.py"):
        assert not [n for n in imported(path) if n.split(".")[0] in ("validation", "benchmarks", "felupe")]

    # An import of the analysis is found
    assert foreign({"gelforge.mismatch.evidence.screen.screened", "gelforge.config.Session"}) == [
        "gelforge.mismatch.evidence.screen.screened"
    ]
    (tmp_path / "one.py").write_text("from .checks.form_errors import rows_of\n", encoding="utf-8")
    assert foreign(imported(tmp_path / "one.py")) == ["validation.checks.form_errors"]
