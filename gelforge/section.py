"""A block of a configuration: what every one of them refuses. It stands below all folders, so that each can own its keys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, lt=1)]
Share = Annotated[float, Field(ge=0, le=1)]


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
