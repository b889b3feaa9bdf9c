"""The two tables beside verdict.json.

readings.csv    one row per reading and axis: measured, base, after
body_map.csv    where in the body the modulus would have to change, before any effect is named
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from gelforge.csv_table import read_csv
from gelforge.files import write_text
from gelforge.mismatch.verdict import VerdictError

READINGS, BODY_MAP = "readings.csv", "body_map.csv"

READINGS_NUMBERS = ["x_mm", "y_mm", "depth_mm", "measured_N", "base_N", "sigma_N"]
READINGS_OPTIONAL = ["time_s", "after_N", "after_sigma_N"]  # empty: no times known, nothing put into the base
# held_out: no, positions, deepest, ...
READINGS_TEXTS = ["session", "press", "site", "phase", "axis", "held_out"]
BODY_MAP_NUMBERS = ["x_mm", "y_mm", "z_mm", "change", "sigma"]  # patch centre; modulus change, relative


def write_readings(folder: str | Path, table: pd.DataFrame) -> None:
    """Write readings.csv: one row per reading and axis, in the order taken.

    session, press, site (text), x_mm, y_mm, depth_mm, phase, time_s (of the session, empty where not known), axis (x, y, z);
    measured_N, base_N, after_N (with the answer in the base, empty where there is none); sigma_N (standard deviation of
    measured minus base that all allowed errors give together); after_sigma_N (the same of measured minus after, amounts
    included; may be left out); held_out (no, or the name of the block).
    """
    _write_table(Path(folder) / READINGS, table, [*READINGS_TEXTS, *READINGS_NUMBERS], READINGS_OPTIONAL)


def write_body_map(folder: str | Path, table: pd.DataFrame) -> None:
    """Write body_map.csv: patches (centre x_mm, y_mm, z_mm), fitted relative change of the modulus and its sigma."""
    _write_table(Path(folder) / BODY_MAP, table, BODY_MAP_NUMBERS, [])


def read_readings(folder: str | Path) -> pd.DataFrame:
    """Return the readings, see write_readings; times and after_N, after_sigma_N are nan where they are empty."""
    return read_csv(
        Path(folder) / READINGS,
        numbers=READINGS_NUMBERS,
        optional_numbers=READINGS_OPTIONAL,
        texts=READINGS_TEXTS,
    ).reset_index(drop=True)


def read_body_map(folder: str | Path) -> pd.DataFrame | None:
    """Return the body map, see write_body_map; None where none was made."""
    path = Path(folder) / BODY_MAP
    return read_csv(path, numbers=BODY_MAP_NUMBERS).reset_index(drop=True) if path.is_file() else None


def _write_table(path: Path, table: pd.DataFrame, needed: list[str], optional: list[str]) -> None:
    missing = [name for name in needed if name not in table]
    if missing:
        raise VerdictError(f"{path}: columns {missing} are missing; found {list(table.columns)}")
    columns = needed + [name for name in optional if name in table]
    write_text(path, table[columns].to_csv(index=False, float_format="%.9g"))
