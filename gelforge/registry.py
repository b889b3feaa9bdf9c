"""Kinds of things of which each is one file of a folder: effects, formats, layouts."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pkgutil import iter_modules


def names_in(folders: Iterable[str]) -> list[str]:
    """Return the names of a package's files in alphabetical order, without importing any."""
    return sorted(module.name for module in iter_modules(folders))


def defined(package: str, name: str, attribute: str, kind: type):
    """Return what the file `name` of a package defines as attribute.

    Raises TypeError for a file without one of this kind, ValueError for one whose own name is not the file's.
    """
    file = f"{package.removeprefix('gelforge.').replace('.', '/')}/{name}.py"
    found = getattr(import_module(f"{package}.{name}"), attribute, None)
    if not isinstance(found, kind):
        raise TypeError(
            f"{file} defines no {attribute} of class {kind.__name__}; every file there defines one"
        )
    if found.name != name:
        raise ValueError(f"{file} holds the {kind.__name__.lower()} {found.name!r}; name the file as it")
    return found
