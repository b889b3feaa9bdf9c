"""Public sets of tactile images with forces: every file of the folder `layouts` is one layout and defines `LAYOUT`.

    labelled.py   a set as readings: image, force, and what else it holds; the folder that is written of it
    arrays.py     .npz files of arrays; pickles are refused

None of the layouts holds what a session needs (stage positions from before contact on), and each says what is missing.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gelforge.importing.public.labelled import Layout

NAMES: list[str] = sorted(
    module.name for module in iter_modules([f"{path}/layouts" for path in __path__])
)  # without importing any


def layout_of(name: str) -> Layout:
    """Return a layout by its name. Raises TypeError for a file that defines no LAYOUT of its own name."""
    from gelforge.importing.public.labelled import Layout

    found = getattr(import_module(f"{__name__}.layouts.{name}"), "LAYOUT", None)
    if not isinstance(found, Layout) or found.name != name:
        raise TypeError(
            f"importing/public/layouts/{name}.py defines no LAYOUT of class Layout with the name {name!r}"
        )
    return found
