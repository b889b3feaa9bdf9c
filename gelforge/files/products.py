"""Text, JSON and tables that are written whole, and those that a later stage reads with their checksum."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

from gelforge.files.seals import UNSEALED, FileError, check_seal
from gelforge.files.whole import atomic

if TYPE_CHECKING:
    import pandas as pd

SEAL_COLUMN = re.compile(r"sha256:[0-9a-f]{64}|inputs:[0-9a-f]*")


def write_text(target: str | Path, text: str) -> None:
    """Write a UTF-8 text file, whole or not at all.

    Parameters
    ----------
    target : str or Path
        The file; missing folders above it are made.
    text : str
        Its content; line ends stay as they are.

    Raises
    ------
    FileError
        For a full disk; what was there before stays.
    """
    with atomic(target) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(target: str | Path, content) -> None:
    """Write JSON with sorted keys, whole or not at all: the same content gives the same bytes.

    Parameters
    ----------
    target : str or Path
        The file; missing folders above it are made.
    content : object
        Anything that JSON can hold; no NaN and no infinity.

    Raises
    ------
    ValueError
        For NaN or infinity.
    FileError
        For a full disk; what was there before stays.
    """
    write_text(target, json.dumps(content, indent=2, sort_keys=True, allow_nan=False) + "\n")


def write_product_json(target: str | Path, content: dict) -> None:
    """Write a JSON object that a later stage reads, its checksum as the first key `checksum`.

    Parameters
    ----------
    target : str or Path
        The file; missing folders above it are made.
    content : dict
        Anything that JSON can hold; no NaN and no infinity.

    Raises
    ------
    FileError
        For a full disk; what was there before stays.
    """
    text = json.dumps(content, indent=2, sort_keys=True, allow_nan=False)
    with atomic(target, sealed=True) as temporary:
        first = '{\n  "checksum": "' + UNSEALED.decode() + '"' + ("," if content else "")
        temporary.write_text(first + text.removeprefix("{") + "\n", encoding="utf-8")


def read_product_json(path: str | Path, remedy: str, kind: type[ValueError] = FileError) -> dict:
    """Return the JSON object that `write_product_json` wrote.

    Parameters
    ----------
    path : str or Path
        The file.
    remedy : str
        What to do, for the message.
    kind : type of ValueError
        Class of the error.

    Returns
    -------
    dict
        Without the checksum.

    Raises
    ------
    kind
        For a file that is missing, damaged or edited, and for other content than an object.
    """
    check_seal(path, remedy, kind)
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError as error:  # sealed so by hand
        raise kind(f"{path}: not valid JSON ({error}); {remedy}") from None
    if not isinstance(content, dict):
        raise kind(f"{path}: holds {type(content).__name__}, expected an object; {remedy}")
    content.pop("checksum", None)
    return content


def write_product_table(
    target: str | Path, table: pd.DataFrame, float_format: str | None = None, inputs: str = ""
) -> None:
    """Write a CSV table that a later stage reads, its checksum as the name of a last, empty column.

    Parameters
    ----------
    target : str or Path
        The file; missing folders above it are made.
    table : pandas.DataFrame
        Its index is not written.
    float_format : str, optional
        As of pandas.DataFrame.to_csv, such as "%.6g".
    inputs : str
        Digest of what the table was made from; it becomes the name of another empty column.

    Raises
    ------
    FileError
        For a full disk; what was there before stays.
    """
    with atomic(target, sealed=True) as temporary:
        names = [f"inputs:{inputs}"] * bool(inputs) + [UNSEALED.decode()]
        sealed = without_seal(table).assign(**dict.fromkeys(names, ""))
        sealed.to_csv(temporary, index=False, float_format=float_format, lineterminator="\n")


def read_product_table(
    path: str | Path, remedy: str, kind: type[ValueError] = FileError, **options
) -> pd.DataFrame:
    """Return a table that `write_product_table` wrote.

    Parameters
    ----------
    path : str or Path
        The file.
    remedy : str
        What to do, for the message.
    kind : type of ValueError
        Class of the error.
    **options
        As of pandas.read_csv.

    Returns
    -------
    pandas.DataFrame
        Without the columns of the checksum.

    Raises
    ------
    kind
        For a file that is missing, damaged or edited.
    """
    check_seal(path, remedy, kind)
    import pandas as pd  # a third of a second, which who reads no table does without

    return without_seal(pd.read_csv(path, **options))


def without_seal(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table without the columns that are its checksum and the digest of its inputs."""
    return table.drop(columns=[name for name in table.columns if SEAL_COLUMN.fullmatch(str(name))])


def check_table_inputs(
    path: str | Path, expected: str, remedy: str, kind: type[ValueError] = FileError
) -> None:
    """Refuse a table that was made from other inputs than the expected ones.

    Parameters
    ----------
    path : str or Path
        A table that `write_product_table` wrote with `inputs`.
    expected : str
        The digest of the inputs.
    remedy : str
        What to do, for the message.
    kind : type of ValueError
        Class of the error.

    Raises
    ------
    kind
        For a table that is damaged or of another digest.
    """
    check_seal(path, remedy, kind)
    with open(path, encoding="utf-8") as file:
        stated_inputs = re.search(r"inputs:([0-9a-f]+)", file.readline())
    if stated_inputs is None or stated_inputs[1] != expected:
        stated = stated_inputs[1][:12] if stated_inputs else "none"
        raise kind(
            f"{path}: made from other inputs than those of this study (digest {stated}, expected {expected[:12]}); {remedy}"
        )


def write_table(folder: str | Path, name: str, table: pd.DataFrame) -> None:
    """Write a table as <name>.csv, with its checksum, and as <name>.md.

    Parameters
    ----------
    folder : str or Path
        Made where it is missing.
    name : str
        Name of both files.
    table : pandas.DataFrame
        Its index is not written; the Markdown has four significant digits.
    """
    write_product_table(Path(folder) / f"{name}.csv", table)
    write_text(Path(folder) / f"{name}.md", table.to_markdown(index=False, floatfmt=".4g") + "\n")
