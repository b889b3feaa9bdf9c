"""The analysis knows nothing of the generator, and the generator nothing of the analysis."""

import ast
from pathlib import Path

import concealed
import pytest

import gelforge

GENERATOR = Path(concealed.__file__).parent
ALLOWED = ("gelforge.config",)  # the file format of a session


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def foreign(names: set[str]) -> list[str]:
    """Return what of the package the generator imports beside the file format."""
    return sorted(n for n in names if n.split(".")[0] == "gelforge" and not n.startswith(ALLOWED))


@pytest.mark.parametrize("path", sorted(GENERATOR.rglob("*.py")), ids=lambda path: path.name)
def test_the_generator_uses_only_the_file_format(path):
    assert foreign(imported(path)) == []


def test_the_package_imports_nothing_of_the_benchmarks():
    for path in Path(gelforge.__file__).parent.rglob("*.py"):
        assert not [n for n in imported(path) if n.split(".")[0] in ("concealed", "benchmarks", "felupe")]


def test_an_import_of_the_analysis_is_found():
    assert foreign({"gelforge.mismatch.evidence.screen.screened", "gelforge.config.Session"}) == [
        "gelforge.mismatch.evidence.screen.screened"
    ]
