"""Datasets in other people's formats: every file of the folder `formats` is one format and defines `EXPORT`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gelforge.registry import defined, names_in

if TYPE_CHECKING:
    from gelforge.dataset.exports.export import Export

NAMES: list[str] = names_in(f"{path}/formats" for path in __path__)


def format_of(name: str) -> Export:
    """Return a format by its name.

    Parameters
    ----------
    name : str
        A file of formats/, without suffix.

    Returns
    -------
    Export
        Writes the format.

    Raises
    ------
    TypeError
        For a file that defines no EXPORT.
    ValueError
        For a format whose own name is not the file's.
    """
    from gelforge.dataset.exports.export import Export

    return defined(f"{__name__}.formats", name, "EXPORT", Export)
