"""What a configuration says is never shell text; test_runs.py runs a study in such folders."""

import re
import shlex

import pytest
from conftest import HOSTILE, ROOT, Checkout

OWN = ("--configfile", "config/own.yaml")
SHELL = re.compile(r'^(\s+)shell:\n((?:\1\s+"[^\n]*"\n)+)', re.MULTILINE)


def unquoted(rules: str) -> list[str]:
    """Return the fields of a rule file's shell commands that are not written {value:q}."""
    commands = [found[2] for found in SHELL.finditer(rules)]
    assert len(commands) == len(re.findall(r"^\s+shell:", rules, re.MULTILINE)), "a shell command is not seen"
    fields = [field for command in commands for field in re.findall(r"\{([^{}]*)\}", command)]
    return [field for field in fields if not field.endswith(":q")]


@pytest.mark.parametrize("path", sorted((ROOT / "workflow/rules").glob("*.smk")), ids=lambda path: path.stem)
def test_every_rule_quotes_its_values(path):
    assert unquoted(path.read_text()) == []


def test_a_value_that_is_not_quoted_is_seen():
    assert unquoted('    shell:\n        "cp {input:q}"\n        " {output}"\n') == ["output"]


@pytest.fixture
def hostile(tmp_path) -> Checkout:
    """A checkout in a folder with spaces and a quote, and a study whose data folder is named like a command."""
    folder = tmp_path / "user's lab data"
    folder.mkdir()
    checkout = Checkout(folder)
    checkout.move_data(HOSTILE, OWN[1])
    return checkout


def test_a_folder_named_like_a_command_is_one_word_and_braces_are_refused(hostile):
    # A folder named like a command is one word of every command
    printed = hostile.snakemake("-n", "--printshellcmds", *OWN).stdout
    commands = [shlex.split(line.strip()) for line in printed.splitlines() if "fork_server.py" in line]
    words = [word for command in commands for word in command]
    assert len(commands) > 25
    assert words.count(HOSTILE) == 1  # mismatch reads the folder, the virtual lab writes into it
    assert sum(word.startswith(f"{HOSTILE}/virtual_truth/") for word in words) == 3
    assert not [word for word in words if "touch" in word and not word.startswith(HOSTILE)]

    # Braces are refused in one line
    hostile.move_data("data/{cell}", OWN[1])
    refused = hostile.snakemake("-n", *OWN, check=False)
    assert refused.returncode == 1
    assert "data, found 'data/{cell}': braces" in refused.stdout
