"""Variants: the same indentations under other assumptions, to be shown next to the study's own."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from gelforge.section import Name, Section


class Variant(Section):
    """Some sites of the plan solved again with other keys; nothing is trained on them."""

    describes: str = Field("", description="what is different, in words, for the report")
    sensor: dict[str, Any] = Field({}, description="keys of `sensor` that differ, e.g. flange: {...}")
    indenter: dict[str, Any] = Field({}, description="keys of `indenter` that differ")
    mechanics: dict[str, Any] = Field({}, description="keys of `mechanics` that differ, e.g. strain: small")
    cells: list[Name] = Field([], description="sites of the plan; none: one at the centre, one at a corner")


def merged(content: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return a mapping with changes.

    Parameters
    ----------
    content : dict
        Stays as it is.
    changes : dict
        Nested mappings are merged, everything else is replaced.

    Returns
    -------
    dict
        A new mapping.

    Examples
    --------
    >>> merged({"a": {"b": 1, "c": 2}}, {"a": {"b": 3}})
    {'a': {'b': 3, 'c': 2}}
    """
    result = dict(content)
    for key, value in changes.items():
        nested = isinstance(value, dict) and isinstance(result.get(key), dict)
        result[key] = merged(result[key], value) if nested else value
    return result
