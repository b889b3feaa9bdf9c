"""Write the pages of reference that come from the code: python docs/reference.py [verification]

configuration.md, commands.md, columns.md and recording-tests.md; with `verification` the checks of the finite elements are
run too, which takes a minute, and results/verification.md is written.
"""

import argparse
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from gelforge.calibration.parameters import KINDS
from gelforge.cli.arguments import parser
from gelforge.config import schema
from gelforge.config.foreign.importing import ImportMapping
from gelforge.config.foreign.named_images import NamesMapping
from gelforge.config.sessions.session import Session
from gelforge.dataset.exports import NAMES as FORMATS
from gelforge.dataset.exports import format_of
from gelforge.dataset.schema import COLUMNS as SHARD
from gelforge.dataset.session_labels import PRESS_DATASETS
from gelforge.files import write_text
from gelforge.indentation.cells.cell_file import DATASETS as SITE
from gelforge.live import messages
from gelforge.live.record import COLUMNS as LIVE
from gelforge.mismatch.result import verdict_tables
from gelforge.recording import plausibility
from gelforge.recording.features import DATASETS as FEATURES
from gelforge.verification.run import run_checks

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
    """Return the page of the keys of a study, of a session and of the mappings that `gelforge import` reads."""
    known: set[str] = set()
    head = "# Configuration\n\n" + MARK.format("the sections of `gelforge.config`")
    head += "A name under *values* is a section with its own table. An unknown key is an error.\n"
    study = sections("A study: `config/NAME.yaml`", schema(), known)
    session = sections("A session: `session.yaml`", Session.model_json_schema(), known)
    logs = sections("A mapping of raw logs: `logs.yaml`", ImportMapping.model_json_schema(), known)
    images = sections("A mapping of a folder of images", NamesMapping.model_json_schema(), known)
    return head + "".join((*study, *session, *logs, *images))


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
        if name in DETAILS:
            parts.append(DETAILS[name]())
    return "".join(parts)


def free_parameters() -> str:
    """Return the parameters that can be calibrated as a table."""
    rows = []
    for name, kind in KINDS.items():
        prior = "none: state one"
        if kind.factor:
            prior = f"within a factor of {kind.factor:g} of the study's value"
        elif kind.width:
            prior = f"the study's value ± {kind.width:g}"
        of_layer = "LAYER." if kind.per_layer else ""
        rows.append(f"| `{of_layer}{name}` | {cell(kind.words)} [{kind.unit}] | {prior} |\n")
    return "\n| parameter | meaning | prior if none is given, 90 % |\n|:--|:--|:--|\n" + "".join(rows)


def formats() -> str:
    """Return the formats of exported datasets as a table."""
    rows = (f"| `{name}` | {cell(format_of(name).words)} |\n" for name in FORMATS)
    return "\n| format | content and reader |\n|:--|:--|\n" + "".join(rows)


DETAILS = {"calibrate": free_parameters, "export dataset": formats}


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


def datasets(title: str, described: Mapping[str, tuple[str, str]]) -> str:
    """Return the datasets of an HDF5 file, (unit, description) by name, as a table."""
    rows = (f"| `{name}` | {unit} | {cell(words)} |\n" for name, (unit, words) in described.items())
    return f"\n## {title}\n\n| dataset | unit | content |\n|:--|:--|:--|\n" + "".join(rows)


def described_in(module: Any) -> str:
    """Return the part of a module's docstring that begins with its first heading, as Markdown."""
    return "## " + module.__doc__.partition("\n## ")[2]


def recording_tests() -> str:
    """Return the page of the tests that a recording has to pass."""
    return (
        "# Recordings that cannot be true\n\n"
        + MARK.format("`gelforge.recording.plausibility`")
        + "A finding is an *error* (nothing is made), an *exclusion* or a *note*. An exclusion takes the force, or the\n"
        "image, of the named indentations out; more than half of a session excluded is an error. Findings name remedies;\n"
        "`recordings/<session>.findings.csv` lists all. Confirm what is right by `confirmed: [TEST]` in `session.yaml`.\n\n"
        + described_in(plausibility)
    )


def columns() -> str:
    """Return the page of the datasets of HDF5 files, of messages and the columns of a verdict's tables."""
    shard = {
        f"{name} ({', '.join(('N', *column.shape))})": (column.unit, column.description)
        for name, column in SHARD.items()
    }
    live = {name: ("", words) for name, (*_, words) in LIVE.items()}
    content = dict(re.findall(r"^(\S+\.csv) +(.*)$", verdict_tables.__doc__, re.M))
    tables = (
        f"| `{name}` | {content[name]} | {', '.join(f'`{column}`' for column in (*needed, *optional))} |\n"
        for name, (needed, optional) in verdict_tables.COLUMNS.items()
    )
    return (
        "# Datasets and columns\n\n"
        + MARK.format("the modules that write the files")
        + "Letters in brackets are the axes. Every dataset has `units` and `description` in its file.\n"
        + datasets("Sites: `cells/<site>.h5`", SITE)
        + datasets("Sensors that soften: `sessions/<session>/presses.h5`", PRESS_DATASETS)
        + datasets("Features: `features/<session>.h5`", FEATURES)
        + datasets("Shards: `dataset/shard-*.h5`", shard)
        + datasets("Recordings of `gelforge live`", live)
        + f"\n{described_in(messages)}"
        + "\n## Tables of a verdict\n\n| file | content | columns |\n|:--|:--|:--|\n"
        + "".join(tables)
    )


def verification() -> str:
    """Return the page of the checks of the finite elements, after they have run."""
    rows = (
        f"| {cell(check.quantity)} | {cell(check.source)} | {check.reference:.6g} | {check.found:.6g} | {check.error:.1e} | "
        f"{check.limit:.0e} |\n"
        for check in run_checks()
    )
    head = "# Checks of the finite elements\n\n" + MARK.format("`gelforge verify`").replace(
        "reference.py", "reference.py verification"
    )
    return (
        head
        + "[Verification](../verification.md) explains them. An error is relative where the reference is not zero.\n\n"
        + "| quantity | reference | value | computed | error | limit |\n|:--|:--|--:|--:|--:|--:|\n"
        + "".join(rows)
    )


PAGES = {
    "configuration.md": configuration,
    "commands.md": commands,
    "columns.md": columns,
    "recording-tests.md": recording_tests,
}

if __name__ == "__main__":
    pages = PAGES | ({"results/verification.md": verification} if "verification" in sys.argv[1:] else {})
    for name, page in pages.items():
        write_text(HERE / name, page())
