"""The tables of a study with the paper's values next to them."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd

AXES = ("x", "y", "z")


def beside_paper(name: str, table: pd.DataFrame, paper: dict | None) -> pd.DataFrame:
    """Return table `name` with the paper's values (paper_tables.json) next to the study's, where it has any."""
    if paper is None or name not in _PAPER:
        return table
    return _PAPER[name](table.copy(), paper)


def said_beside(words: str, paper: dict | None) -> str:
    """Return a caption whose part in braces is said, after a comma, where the paper's values stand in the table."""
    return re.sub(r"\{(.*?)\}", r", \1" if paper is not None else "", words)


def _material(table: pd.DataFrame, paper: dict) -> pd.DataFrame:
    """One column: the published parameter of each material and quantity."""
    values = []
    for material, quantity in zip(table["material"], table["quantity"]):
        published = paper["ogden"].get(material, {})
        name, _, number = str(quantity).partition("_")
        series = published.get({"mu": "mu_kPa", "alpha": "alpha"}.get(name, ""), [])
        known = number.isdigit() and int(number) <= len(series)
        values.append(
            series[int(number) - 1] if known else published.get("E_kPa") if quantity == "E" else None
        )
    table["paper"] = np.array(values, dtype=float)
    return table


def _rmse(table: pd.DataFrame, paper: dict) -> pd.DataFrame:
    """A column per axis: the paper's table of errors."""
    for axis in AXES:
        published = [paper["errors_N"].get(error, {}).get(axis) for error in table["error"]]
        table[f"paper_{axis}_N"] = np.array(published, dtype=float)
    return table


def _rmse_gt(table: pd.DataFrame, paper: dict) -> pd.DataFrame:
    """Two columns: the paper's agreement and its sensor's resolution."""
    table["paper_RMSE_GT_N"] = [float(paper["force_agreement_rmse_N"][axis]) for axis in table["axis"]]
    table["paper_ft_resolution_N"] = [float(paper["ft_resolution_N"][axis]) for axis in table["axis"]]
    return table


def _force_ranges(table: pd.DataFrame, paper: dict) -> pd.DataFrame:
    """A row under each quantity: the paper's range."""
    rows = []
    for row in table.to_dict("records"):
        rows.append(row)
        published = paper["force_ranges_N"].get(
            {"force per bin": "per_bin", "total force": "total"}.get(row["quantity"])
        )
        if published is not None:
            ends = {
                f"{axis}_{end}_N": published[axis][i] for axis in AXES for i, end in enumerate(("min", "max"))
            }
            rows.append({"quantity": f"{row['quantity']}, paper"} | ends)
    return pd.DataFrame(rows, columns=table.columns)


_PAPER = {"material": _material, "rmse": _rmse, "rmse_gt": _rmse_gt, "force_ranges": _force_ranges}
