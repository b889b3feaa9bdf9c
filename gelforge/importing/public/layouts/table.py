"""Any set that is one CSV with a row per image: TacVerse, FeelAnyForce and others, by the names of their columns."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gelforge.csv_table import read_csv
from gelforge.importing.public.labelled import UNKNOWN, Layout, Options, Reading
from gelforge.importing.refusals import ImportingError, refuse_pickle
from gelforge.importing.streams import refuse_other_unit
from gelforge.units import UNITS, unit_named

FORCES, OTHERS = ("fx", "fy", "fz"), ("image", "group", "reference", "time_s", "x_mm", "y_mm", "z_mm")
KNOWN = OTHERS + FORCES


def read(path: Path, options: Options) -> Iterator[Reading]:
    """Yield a reading per row; images are named from the table's folder. Raises ImportingError for columns not declared."""
    columns = options.columns
    if missing := [name for name in ("image", *FORCES) if name not in columns]:
        raise ImportingError(
            f"{path}: which columns hold {', '.join(missing)} is not said; give --columns {missing[0]}=NAME ..."
        )
    if unknown := sorted(set(columns) - set(KNOWN)):
        raise ImportingError(
            f"--columns: {', '.join(unknown)} is not one of {', '.join(KNOWN)}; correct the name"
        )
    unit = unit_named(options.unit)
    if unit is None or UNITS[unit][0] != "force":
        raise ImportingError(f"--unit {options.unit}: no unit of force; give N, mN, lbf or another")
    refuse_pickle(path)
    for name in FORCES:
        refuse_other_unit(path, columns[name], options.unit, "--unit")
    texts = [columns[name] for name in ("image", "group", "reference") if name in columns]
    numbers = [columns[name] for name in columns if columns[name] not in texts]
    rows = read_csv(path, numbers=numbers, texts=texts)
    for row in rows.to_dict("records"):
        yield Reading(
            path.parent / row[columns["image"]],
            UNITS[unit][1] * np.array([row[columns[name]] for name in FORCES]),
            str(row[columns["group"]]) if "group" in columns else "all",
            path.parent / row[columns["reference"]] if "reference" in columns else None,
            float(row[columns["time_s"]]) if "time_s" in columns else float("nan"),
            _position(row, columns),
        )


def _position(row: dict, columns: dict[str, str]):
    names = [columns.get(name) for name in ("x_mm", "y_mm", "z_mm")]
    return np.array([row[name] if name else np.nan for name in names]) if any(names) else UNKNOWN


LAYOUT = Layout(
    name="table",
    what="a table with a row per image",
    force="as the table's authors say",
    reference="a column, where there is one",
    lacks="a row per image says neither when the stage moved nor where the force was zero; if there are logs, describe them"
    " for `gelforge import`",
    licence="that of the set",
    read=read,
)
