"""What a caller passes, as what is needed; anything else is a ConfigError that says what to pass."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from gelforge.config import ConfigError


def number(name: str, value: Any) -> float:
    """Return a finite number."""
    try:
        converted = math.nan if isinstance(value, str | bytes) else float(value)
    except (TypeError, ValueError):
        converted = math.nan
    if not math.isfinite(converted):
        raise ConfigError(f"{name}={shown(value)}: a finite number is needed")
    return converted


def numbers(name: str, value: Any, count: int | None = None) -> list[float]:
    """Return finite numbers, `count` of them where that is given; a single number is a list of one."""
    several = isinstance(value, Iterable) and not isinstance(value, str | bytes | Mapping)
    try:
        values = [number(name, one) for one in (value if several else [value])]
    except (ConfigError, TypeError):  # TypeError: an array without dimensions
        values = []
    if not values or len(values) != (count or len(values)):
        needed = "finite numbers are" if count is None else f"{count} finite numbers are"
        raise ConfigError(f"{name}={shown(value)}: {needed} needed, as {[0.5, 1.0, 1.5, 2.0][: count or 2]}")
    return values


def whole(name: str, value: Any) -> int:
    """Return a whole number of 1 or more."""
    read = number(name, value)
    if read < 1 or read != int(read):
        raise ConfigError(f"{name}={shown(value)}: a whole number of 1 or more is needed")
    return int(read)


def names(name: str, value: Any) -> list[str]:
    """Return names; a single one may stand by itself."""
    given = [value] if isinstance(value, str) else value
    if not isinstance(given, Iterable) or isinstance(given, Mapping):
        raise ConfigError(f"{name}={shown(value)}: a list of names is needed")
    given = list(given)
    if not all(isinstance(one, str) for one in given):
        raise ConfigError(f"{name}={shown(value)}: a list of names is needed")
    return given


def path(name: str, value: Any, what: str) -> Path:
    """Return a path; what: the file or folder that is needed, in words."""
    if not isinstance(value, str | os.PathLike):
        raise ConfigError(f"{name}={shown(value)}: pass the path of {what}")
    return Path(value)


def mapping(name: str, value: Any, example: str) -> Mapping:
    """Return a mapping; example: one that could be passed."""
    if not isinstance(value, Mapping):
        raise ConfigError(f"{name}={shown(value)}: pass a mapping such as {example}")
    return value


def shown(value: Any) -> str:
    """Return a value as a message has it: short, and of large objects their type alone."""
    text = repr(value)
    return text if len(text) <= 60 and "\n" not in text else f"<{type(value).__name__}>"
