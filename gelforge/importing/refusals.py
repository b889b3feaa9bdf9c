"""What refuses raw files: the error of all of them, pickles, and libraries that are not installed."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

PICKLES = {".pkl", ".pickle", ".joblib", ".pt", ".pth"}


class ImportingError(ValueError):
    """Raw logs that cannot become a session: where, what was found, the key that settles it."""


def is_pickle(path: Path) -> bool:
    """Return whether a file is one that runs code when it is loaded, by its name."""
    return path.suffix.lower() in PICKLES


def refuse_pickle(path: Path) -> None:
    """Raise ImportingError for files that run code when they are loaded."""
    if is_pickle(path):
        raise ImportingError(
            f"{path}: a pickle can run code when it is loaded and is not read; save the table as CSV"
        )


def library(module: str, package: str, what: str) -> ModuleType:
    """Return a library of the extra `bags`. Raises ImportingError with how to install it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise ImportingError(
            f'{what}: {package} is needed and not installed ({error}); pip install "gelforge[bags]"'
        ) from None
