"""`make types` checks the whole package: no module is left out, and no file switches it off."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_no_module_is_left_out():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mypy"]
    assert settings["files"] == ["gelforge"]
    assert not {"exclude", "ignore_errors", "follow_imports", "disable_error_code"} & set(settings)
    assert [one for one in settings.get("overrides", []) if one.get("ignore_errors")] == []


def test_what_is_ignored_says_which_error_and_why():
    """An ignored error has its code, and a comment in its line or in those above that statement's."""
    for path in sorted((ROOT / "gelforge").rglob("*.py")):
        lines = path.read_text(encoding="utf-8").splitlines()
        for number, line in enumerate(lines):
            assert "# mypy:" not in line, f"{path}:{number + 1}"
            if "# type: ignore" not in line:
                continue
            found = re.search(r"# type: ignore\[[a-z-]+\](  # .+)?$", line)
            assert found, f"{path}:{number + 1}: name the error, as in # type: ignore[arg-type]"
            above = lines[number - 1].strip().startswith("#")
            assert found[1] or above, f"{path}:{number + 1}: say why"
