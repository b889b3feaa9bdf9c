"""A block of a configuration: names, ranges, and what every one of them refuses.

It stands below all folders, so that each can own its keys.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_serializer

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, lt=1)]
Share = Annotated[float, Field(ge=0, le=1)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Triple = Annotated[list[float], Field(min_length=3, max_length=3)]
NAME = re.compile(r"[A-Za-z0-9_-]+")
Part = TypeVar("Part")


class ConfigError(ValueError):
    """A configuration that cannot be used: where, what was found, what is allowed."""


def _check_name(name: str) -> str:
    if not NAME.fullmatch(name):
        raise ValueError(f"{name!r} is not a name; use letters, digits, '_' and '-'")
    return name


Name = Annotated[str, AfterValidator(_check_name)]


class Section(BaseModel):
    """A block of keys; what it does not name is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def with_values(self, values: Mapping[str, Any]) -> Self:
        """Return a copy with other values, not checked again.

        Parameters
        ----------
        values : mapping
            By key; those of a section inside this one as a mapping of its own.

        Examples
        --------
        >>> class Inner(Section):
        ...     a: int = 1
        ...     b: int = 2
        >>> class Outer(Section):
        ...     inner: Inner = Inner()
        >>> Outer().with_values({"inner": {"a": 5}})
        Outer(inner=Inner(a=5, b=2))
        """
        sections = {key for key in values if isinstance(getattr(self, key), Section)}
        changed = {
            key: getattr(self, key).with_values(value)
            if key in sections and isinstance(value, Mapping)
            else value
            for key, value in values.items()
        }
        return self.model_copy(update=changed)


class GrownSection(Section):
    """A section that has got more keys; these are written only where they are given, so that older digests stay."""

    later: ClassVar[tuple[str, ...]] = ()

    @model_serializer(mode="wrap")
    def _as_written(self, write) -> dict[str, Any]:
        usual = {key: type(self).model_fields[key].default for key in self.later}
        return {key: value for key, value in write(self).items() if key not in usual or value != usual[key]}


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
