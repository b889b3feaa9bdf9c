"""What PyTorch and NumPy raise when memory runs out, as one line with its remedy."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import torch

from gelforge.learning.basis.scaling import ModelError

# PyTorch raises RuntimeError where the processor's memory runs out, and for some failures of a GPU; oneDNN's names no memory
WORDS = ("can't allocate memory", "not enough memory", "out of memory", "could not create a primitive")
ASKED = re.compile(r"allocate (\d+) bytes|allocate ([\d.]+ [KMGT]iB)")


@contextmanager
def memory_named(remedy: str) -> Iterator[None]:
    """Give a block that runs out of memory an error with a remedy; other errors pass.

    Parameters
    ----------
    remedy : str
        What to change.

    Yields
    ------
    None
        To the block.

    Raises
    ------
    ModelError
        Where the block runs out of memory.
    """
    try:
        yield
    except (MemoryError, RuntimeError) as error:
        if not is_of_memory(error):
            raise
        raise ModelError(f"no memory is left{_asked_for(str(error))}; {remedy}") from None


def is_of_memory(error: Exception) -> bool:
    """Return whether an error says that memory ran out, the processor's or a GPU's."""
    known = isinstance(error, (MemoryError, torch.cuda.OutOfMemoryError))
    return known or any(words in str(error) for words in WORDS)


def _asked_for(text: str) -> str:
    """Return how much was asked for and of which memory, as far as a message says so."""
    where = " of the GPU" if "CUDA" in text else ""
    match = ASKED.search(text)
    if not match:
        return where
    size = match[2] or f"{int(match[1]) / 2**20:.0f} MiB"
    return f"{where}, {size} were asked for"
