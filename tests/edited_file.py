"""A product that is changed by hand and holds a checksum that fits: for tests of the checks behind the checksum."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from gelforge.files import seal


@contextmanager
def edited(path: str | Path) -> Iterator[h5py.File]:
    """Yield an HDF5 product opened for changes; its checksum is written anew afterwards."""
    with h5py.File(path, "r+") as file:
        yield file
    seal(path)
