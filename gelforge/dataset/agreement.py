"""Simulated next to measured total force, press by press."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.dataset.schema import DatasetError
from gelforge.dataset.session_labels import OwnCells, OwnPresses, check_digest
from gelforge.files import check_table_inputs, read_product_table, write_product_table
from gelforge.indentation.cells.cell_file import Cell, read_cell
from gelforge.indentation.paths.places import DEPTH_MATCH_MM, within
from gelforge.recording.readings import AXES, FORCE

COLUMNS = [
    "session",
    "press",
    "cell",
    "x_mm",
    "y_mm",
    "depth_mm",
    *(f"{kind}_{a}_N" for kind in ("fem", "ft") for a in AXES),
]


def agreement_table(
    readings_files: Mapping[str, str | Path],
    cell_files: Mapping[str, str | Path],
    own_labels: Mapping[str, OwnCells | OwnPresses] | None = None,
    cell_digests: Mapping[str, str] | None = None,
    raw_digests: Mapping[str, str] | None = None,
) -> pd.DataFrame:
    """Return one row per indentation: total force [N] of the finite elements and the mean of the indentation's load and
    dwell readings.

    Only readings at the deepest depth of an indentation count, and of these only those with a force. Indentations whose
    force a test of the session excluded are left out. So are those of failed sites, and those that failed themselves, as in
    the shards.

    Parameters
    ----------
    readings_files : mapping of str to str or Path
        recordings/<session>.csv of each session; images are not needed.
    cell_files : mapping of str to str or Path
        The file of each site.
    own_labels : mapping of str to OwnCells or OwnPresses, optional
        As of `join_shard`.
    cell_digests : mapping of str to str, optional
        By site, the `inputs_digest` that its file must have.
    raw_digests : mapping of str to str, optional
        By session, the digest of inputs that its readings must have.

    Returns
    -------
    pandas.DataFrame
        Columns as in COLUMNS.

    Raises
    ------
    DatasetError
        For an indentation without its site or depth, and for readings of other inputs.
    CellError
        For a site that is missing or truncated.
    """
    for session, expected in (raw_digests or {}).items():
        path = readings_files[session]
        check_table_inputs(path, expected, f"make the readings again (snakemake -R {path})", DatasetError)
    parts = [_measured(session, path) for session, path in readings_files.items()]
    measured = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=COLUMNS)
    own_labels = own_labels or {}
    rows = _with_sites(measured[~measured["session"].isin(own_labels)], cell_files, cell_digests or {})
    for session, labels in own_labels.items():
        presses = measured[measured["session"] == session]
        if isinstance(labels, OwnPresses):
            rows.append(_with_presses(presses, labels))
        else:
            rows += _with_sites(presses, labels.files, labels.digests)
    table = pd.concat(rows).sort_index() if rows else measured.iloc[:0]
    return table.reindex(columns=COLUMNS).reset_index(drop=True)


def _measured(session: str, path: str | Path) -> pd.DataFrame:
    """Return session, press, cell, position, depth and mean force [N] of each indentation, in the order taken."""
    readings = read_product_table(
        path,
        f"make the readings again (snakemake -R {path})",
        DatasetError,
        dtype={"press": str, "cell": str, "excluded": str},
        keep_default_na=False,
        na_values={name: [""] for name in (*FORCE, "depth_mm")},
    )
    held = readings[readings["phase"].isin(["load", "dwell"])]
    deepest = held.groupby("press")["depth_mm"].transform("max")
    held = held[within(deepest - held["depth_mm"], DEPTH_MATCH_MM)]
    empty = held[FORCE].isna().any(axis=1)
    held = held[~empty | (held.get("excluded", "") == "")]  # what a test excluded is listed with the findings
    lost = held[held[FORCE].isna().any(axis=1)]
    if len(lost):
        raise DatasetError(
            f"{path}: indentation {lost.iloc[0]['press']} has an empty force; correct indentations.csv"
        )
    first = {name: (name, "first") for name in ("cell", "x_mm", "y_mm", "depth_mm")}
    mean = {f"ft_{axis}_N": (name, "mean") for axis, name in zip(AXES, FORCE)}
    return held.groupby("press", sort=False).agg(**first, **mean).reset_index().assign(session=session)


def _with_sites(
    presses: pd.DataFrame, files: Mapping[str, str | Path], digests: Mapping[str, str]
) -> list[pd.DataFrame]:
    """Return the indentations with the forces of their sites, each in a file, table by table; none of failed sites."""
    tables = []
    for name, of_site in presses.groupby("cell", sort=False):
        if name not in files:
            press = of_site.iloc[0]
            raise DatasetError(
                f"session {press.session}: indentation {press.press} belongs to site {name!r}, which is not in the plan;"
                " add its position to the plan"
            )
        cell = checked_totals(files[name], name, digests.get(name))
        if cell.converged:
            tables.append(_with_fem(of_site, cell, files[name]))
    return tables


def _with_fem(presses: pd.DataFrame, cell: Cell, path: str | Path) -> pd.DataFrame:
    depths, total = cell.arrays["depth_mm"], cell.arrays["total_force_N"]
    gap = np.abs(presses["depth_mm"].to_numpy()[:, None] - depths)  # (indentations, D)
    step = gap.argmin(axis=1)
    far = ~within(gap.min(axis=1), DEPTH_MATCH_MM)
    if far.any():
        press = presses.iloc[far.argmax()]
        raise DatasetError(
            f"{path}: indentation {press.press} of session {press.session} has depth {press.depth_mm} mm, the site has "
            f"{depths.tolist()}; add the depth to the plan"
        )
    return presses.assign(**{f"fem_{axis}_N": total[step, i] for i, axis in enumerate(AXES)})


def _with_presses(presses: pd.DataFrame, labels: OwnPresses) -> pd.DataFrame:
    """Return the indentations with forces of their own; those that failed are left out."""
    known = presses[[not labels.reason(press) for press in presses["press"]]]
    total = np.array([labels.totals[press] for press in known["press"]]).reshape(-1, 3)
    return known.assign(**{f"fem_{axis}_N": total[:, i] for i, axis in enumerate(AXES)})


def checked_totals(path: str | Path, name: str, expected: str | None) -> Cell:
    """Return depths and total forces of a site, after checking that it is the one asked for and that they are numbers."""
    cell = read_cell(path, ["depth_mm", "total_force_N"])
    check_digest(path, name, cell, expected)
    if not all(np.isfinite(array).all() for array in cell.arrays.values()):
        raise DatasetError(
            f"{path}: site {name}: forces or depths are not finite; simulate it again (snakemake -R {path})"
        )
    return cell


def write_agreement(path: str | Path, table: pd.DataFrame, inputs: str = "") -> None:
    """Write agreement.csv with nine digits, more than any force sensor has.

    Parameters
    ----------
    path : str or Path
        The file.
    table : pandas.DataFrame
        As `agreement_table` returns it.
    inputs : str
        Digest of the sites and readings.
    """
    write_product_table(path, table, "%.9g", inputs)


def read_agreement(path: str | Path, inputs: str | None = None) -> pd.DataFrame:
    """Return the table agreement.csv: forces measured and simulated, side by side.

    Parameters
    ----------
    path : str or Path
        The file.
    inputs : str, optional
        What the digest of its sites and readings must be.

    Returns
    -------
    pandas.DataFrame
        One row per indentation; names stay text.

    Raises
    ------
    DatasetError
        For a file that is damaged, or made from other inputs.
    """
    if inputs is not None:
        check_table_inputs(path, inputs, f"make the agreement again (snakemake -R {path})", DatasetError)
    return read_product_table(
        path,
        f"make the agreement again (snakemake -R {path})",
        DatasetError,
        dtype={"session": str, "press": str, "cell": str},
    )


def rmse_gt_table(agreement: pd.DataFrame, resolution_N: Mapping[str, Sequence[float]]) -> pd.DataFrame:
    """Return RMSE_GT (Sferrazza et al. 2019, table 1): rms over indentations of F/T minus FEM total force, per axis.

    Parameters
    ----------
    agreement : pandas.DataFrame
        As `agreement_table` returns it.
    resolution_N : mapping of str to sequence of float
        By session, that of its F/T sensor along x, y, z [N].

    Returns
    -------
    pandas.DataFrame
        One row per axis for all sessions together, then per session: RMSE_GT, mean difference and the F/T sensor's
        resolution [N], the coarsest for all together.
    """
    groups = [("all", agreement)] + [(name, rows) for name, rows in agreement.groupby("session", sort=False)]
    rows = []
    for session, presses in groups:
        for i, axis in enumerate(AXES):
            difference = presses[f"ft_{axis}_N"] - presses[f"fem_{axis}_N"]
            known = resolution_N.values() if session == "all" else [resolution_N[session]]
            rows.append(
                {
                    "session": session,
                    "axis": axis,
                    "presses": len(presses),
                    "RMSE_GT_N": float(np.sqrt(np.mean(difference**2))),
                    "mean_difference_N": float(difference.mean()),
                    "ft_resolution_N": max(values[i] for values in known),
                }
            )
    return pd.DataFrame(rows)
