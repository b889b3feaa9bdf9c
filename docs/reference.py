"""Write the pages of reference that come from the code, configuration.md and commands.md: python docs/reference.py"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gelforge.cli.arguments import parser
from gelforge.config import schema
from gelforge.config.sessions.session import Session
from gelforge.files import write_text

HERE = Path(__file__).parent
MARK = "Written by `python docs/reference.py` from {}.\n"
SECTION = "| key | meaning | values | default |\n|:--|:--|:--|:--|\n"


def cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())


def kind_of(key: dict[str, Any]) -> str:
    """Return in words what a key of a JSON schema may be; a section links to its table."""
    if "$ref" in key:
        name = key["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if parts := key.get("anyOf") or key.get("oneOf"):
        return ", ".join(dict.fromkeys(kind_of(part) for part in parts))
    if "enum" in key or "const" in key:
        return ", ".join(f"`{value}`" for value in key.get("enum", [key.get("const")]))
    if key.get("type") == "array":
        return f"list of {kind_of(key['items'])}" if key.get("items") else "list"
    if key.get("type") == "object":
        inside = key.get("additionalProperties")
        return f"names with {kind_of(inside)}" if isinstance(inside, dict) else "keys"
    limits = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    bounds = " and ".join(f"{sign} {key[name]:g}" for name, sign in limits.items() if name in key)
    return f"{key.get('type', 'any')} {bounds}".strip()


def default_of(name: str, key: dict[str, Any], required: list[str]) -> str:
    value = key.get("default")
    if name in required:
        return "required"
    if isinstance(value, dict):
        return ""  # a section: its table has the defaults
    return "" if value in (None, "", []) else f"`{str(value).lower() if isinstance(value, bool) else value}`"


def table(section: dict[str, Any]) -> str:
    """Return a section's keys as a table."""
    rows = (
        f"| `{name}` | {cell(key.get('description', ''))} | {cell(kind_of(key))} | "
        f"{cell(default_of(name, key, section.get('required', [])))} |\n"
        for name, key in section.get("properties", {}).items()
    )
    return SECTION + "".join(rows)


def sections(title: str, whole: dict[str, Any], known: set[str]) -> Iterator[str]:
    """Yield the tables of a schema, each section once; `known` names those that an earlier schema had."""
    yield f"\n## {title}\n\n{table(whole)}"
    for name, section in whole.get("$defs", {}).items():
        if name not in known and section.get("type") == "object":
            known.add(name)
            yield f"\n### {name}\n\n{cell(section.get('description', ''))}\n\n{table(section)}"


def configuration() -> str:
    """Return the page of the keys of a study and of a session."""
    known: set[str] = set()
    head = "# Configuration\n\n" + MARK.format("the sections of `gelforge.config`")
    head += "A name under *values* is a section with its own table. An unknown key is an error.\n"
    study = sections("A study: `config/NAME.yaml`", schema(), known)
    session = sections("A session: `session.yaml`", Session.model_json_schema(), known)
    return head + "".join(study) + "".join(session)


def commands() -> str:
    """Return the page of all commands and their arguments."""
    parts = ["# Commands\n\n" + MARK.format("`gelforge --help`")]
    parts.append("Every command has `--help`, and `--debug` for the traceback of an error.\n")
    for name, command, text in subcommands(parser()):
        parts.append(f"\n## gelforge {name}\n\n{cell(text)}\n")
        head = "\n| argument | meaning |\n|:--|:--|\n"
        for action in command._actions:  # argparse has no public list
            if action.dest not in ("help", "debug") and not isinstance(action, argparse._SubParsersAction):
                words = ", ".join(action.option_strings) or str(action.metavar or action.dest)
                takes = "" if action.nargs == 0 or not action.option_strings else f" {value_of(action)}"
                parts.append(f"{head}| `{words}{takes}` | {cell((action.help or '') % vars(action))} |\n")
                head = ""
    return "".join(parts)


def value_of(action: argparse.Action) -> str:
    """Return the word for an option's value."""
    if action.choices and not action.metavar:
        return "{" + ",".join(map(str, action.choices)) + "}"
    names = action.metavar if isinstance(action.metavar, tuple) else (action.metavar or action.dest.upper(),)
    return " ".join(names)


def subcommands(
    top: argparse.ArgumentParser, prefix: str = ""
) -> Iterator[tuple[str, argparse.ArgumentParser, str]]:
    """Yield name, parser and help of each command, those of a command's own after it."""
    for action in top._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                yield prefix + name, command, command.description or ""
                yield from subcommands(command, f"{prefix}{name} ")


PAGES = {"configuration.md": configuration, "commands.md": commands}

if __name__ == "__main__":
    for name, page in PAGES.items():
        write_text(HERE / name, page())
