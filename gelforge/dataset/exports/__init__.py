"""Datasets in other people's formats: every file of the folder `formats` is one format and defines `EXPORT`."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gelforge.dataset.exports.export import Export

NAMES: list[str] = sorted(
    module.name for module in iter_modules([f"{path}/formats" for path in __path__])
)  # without importing any


def format_of(name: str) -> Export:
    """Return a format by its name. Raises TypeError for a file that defines no EXPORT of its own name."""
    from gelforge.dataset.exports.export import Export

    found = getattr(import_module(f"{__name__}.formats.{name}"), "EXPORT", None)
    if not isinstance(found, Export) or found.name != name:
        raise TypeError(
            f"dataset/exports/formats/{name}.py defines no EXPORT of class Export with the name {name!r}"
        )
    return found
