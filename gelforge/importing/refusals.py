"""What refuses raw files: the error of all of them, pickles, and libraries that are not installed."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

PICKLES = {".pkl", ".pickle", ".joblib", ".pt", ".pth"}
ARCHIVES = {".zip", ".tar", ".tgz", ".gz", ".xz", ".bz2", ".7z", ".rar"}


class ImportingError(ValueError):
    """Raw logs that cannot become a session: where, what was found, the key that settles it."""


def is_pickle(path: Path) -> bool:
    """Return whether a file is one that runs code when it is loaded, by its name."""
    return path.suffix.lower() in PICKLES


def refuse_pickle(path: Path, remedy: str = "save the table as CSV") -> None:
    """Raise ImportingError for files that run code when they are loaded, and for archives."""
    if is_pickle(path):
        raise ImportingError(f"{path}: a pickle can run code when it is loaded and is not read; {remedy}")
    if path.suffix.lower() in ARCHIVES:
        raise ImportingError(
            f"{path}: an archive is not read; unpack it into a new folder and name a file of that"
        )


def library(module: str, package: str, what: str) -> ModuleType:
    """Return a library of the extra `bags`. Raises ImportingError with how to install it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise ImportingError(
            f'{what}: {package} is needed and not installed ({error}); pip install "gelforge[bags]"'
        ) from None
