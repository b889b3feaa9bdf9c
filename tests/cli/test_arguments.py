"""How commands are named, described and completed, and how a study is named in all of them."""

import argparse
import inspect
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from gelforge.cli.arguments import parser
from gelforge.cli.values import study_file

REPOSITORY = Path(__file__).parents[2]


def every_parser(top):
    """Yield a parser and those of all its commands."""
    yield top
    for action in top._actions:
        if isinstance(action, argparse._SubParsersAction):
            for one in action.choices.values():
                yield from every_parser(one)


def test_every_command_calls_a_function_and_describes_its_options():
    # Every command calls a function that takes its arguments. `run` names the function in words, which no type
    # check follows
    for one in every_parser(parser()):
        if run := one.get_default("run"):
            module, _, name = run.rpartition(".")
            taken = inspect.signature(getattr(import_module(f"gelforge.cli.{module}"), name)).parameters
            given = {action.dest for action in one._actions} - {"help", "debug", argparse.SUPPRESS}
            needed = {key for key, value in taken.items() if value.default is inspect.Parameter.empty}
            assert needed <= given <= set(taken), one.prog

    # Every option is described and every study is named the same way
    bare = [
        (one.prog, action.dest)
        for one in every_parser(parser())
        for action in one._actions
        if not action.help and not isinstance(action, argparse._SubParsersAction)
    ]
    assert len(list(every_parser(parser()))) > 40
    assert bare == []

    # Every command that needs a study reads its name the same way
    named = [
        action
        for one in every_parser(parser())
        for action in one._actions
        if action.dest in ("study", "config") and one.prog != "gelforge init"
    ]
    assert len(named) > 25
    assert {action.type for action in named} == {study_file}


@pytest.fixture
def studies(tmp_path, monkeypatch):
    """A folder whose studies are `demo`, in config/config.yaml, and `mine`."""
    monkeypatch.chdir(tmp_path)
    Path("config").mkdir()
    Path("config/config.yaml").write_text("# the demo\nstudy: demo # small\n")
    Path("config/mine.yaml").write_text("study: 'mine'\n")
    Path("config/README.yaml").write_text("keys: 1\n")


@pytest.mark.parametrize(
    ("text", "path"),
    [
        ("demo", "config/config.yaml"),  # by its key
        ("mine", "config/mine.yaml"),
        ("config", "config/config.yaml"),  # by its file's name
        ("config/mine.yaml", "config/mine.yaml"),
        ("away/other.yml", "away/other.yml"),  # its reader says that it is not there
    ],
)
def test_a_study_is_named_by_its_name_or_its_file(studies, text, path):
    assert study_file(text) == Path(path)


def test_an_unknown_name_is_answered_with_those_that_are_near(studies, capsys):
    with pytest.raises(SystemExit):
        parser().parse_args(["check", "dmo"])
    assert (
        "no study 'dmo'; the studies in config are demo, mine; or name a YAML file" in capsys.readouterr().err
    )

    # An unknown command suggests the nearest
    with pytest.raises(SystemExit, match="2"):
        parser().parse_args(["chekc", "demo"])
    assert capsys.readouterr().err == (
        "gelforge: no command 'chekc'; did you mean check? (help: gelforge --help)\n"
    )


def test_a_shell_completes_commands_and_names_of_studies(studies, tmp_path):
    pytest.importorskip("argcomplete")
    line = "gelforge check m"
    environment = os.environ | {
        "_ARGCOMPLETE": "1",
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
        "_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "out"),
        "PYTHONPATH": os.pathsep.join([str(REPOSITORY), *sys.path]),
    }
    subprocess.run([sys.executable, "-m", "gelforge"], env=environment)
    assert (tmp_path / "out").read_text().split() == ["mine"]
