"""Kinds of things of which each is one file of a folder: constitutive models, effects, formats, layouts, networks."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Protocol, TypeVar


class Named(Protocol):
    """Anything that is called by the name of its file."""

    @property
    def name(self) -> str: ...


Kind = TypeVar("Kind", bound=Named)


def names_in(folders: Iterable[str]) -> list[str]:
    """Return the names of a package's files in alphabetical order, without importing any.

    Parameters
    ----------
    folders : iterable of str
        `__path__` of the package.

    Returns
    -------
    list of str
        Without suffix.
    """
    return sorted(module.name for module in iter_modules(folders))


def defined(package: str, name: str, attribute: str, kind: type[Kind]) -> Kind:
    """Return what a file of a package defines under a name.

    Parameters
    ----------
    package : str
        Such as "gelforge.mechanics.laws.models".
    name : str
        The file, without suffix.
    attribute : str
        Such as "MODEL".
    kind : type
        Class that the attribute must have.

    Returns
    -------
    kind
        The attribute.

    Raises
    ------
    TypeError
        For a file without an attribute of this class.
    ValueError
        For one whose own name is not the file's.
    """
    file = f"{package.removeprefix('gelforge.').replace('.', '/')}/{name}.py"
    value = getattr(import_module(f"{package}.{name}"), attribute, None)
    if not isinstance(value, kind):
        raise TypeError(
            f"{file} defines no {attribute} of class {kind.__name__}; every file there defines one"
        )
    if value.name != name:
        raise ValueError(f"{file} holds the {kind.__name__.lower()} {value.name!r}; name the file as it")
    return value


def stated(file: Path, *names: str) -> dict:
    """Return the values of names to which a file assigns plain literals, without importing it.

    Parameters
    ----------
    file : Path
        Python source.
    *names : str
        Each must be assigned at the top level.

    Returns
    -------
    dict
        Values by name.

    Raises
    ------
    TypeError
        For a file that does not state one of them.
    """
    tree = ast.parse(file.read_text(encoding="utf-8"))
    values = {
        node.targets[0].id: ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Name)
        and node.targets[0].id in names
    }
    if missing := [name for name in names if name not in values]:
        raise TypeError(f"{file} states no {' and no '.join(missing)}; every file there does")
    return values
