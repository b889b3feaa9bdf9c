"""NumPy archives: one for each split, a row per image."""

import numpy as np

from gelforge.dataset.exports.card import card
from gelforge.dataset.exports.export import Export
from gelforge.files import write_text

USE = '`numpy.load("FOLDER/train.npz")`, or `validation.npz`, `test.npz`.'


def write(source, folder, options):
    """Write <split>.npz with every column of numbers, and the card."""
    names = [name for name, variable in source.variables.items() if variable.kind not in ("text", "image")]
    for split in source.counts:
        blocks = list(source.blocks(source.of_split(split), names))
        columns = {name: np.concatenate([block[name] for block in blocks]) for name in names}
        np.savez_compressed(folder / f"{split}.npz", **columns)
    write_text(folder / "README.md", card(source, USE, options))


EXPORT = Export("npz", "numpy.load", write)
