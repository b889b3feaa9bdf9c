"""The tables beside verdict.json.

readings.csv    one row per reading and axis: measured, base, after
body_map.csv    where in the body the modulus would have to change, before any effect is named
module.csv      the map of a cause with a free form, and its standard deviation
correction.csv  what is modelled without a value of a known effect: by how much simulated forces change, by place and depth
flow.csv        one row per indentation with images and region of the image: measured, base, after
detection_limits.csv  the smallest value of each effect that these readings would show
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from gelforge.csv_table import read_csv
from gelforge.files import check_seal, without_seal, write_product_table, write_text
from gelforge.mismatch.result.verdict import DetectionLimit, VerdictError

READINGS, BODY_MAP, FLOW, CORRECTION = "readings.csv", "body_map.csv", "flow.csv", "correction.csv"
MODULE, LIMITS = "module.csv", "detection_limits.csv"

READINGS_NUMBERS = ["x_mm", "y_mm", "depth_mm", "measured_N", "base_N", "sigma_N"]
# Empty: no times known, nothing put into the base
READINGS_OPTIONAL = ["time_s", "after_N", "predicted_N", "after_sigma_N"]
# held_out: no, positions, deepest, ...
READINGS_TEXTS = ["session", "press", "site", "phase", "axis", "held_out"]
REMEDY = "write it anew with `gelforge mismatch`"
FLOW_NUMBERS = ["x_mm", "y_mm", "depth_mm", "middle_u_px", "middle_v_px"]
FLOW_NUMBERS += [f"{name}_{axis}_px" for name in ("measured", "base", "sigma") for axis in "uv"]
FLOW_OPTIONAL = ["after_u_px", "after_v_px"]
CORRECTION_NUMBERS = ["x_mm", "y_mm", "depth_mm"]
CORRECTION_NUMBERS += [f"{name}_{axis}_N" for axis in "xyz" for name in ("base", "change", "sigma")]
MODULE_OF = ["x_mm", "y_mm", "z_mm", "session", "time_s", "relaxation_time_s", "peak", "gone", "I1_less_3"]
BODY_MAP_NUMBERS = ["x_mm", "y_mm", "z_mm", "change", "sigma"]  # patch centre; modulus change, relative


def write_readings(folder: str | Path, table: pd.DataFrame) -> None:
    """Write readings.csv: one row per reading and axis, in the order taken.

    session, press, site (text), x_mm, y_mm, depth_mm, phase, time_s (of the session, empty where not known), axis (x, y, z);
    measured_N, base_N, after_N (with the answer and the model in the base, empty where there is neither), predicted_N (the
    same fitted without the readings held out); sigma_N (standard deviation of measured minus base that all allowed errors
    give together); after_sigma_N (the same of measured minus after, values included; may be left out); held_out (no, or the
    name of the block).
    """
    _write_table(Path(folder) / READINGS, table, [*READINGS_TEXTS, *READINGS_NUMBERS], READINGS_OPTIONAL)


def write_body_map(folder: str | Path, table: pd.DataFrame) -> None:
    """Write body_map.csv: patches (centre x_mm, y_mm, z_mm), fitted relative change of the modulus and its sigma."""
    _write_table(Path(folder) / BODY_MAP, table, BODY_MAP_NUMBERS, [])


def write_flow(folder: str | Path, table: pd.DataFrame | None) -> None:
    """Write flow.csv, or remove it where there is none: one row per indentation with images and region that shows the gel.

    session, press (text), x_mm, y_mm, depth_mm; middle of the region in the image as taken (middle_u_px, middle_v_px, from
    the top left pixel's middle); its mean flow since the reference image along u and v: measured, base, after (empty where
    nothing was put into the base) and sigma (standard deviation of measured minus base by all allowed errors) [px].
    """
    path = Path(folder) / FLOW
    if table is None:
        path.unlink(missing_ok=True)
    else:
        _write_table(path, table, ["session", "press", *FLOW_NUMBERS], FLOW_OPTIONAL)


def write_correction(folder: str | Path, table: pd.DataFrame | None) -> None:
    """Write correction.csv, or remove it where there is none: one row per judged place and depth while loading.

    x_mm, y_mm, depth_mm; per axis the base force, its change and the standard deviation of that [N]; empty where it does
    not hold.
    """
    path = Path(folder) / CORRECTION
    if table is None:
        path.unlink(missing_ok=True)
    else:
        _write_table(path, table, CORRECTION_NUMBERS, [])


def write_module(folder: str | Path, table: pd.DataFrame | None) -> None:
    """Write module.csv, or remove it where there is none: one row per quantity and what it is a function of.

    quantity (text); x_mm, y_mm of a place, z_mm of a box's middle; session and time_s of an indentation's first reading;
    relaxation_time_s; peak (largest energy so far over the largest of all) and gone (share of it that is gone now);
    I1_less_3 (the invariant I1 - 3), as the map has them; mean and sigma (standard deviation) of the map there
    in unit ("1": a share).
    """
    path = Path(folder) / MODULE
    if table is None:
        path.unlink(missing_ok=True)
    else:
        own = [name for name in MODULE_OF if name in table]
        _write_table(path, table, ["quantity", *own, "unit", "mean", "sigma"], [])


def write_limits(folder: str | Path, limits: Sequence[DetectionLimit]) -> None:
    """Write detection_limits.csv: effect, parameter, unit; smallest value that would be detected, a plausible one [unit]."""
    columns = ["effect", "parameter", "unit", "amount", "plausible"]
    rows = pd.DataFrame([limit.model_dump() for limit in limits], columns=columns)
    write_text(Path(folder) / LIMITS, rows.to_csv(index=False, float_format="%.3g"))


def read_flow(folder: str | Path) -> pd.DataFrame | None:
    """Return the flow, see write_flow; None where no images were judged."""
    path = Path(folder) / FLOW
    if not path.is_file():
        return None
    check_seal(path, REMEDY, VerdictError)
    read = read_csv(path, numbers=FLOW_NUMBERS, optional_numbers=FLOW_OPTIONAL, texts=["session", "press"])
    return without_seal(read).reset_index(drop=True)


def read_readings(folder: str | Path) -> pd.DataFrame:
    """Return the readings, see write_readings; times and after_N, after_sigma_N are nan where they are empty."""
    check_seal(Path(folder) / READINGS, REMEDY, VerdictError)
    table = read_csv(
        Path(folder) / READINGS,
        numbers=READINGS_NUMBERS,
        optional_numbers=READINGS_OPTIONAL,
        texts=READINGS_TEXTS,
    )
    return without_seal(table).reset_index(drop=True)


def read_body_map(folder: str | Path) -> pd.DataFrame | None:
    """Return the body map, see write_body_map; None where none was made."""
    path = Path(folder) / BODY_MAP
    if not path.is_file():
        return None
    check_seal(path, REMEDY, VerdictError)
    return without_seal(read_csv(path, numbers=BODY_MAP_NUMBERS)).reset_index(drop=True)


def _write_table(path: Path, table: pd.DataFrame, needed: list[str], optional: list[str]) -> None:
    missing = [name for name in needed if name not in table]
    if missing:
        raise VerdictError(f"{path}: columns {missing} are missing; found {list(table.columns)}")
    columns = needed + [name for name in optional if name in table]
    write_product_table(path, table[columns], "%.9g")
