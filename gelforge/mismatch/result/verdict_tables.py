"""The tables next to verdict.json, which holds the SHA-256 of each; docs/columns.md lists them.

readings.csv    each reading and axis: measured, of the study (base), with the answer (after), held out or not
body_map.csv    relative change of the modulus inside the body that would explain the forces
module.csv      the map or curve of a cause with a free form, and its standard deviation
correction.csv  a difference without a known cause, to add to the simulated force at judged places and depths
flow.csv        flow of judged images, by region: measured, of the study, with the answer
detection_limits.csv  the smallest value of each effect that these readings would show, next to a plausible one
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from gelforge.files import check_seal, file_sha256, write_text
from gelforge.mismatch.result.verdict import DetectionLimit, Verdict, VerdictError, read_verdict

READINGS, BODY_MAP, FLOW, CORRECTION = "readings.csv", "body_map.csv", "flow.csv", "correction.csv"
MODULE, LIMITS = "module.csv", "detection_limits.csv"
REMEDY = "write it anew with `gelforge mismatch`"
TEXTS = (
    *("session", "press", "site", "phase", "axis", "held_out"),
    *("quantity", "effect", "parameter", "unit"),
)
DIGITS = {LIMITS: "%.3g"}


def _of(axes: str, unit: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{name}_{axis}_{unit}" for axis in axes for name in names)


# Columns of each table, in their order, and those that may be absent. Cells are empty where there is nothing.
COLUMNS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    # time_s (of the session) is empty where no times are known. after_N: with the answer and the model in the base, empty
    # where there is neither; predicted_N: the same fitted without the readings held out. sigma_N and after_sigma_N: standard
    # deviation of measured minus base, and minus after. held_out: no, or the name of the block.
    READINGS: (
        (*TEXTS[:6], "x_mm", "y_mm", "depth_mm", "measured_N", "base_N", "sigma_N"),
        ("time_s", "after_N", "predicted_N", "after_sigma_N"),
    ),
    # a patch's centre, the relative change of its modulus and the standard deviation of that
    BODY_MAP: (("x_mm", "y_mm", "z_mm", "change", "sigma"), ()),
    # middle of a region in the image as taken, from the top left pixel's middle, and its mean flow since the reference image
    FLOW: (
        (
            *("session", "press", "x_mm", "y_mm", "depth_mm", "middle_u_px", "middle_v_px"),
            *_of("uv", "px", "measured", "base", "sigma"),
        ),
        _of("uv", "px", "after"),
    ),
    # one row per judged place and depth while loading; cells are empty where the model does not hold
    CORRECTION: (("x_mm", "y_mm", "depth_mm", *_of("xyz", "N", "base", "change", "sigma")), ()),
    # in addition, and first, what the map is a function of
    MODULE: (("quantity", "unit", "mean", "sigma"), ()),
    # smallest value that would be detected (empty: none would) and a plausible one [unit]
    LIMITS: (("effect", "parameter", "unit", "value", "plausible"), ()),
}


def write_tables(folder: str | Path, tables: Mapping[str, pd.DataFrame | None]) -> dict[str, str]:
    """Write the tables of a verdict.

    Parameters
    ----------
    folder : str or Path
        Receives them.
    tables : mapping of str to pandas.DataFrame or None
        By name, columns as in COLUMNS; those that are None are removed.

    Returns
    -------
    dict of str to str
        SHA-256 of each table by its name.

    Raises
    ------
    VerdictError
        Before anything is written, for a table without a column that it needs.
    """
    for name, table in tables.items():
        if table is not None and (missing := [c for c in COLUMNS[name][0] if c not in table]):
            raise VerdictError(f"{Path(folder) / name}: columns {missing} are missing; found {[*table]}")
    checksums = {}
    for name, table in tables.items():
        path, (needed, optional) = Path(folder) / name, COLUMNS[name]
        if table is None:
            path.unlink(missing_ok=True)
            continue
        if name != MODULE:
            table = table[[*needed, *(column for column in optional if column in table)]]
        write_text(path, table.to_csv(index=False, float_format=DIGITS.get(name, "%.9g")))
        checksums[name] = file_sha256(path)
    return checksums


def limits_table(limits: Sequence[DetectionLimit]) -> pd.DataFrame:
    """Return the rows of detection_limits.csv."""
    return pd.DataFrame([limit.model_dump() for limit in limits], columns=COLUMNS[LIMITS][0])


def check_tables(folder: str | Path, verdict: Verdict) -> None:
    """Refuse a verdict of which a table is missing, damaged or edited.

    Parameters
    ----------
    folder : str or Path
        Holds the tables.
    verdict : Verdict
        States their SHA-256.

    Raises
    ------
    VerdictError
        Names the table.
    """
    for name, stated in verdict.tables.items():
        check_seal(Path(folder) / name, REMEDY, VerdictError, stated)


def read_table(folder: str | Path, name: str, tables: Mapping[str, str] | None = None) -> pd.DataFrame | None:
    """Return a table of the verdict in a folder.

    Parameters
    ----------
    folder : str or Path
        Holds verdict and tables.
    name : str
        A key of COLUMNS.
    tables : mapping of str to str, optional
        SHA-256 by name, in place of those that the verdict states.

    Returns
    -------
    pandas.DataFrame or None
        NaN where cells are empty; None where there is no such table.

    Raises
    ------
    VerdictError
        For a table that is missing, damaged or edited.
    """
    stated = (read_verdict(folder).tables if tables is None else tables).get(name)
    if stated is None:
        return None
    path = Path(folder) / name
    check_seal(path, REMEDY, VerdictError, stated)
    read = pd.read_csv(path, dtype=dict.fromkeys(TEXTS, str), na_values=[""], keep_default_na=False)
    absent = [column for column in COLUMNS[name][1] if column not in read]
    read = read.assign(**dict.fromkeys(absent, float("nan")))
    return read.astype({column: float for column in read if column not in TEXTS})
