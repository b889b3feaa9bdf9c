"""Files of NumPy arrays, read without running code."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from gelforge.importing.refusals import ImportingError, is_pickle

SCRIPT = "convert it with the script of docs/public-sets.md, which takes arrays, numbers and texts only"


def load_arrays(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an .npz file by name. Raises ImportingError for pickles and for other files."""
    if is_pickle(path):
        raise ImportingError(_pickled(path))
    try:
        loaded = np.load(path, allow_pickle=False)
        if not isinstance(loaded, np.lib.npyio.NpzFile):
            raise ImportingError(
                f"{path}: holds one array {loaded.shape} and not named ones; name the folder of samples (.npz)"
            )
        with loaded:
            return {name: loaded[name] for name in loaded.files}
    except ImportingError:
        raise
    except FileNotFoundError:
        raise ImportingError(f"{path}: no such file; name the folder of the set") from None
    except (ValueError, EOFError, OSError, zipfile.BadZipFile) as error:
        if "pickle" in str(error) or "Object arrays" in str(error):
            raise ImportingError(_pickled(path)) from None
        raise ImportingError(f"{path}: cannot be read as arrays ({error}); fetch the file again") from None


def files_of(path: Path, kinds: tuple[str, ...], what: str) -> list[Path]:
    """Return the files of these kinds in a folder and below it in the order of names, or the file itself.

    A file with a namesake of the first kind in its folder was converted to that, and is left.
    """
    if path.is_file():
        if path.suffix.lower() not in kinds:
            raise ImportingError(
                f"{path}: no {' or '.join(kinds)} file; name a folder of the set, or one of its files"
            )
        return [path]
    files = sorted(p for p in path.rglob("*") if p.suffix.lower() in kinds and p.is_file())
    # converted next to
    files = [p for p in files if p.suffix == kinds[0] or not p.with_suffix(kinds[0]).is_file()]
    if not files:
        raise ImportingError(f"{path}: no {what} in this folder; name the folder that holds them")
    return files


def _pickled(path: Path) -> str:
    return f"{path}: a pickle can run code when it is loaded and is not read; {SCRIPT}"
