"""Where material tests may differ from their nominal model, and what is held out."""

from __future__ import annotations

import numpy as np
import pandas as pd

from gelforge.mismatch.goodness.patterns import Atoms, Pattern
from gelforge.mismatch.material.material_readings import Readings

LEAST_SAMPLES = 4  # for whole ones to be held out
MANY_SEGMENTS = 12  # for whole branches to be held out
SHARE_HELD = 0.25
BANDS = ((0.0, 1 / 3), (1 / 3, 2 / 3), (2 / 3, 1.1))  # of the range of strain
BRANCHES = {"load": "loading", "unload": "unloading", "hold": "holds"}


def held_pieces(table: pd.DataFrame, rng: np.random.Generator) -> pd.Series:
    """Return the piece of each reading (n,) that is held out, a quarter of all pieces; "no" of the others.

    None of what the nominal model was fitted to. Indentations of a pair of load cells; else whole samples where there are
    enough; else whole branches; else quarters of branches. Training keeps every kind of branch and every place.
    """
    free, segment = ~table["is_base"], "branch " + table["segment"].astype(str)
    others = free & ~table["sample"].isin(table["sample"][~free])
    quarter = (4 * table["progress"]).astype(int).clip(upper=3) + 1
    choices = [
        (others, table["sample"].astype(str), LEAST_SAMPLES),
        (free, segment, MANY_SEGMENTS),
        (free, segment + ", quarter " + quarter.astype(str), 0),
    ]
    if "place" in table:
        choices = [(free, table["part"].astype(str), 0)]
    rows, piece = next((rows, piece) for rows, piece, least in choices if piece[rows].nunique() >= least)
    names = pd.unique(piece[rows])
    for _ in range(500 if len(names) > 1 else 0):
        chosen = names[rng.permutation(len(names))[: max(2, round(SHARE_HELD * len(names)))]]
        held = piece.where(rows & piece.isin(chosen), "no")
        if all(set(table[k][held == "no"]) == set(table[k]) for k in ("branch", "place") if k in table):
            return held
    return piece.where(False, "no")


def patterns(readings: Readings) -> Atoms:
    """Return where readings may differ: kinds of branch, bands of strain, tests, branches of a test; a share of the base."""
    table, found = readings.table, []
    share, branch, sample = table["share"], table["branch"], table["sample"]
    for kind, word in BRANCHES.items():
        own = branch == kind
        found.append((f"all {word}", "phase", own & ~table["is_base"]))
        for low, high in BANDS:
            words = f"{word} between {low:.0%} and {min(high, 1):.0%} of the range of strain"
            found.append((words, "depth", own & share.between(low, high)))
        found.append((f"second halves of {word}", "time", own & (table["progress"] > 0.5)))
    for name in pd.unique(sample):
        found.append((f"specimen {name}", "session", sample == name))
        for kind, word in BRANCHES.items():
            found.append((f"{word} of {name}", "phase", (sample == name) & (branch == kind)))
    for place in pd.unique(table["place"]) if "place" in table else ():
        found.append((f"place {place}", "position", table["place"] == place))
    atoms = [
        (Pattern(name, kind), rows.to_numpy() * readings.base) for name, kind, rows in found if rows.any()
    ]
    unloading = (branch == "unload").to_numpy()
    if unloading.any():  # where the base is zero its share is nothing
        size = np.abs(readings.measured).max()
        atoms.append((Pattern("force of its own while unloading", "phase"), size * unloading))
    names, values = zip(*atoms)
    return Atoms(names, np.column_stack(values))
