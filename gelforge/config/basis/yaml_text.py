"""YAML as configurations need it: text, decimal numbers and null; no key twice, no alias that stands for too much."""

from __future__ import annotations

import re
from typing import Any, ClassVar

import yaml

# Of a YAML file: the longest here has 5000; a file of another kind is refused (tests/test_yaml_files.py).
MOST_CHARACTERS = 2_000_000
# Values of a YAML file, those that aliases repeat included: the largest here has 300. A bomb of aliases (CVE-2003-1564) is
# refused (tests/test_yaml_files.py).
MOST_NODES = 20_000


class NoYaml(ValueError):
    """A text that is no YAML that can be used; the message begins with the line, if one is known."""


def short(text: object, most: int = 80) -> str:
    """Return a text in one line of at most so many characters."""
    line = " ".join(str(text).split())
    return line if len(line) <= most else line[: most - 3] + "..."


class _Loader(yaml.SafeLoader):
    """YAML in which a scalar is null, a decimal number or text; a key stands once; aliases stay small.

    What YAML 1.1 makes of 010 (eight), 1:30 (ninety), yes (true) and 2026-01-02 (a date) is left to the model, which
    knows what a key holds: it reads `true` and `yes` where it wants a truth value and refuses them as numbers.
    """

    yaml_implicit_resolvers: ClassVar[dict] = {}

    def compose_node(self, parent, index):
        node = super().compose_node(parent, index)
        held = getattr(self, "held", 0) + 1
        if held > MOST_NODES:
            raise yaml.MarkedYAMLError("while reading", node.start_mark, f"more than {MOST_NODES} values")
        self.held = held
        return node

    def construct_mapping(self, node, deep=False):
        seen = set()
        for key, _ in node.value:
            if key.tag == "tag:yaml.org,2002:merge" or not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in seen:
                raise yaml.MarkedYAMLError(
                    None, None, f"the key {key.value!r} stands twice in one section; keep one", key.start_mark
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


for tag, pattern, first in (
    ("merge", r"<<", "<"),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("int", r"[-+]?(?:0|[1-9][0-9]{0,99})", "-+0123456789"),
    ("float", r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?", "-+.0123456789"),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{tag}", re.compile(f"^(?:{pattern})$"), first)


def _expanded(node: yaml.Node, known: dict[int, int]) -> int:
    """Return how many values a node holds, each alias counted with all that it stands for."""
    if id(node) in known:
        return known[id(node)]  # a node that holds itself counts as too many
    known[id(node)] = MOST_NODES + 1
    parts = [] if isinstance(node, yaml.ScalarNode) else node.value
    if isinstance(node, yaml.MappingNode):
        parts = [part for pair in node.value for part in pair]
    known[id(node)] = 1 + sum(_expanded(part, known) for part in parts)
    return known[id(node)]


def parsed(text: str) -> Any:
    """Return the content of a YAML document.

    Parameters
    ----------
    text : str
        The document.

    Returns
    -------
    object
        Mappings, lists and plain values.

    Raises
    ------
    NoYaml
        In one line that begins with the place.
    """
    try:
        return _parsed(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark else ""
        raise NoYaml(f"{line}: not valid YAML ({short(error.problem or error.context)})") from None
    except RecursionError:
        raise NoYaml(": not valid YAML (nested too deeply)") from None
    except (yaml.YAMLError, ValueError) as error:  # ValueError: a number of too many digits
        raise NoYaml(f": not valid YAML ({short(error)})") from None


def _parsed(text: str) -> Any:
    if len(text) > MOST_CHARACTERS:
        raise yaml.YAMLError(
            f"{len(text)} characters, at most {MOST_CHARACTERS} are read: is it another kind of file?"
        )
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is not None and _expanded(node, {}) > MOST_NODES:
            raise yaml.YAMLError(
                f"its aliases expand to more than {MOST_NODES} values or refer to themselves; write the values out"
            )
        return None if node is None else loader.construct_document(node)
    finally:
        loader.dispose()
