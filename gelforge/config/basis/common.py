"""What every section of a configuration shares: names, ranges, and the refusal of unknown keys."""

from __future__ import annotations

import re
from typing import Annotated, TypeVar

from pydantic import AfterValidator

from gelforge.section import Fraction, NonNegative, Positive, Section, Share

__all__ = [
    "NAME",
    "ConfigError",
    "Fraction",
    "Name",
    "NonNegative",
    "Positive",
    "Section",
    "Share",
    "given",
]
NAME = re.compile(r"[A-Za-z0-9_-]+")


class ConfigError(ValueError):
    """A configuration that cannot be used: where, what was found, what is allowed."""


Part = TypeVar("Part")


def given(part: Part | None, key: str) -> Part:
    """Return an optional part of a configuration that the caller needs.

    Parameters
    ----------
    part : object or None
        The part, such as `session.camera`.
    key : str
        Its key, for the message.

    Returns
    -------
    object
        The part.

    Raises
    ------
    ConfigError
        Where it is None.
    """
    if part is None:
        raise ConfigError(f"{key} is required here and not given; add it")
    return part


def _check_name(name: str) -> str:
    if not NAME.fullmatch(name):
        raise ValueError(f"{name!r} is not a name; use letters, digits, '_' and '-'")
    return name


Name = Annotated[str, AfterValidator(_check_name)]
