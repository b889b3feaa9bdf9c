"""Where material tests may differ from their nominal model, and what a fit says of those that were held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from gelforge.mismatch.goodness.scan import Atoms
from gelforge.mismatch.material.material_models import Fitted, fitted
from gelforge.mismatch.material.material_readings import Readings
from gelforge.mismatch.result import verdict as v
from gelforge.mismatch.terms.holdout import Blocks, gain, predictive_scores, selection_penalty_of

LEAST_SAMPLES = 4  # for whole ones to be held out
MANY_SEGMENTS = 12  # for whole branches to be held out
SHARE_HELD = 0.25
BANDS = ((0.0, 1 / 3), (1 / 3, 2 / 3), (2 / 3, 1.1))  # of the range of strain
BRANCHES = {"load": "loading", "unload": "unloading", "hold": "holds"}


@dataclass(frozen=True, eq=False)
class Pieces:
    """What is held out together."""

    of_row: pd.Series  # (n,) name; "" never
    held: tuple[str, ...]

    @property
    def train(self) -> np.ndarray:
        """Return the rows (n,) bool of training."""
        return ~self.of_row.isin(self.held).to_numpy()


def pieces_of(table: pd.DataFrame, rng: np.random.Generator) -> Pieces:
    """Return the pieces of some readings, a quarter of them held out; none of what the nominal model was fitted to.

    Indentations of a pair of load cells; else whole samples where there are enough; else whole branches; else quarters of
    branches. Training keeps every kind of branch and every place.
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
    piece, names = piece.where(rows, ""), pd.unique(piece[rows])
    for _ in range(500):
        held = np.sort(rng.permutation(len(names))[: max(2, round(SHARE_HELD * len(names)))])
        found = Pieces(piece, tuple(names[held]))
        if all(set(table[k][found.train]) == set(table[k]) for k in ("branch", "place") if k in table):
            return found
    return Pieces(piece, ())


def held_out_entry(readings: Readings, fit: Fitted, fits: Sequence[Fitted], pieces: Pieces) -> v.HeldOut:
    """Return how the changes of a fit, by values that follow the training rows alone, predict what was held out.

    fits: of all sets, among which the readings held out helped to choose.
    """
    train, residual = pieces.train, readings.measured - readings.base
    learnt = fitted(readings, fit.model, train)
    change, left = learnt.judged.change, readings.measured - learnt.prediction
    blocks, labels = Blocks(train, {"pieces": ~train}), pd.DataFrame({"site": np.zeros(len(train), int)})
    before = predictive_scores(residual, readings.covariance, blocks, labels, change=change)
    after = predictive_scores(
        left, learnt.covariance, blocks, labels, learnt.columns, learnt.judged.covariance
    )
    trained = np.array([fitted(readings, one.model, train).log_evidence for one in fits])
    selection_penalty = selection_penalty_of(trained, np.array([one.log_evidence for one in fits]))
    gained = gain(before, after)
    axis = pd.DataFrame({"axis": np.full(len(train), 2)})
    names = pieces.of_row[pieces.of_row != ""].nunique()
    return v.HeldOut(
        block=f"{len(pieces.held)} of {names} pieces: {', '.join(pieces.held)}",
        before=v.score(axis, residual, ~train, before["score"].sum()),
        after=v.score(axis, left, ~train, after["score"].sum()),
        gain=gained.total,
        standard_error=gained.standard_error,
        selection_penalty=selection_penalty,
    )


def patterns(readings: Readings) -> Atoms:
    """Return where readings may differ: kinds of branch, bands of strain, tests, branches of a test; a share of the base."""
    table, found = readings.table, {}
    share, branch = table["share"], table["branch"]
    for kind, word in BRANCHES.items():
        own = branch == kind
        found[f"all {word}"] = "phase", own & ~table["is_base"]
        for low, high in BANDS:
            words = f"{word} between {low:.0%} and {min(high, 1):.0%} of the range of strain"
            found[words] = "depth", own & share.between(low, high)
        found[f"second halves of {word}"] = "time", own & (table["progress"] > 0.5)
    for sample in pd.unique(table["sample"]):
        own = table["sample"] == sample
        found[f"specimen {sample}"] = "session", own
        for kind, word in BRANCHES.items():
            found[f"{word} of {sample}"] = "phase", own & (branch == kind)
    for place in pd.unique(table["place"]) if "place" in table else ():
        found[f"place {place}"] = "position", table["place"] == place
    values = {name: rows.to_numpy() * readings.base for name, (_, rows) in found.items()}
    # where the base is zero its share is nothing
    found["force of its own while unloading"] = "phase", branch == "unload"
    values["force of its own while unloading"] = np.abs(readings.measured).max() * (branch == "unload")
    kept = [name for name, (_, rows) in found.items() if rows.any()]
    columns = np.column_stack([values[name] for name in kept])
    return Atoms(tuple(kept), tuple(found[name][0] for name in kept), ({},) * len(kept), columns)
