"""Tables in the units of the page: total forces in N, forces of a single bin in mN."""

from __future__ import annotations

import pandas as pd

IN_BINS = ("RMSES_", "bins_")  # columns of forces of a bin begin so
MEANS = {  # the errors of the table rmse, and whether they are of a bin
    "RMSE": ("all bins, pressed or not", True),
    "RMSES": ("bins whose label is not zero: those that are pressed", True),
    "RMSES_TRAINING": ("the same, on rows that the network was trained on", True),
    "RMSET_FEM": ("total force, the sum of the predicted bins, against that of the label (FEM)", False),
    "RMSET_FT": ("the same against the reading of the force/torque sensor (F/T)", False),
}


def in_units_of_the_page(name: str, table: pd.DataFrame) -> pd.DataFrame:
    """Return table `name` of a study's tables, in N, with forces of a bin in mN; rows of both kinds get a column `unit`."""
    if name == "rmse":
        kinds = [MEANS[error] for error in table["error"]]
        shown = _by_row(table, [of_bin for _, of_bin in kinds])
        shown.insert(1, "over", [words for words, _ in kinds])
        return shown
    if name == "force_ranges":
        return _by_row(table, table["quantity"].str.startswith("force per bin"))
    if name == "reliability":
        of_bin = table["quantity"].str.startswith("bins") & (table["unit"] == "N")
        return table.assign(
            value=table["value"].where(~of_bin, 1e3 * table["value"]), unit=table["unit"].where(~of_bin, "mN")
        )
    of_bins = [column for column in table.columns if column.startswith(IN_BINS) and column.endswith("_N")]
    scaled = table.assign(**{column: 1e3 * table[column] for column in of_bins})
    return scaled.rename(columns={column: f"{column[:-2]}_mN" for column in of_bins})


def _by_row(table: pd.DataFrame, of_bin) -> pd.DataFrame:
    """Return a table whose rows are of bins (N,) bool or of totals: columns lose their unit, which stands in the second."""
    rows = pd.Series(list(of_bin), index=table.index)
    forces = [column for column in table.columns if column.endswith("_N")]
    factor = rows.map({True: 1e3, False: 1.0})
    shown = table.assign(**{column: factor * table[column] for column in forces})
    shown = shown.rename(columns={column: column.removesuffix("_N") for column in forces})
    shown.insert(1, "unit", rows.map({True: "mN", False: "N"}))
    return shown
