"""`gelforge characterise` by hand: what a person finds in the folder."""

from pathlib import Path

import pytest

from gelforge.cli.by_hand.characterise import characterise_command
from gelforge.config import ConfigError

DEMO = Path(__file__).parents[2] / "data" / "demo" / "materials"


def test_two_materials_get_a_folder_each_and_an_unknown_law_none(tmp_path, capsys):
    # Two materials get a folder each
    characterise_command([DEMO / "ecoflex_gel", DEMO / "elastosil_25_1"], None, "ogden2, neo_hooke", tmp_path)
    for name in ("ecoflex_gel", "elastosil_25_1"):
        files = {path.relative_to(tmp_path / name).as_posix() for path in (tmp_path / name).rglob("*.*")}
        assert files == {
            "law.json", "laws/neo_hooke.json", "laws.csv", "laws.md", "parameters.csv", "parameters.md",
            "curves.csv", "notes.txt", "material.png", "material.svg",
            "effects.json", "effects.csv", "effects.md",
        }  # fmt: skip
    assert "ecoflex_gel: Ogden, K = 2: the lowest AICc of 2" in capsys.readouterr().out

    # An unknown law leaves nothing behind
    with pytest.raises(ConfigError, match="laws.0, found 'ogden7'"):
        characterise_command([DEMO / "ecoflex_gel"], None, "ogden7", tmp_path / "out")
    assert not (tmp_path / "out").exists()
