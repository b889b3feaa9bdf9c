"""What every section of a configuration shares: names, ranges, and the refusal of unknown keys."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from typing import Annotated, TypeVar

from pydantic import AfterValidator

from gelforge.section import Fraction, NonNegative, Positive, Section

__all__ = [
    "NAME",
    "ConfigError",
    "Fraction",
    "Name",
    "NonNegative",
    "OldKey",
    "Positive",
    "Section",
    "given",
    "renamed",
    "without_former",
]
NAME = re.compile(r"[A-Za-z0-9_-]+")


class ConfigError(ValueError):
    """A configuration that cannot be used: where, what was found, what is allowed."""


class OldKey(FutureWarning):
    """A key of an earlier version that is still read: as what, and what to write in its place."""


Part = TypeVar("Part")


def given(part: Part | None, key: str) -> Part:
    """Return an optional part of a configuration that the caller needs. Raises ConfigError where it is not given."""
    if part is None:
        raise ConfigError(f"{key} is required here and not given; add it")
    return part


def _check_name(name: str) -> str:
    if not NAME.fullmatch(name):
        raise ValueError(f"{name!r} is not a name; use letters, digits, '_' and '-'")
    return name


Name = Annotated[str, AfterValidator(_check_name)]


def without_former(value: object, former: set[str], instead: str) -> object:
    """Return a section's raw keys without former ones that decide nothing any more, with a warning that says so."""
    if not isinstance(value, dict) or not (found := sorted(former & set(value))):
        return value
    warnings.warn(f"{', '.join(found)}: no longer read, leave out: {instead}", OldKey, stacklevel=2)
    return {key: item for key, item in value.items() if key not in former}


def renamed(value: object, names: Mapping[str, str]) -> object:
    """Return a section's raw keys with old names (old: new) replaced, with a warning for each; an old null is dropped.

    Raises ValueError where both names of a key are given.
    """
    if not isinstance(value, dict) or not (found := [old for old in names if old in value]):
        return value
    keys = {key: item for key, item in value.items() if key not in found}
    for old in found:
        new = names[old]
        if value[old] is None:
            continue
        if keys.get(new) is not None:
            raise ValueError(
                f"{old} {value[old]} and {new} {keys[new]}: {old} is the old name of {new}; remove it"
            )
        warnings.warn(
            f"{old} {value[old]} is read as {new}; gelforge 0.2 will not read it, write {new}",
            OldKey,
            stacklevel=2,
        )
        keys[new] = value[old]
    return keys
