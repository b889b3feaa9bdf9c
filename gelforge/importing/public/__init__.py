"""Public sets of tactile images with forces: every file of the folder `layouts` is one layout and defines `LAYOUT`.

    labelled.py   a set as readings: image, force, and what else it holds; the folder that is written of it
    arrays.py     .npz files of arrays; pickles are refused

None of the layouts holds what a session needs (stage positions from before contact on), and each says what is missing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gelforge.registry import defined, names_in

if TYPE_CHECKING:
    from gelforge.importing.public.labelled import Layout

NAMES: list[str] = names_in(f"{path}/layouts" for path in __path__)


def layout_of(name: str) -> Layout:
    """Return a layout by its name.

    Parameters
    ----------
    name : str
        A file of layouts/, without suffix.

    Returns
    -------
    Layout
        How such a set is laid out and read.

    Raises
    ------
    TypeError
        For a file that defines no LAYOUT.
    ValueError
        For a layout whose own name is not the file's.
    """
    from gelforge.importing.public.labelled import Layout

    return defined(f"{__name__}.layouts", name, "LAYOUT", Layout)
