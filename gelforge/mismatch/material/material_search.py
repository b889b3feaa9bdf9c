"""The search for what a material's law leaves out: one effect after the other, each confirmed on pieces held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.special import logsumexp

from gelforge.mismatch.evidence.alternatives import NULL_PRIOR, normalised
from gelforge.mismatch.goodness.scan import Atoms
from gelforge.mismatch.material.material_evidence import (
    Candidate,
    Fitted,
    Model,
    Readings,
    combined,
    fitted,
    held_out_scores,
)
from gelforge.mismatch.result import verdict as v
from gelforge.progress import tracked

EVIDENCE = 5.0  # log Bayes factor that an effect needs; also how near a rival must be to be one
MOST_EFFECTS = 3
LEAST_PIECES = 4  # samples, for whole ones to be held out
SHARE_HELD = 0.25
PARTS_OF_SEGMENT = 4  # one of which is held out of each
MANY_SEGMENTS = 12  # for whole branches to be held out
BANDS = ((0.0, 1 / 3), (1 / 3, 2 / 3), (2 / 3, 1.1))


@dataclass(frozen=True)
class Step:
    """One effect added to what was there: all that were tried, and the winner."""

    tried: dict[str, float]  # log Bayes factor over the model before, averaged over shapes
    best: dict[
        str, tuple[float, Candidate, Fitted]
    ]  # of each effect its best shape, fitted to the training rows
    before: Fitted
    winner: str = ""  # nothing: none was accepted
    refused: tuple[str, ...] = ()  # evidence for them, but no gain on what was held out

    @property
    def unconfirmed(self) -> list[str]:
        """Return the effects that are not taken though there is evidence for them, the strongest first."""
        found = [name for name, z in self.tried.items() if z > EVIDENCE and name != self.winner]
        return sorted(found, key=lambda name: -self.tried[name])

    def probabilities(self, no_signature: Sequence[str] = ()) -> dict[str, float]:
        """Return the probability of each effect and of "null", that none is added."""
        all_tried = self.tried | {name: 0.0 for name in no_signature if name not in self.tried}
        all_tried |= {name: min(self.tried[name], 0.0) for name in self.refused}
        weights = {name: np.log((1 - NULL_PRIOR) / len(all_tried)) + z for name, z in all_tried.items()}
        return normalised({"null": np.log(NULL_PRIOR)} | weights)


def with_pieces(readings: Readings, rng: np.random.Generator) -> tuple[Readings, list[str]]:
    """Return the readings with their pieces named, and those held out: a quarter, before anything is chosen.

    Indentations of a pair of load cells; else whole samples where there are enough; else whole branches; else a quarter of
    each branch. Never the loading that the base was fitted to; training keeps every kind of branch and every place.
    """
    table = readings.table
    free = ~table["is_base"].to_numpy()
    others = free & ~table["sample"].isin(table["sample"][~free]).to_numpy()
    segment = table["segment"].astype(str)
    if "place" in table:
        piece = table["part"].astype(str)
    elif table["sample"][others].nunique() >= LEAST_PIECES:
        piece, free = table["sample"].astype(str), others
    elif segment[free].nunique() >= MANY_SEGMENTS:
        piece = "branch " + segment
    else:
        quarter = np.minimum((PARTS_OF_SEGMENT * table["progress"]).astype(int), PARTS_OF_SEGMENT - 1)
        piece = "branch " + segment + ", quarter " + (quarter + 1).astype(str)
        readings = replace(readings, table=table.assign(piece=piece.where(free, "")))
        by_segment = [list(dict.fromkeys(p)) for _, p in readings.table["piece"][free].groupby(segment[free])]
        return readings, [
            names[rng.integers(len(names))] for names in by_segment if len(names) == PARTS_OF_SEGMENT
        ]
    readings = replace(readings, table=table.assign(piece=piece.where(free, "")))
    return readings, _set_aside(readings.table, rng)


def _set_aside(table: pd.DataFrame, rng: np.random.Generator) -> list[str]:
    names = [name for name in dict.fromkeys(table["piece"]) if name]
    most = max(2, round(SHARE_HELD * len(names)))
    for _ in range(500):
        held = [names[k] for k in sorted(rng.permutation(len(names))[:most])]
        train = table[~table["piece"].isin(held)]
        if all(set(train[k]) == set(table[k]) for k in ("branch", "place") if k in table):
            return held
    return []


def one_step(readings: Readings, candidates: Sequence[Candidate], before: Fitted, rows: np.ndarray) -> Step:
    """Return every effect that is not in a model yet added to it, by evidence on the rows (n,) of training."""
    taken = {c.name for c in before.model}
    shapes: dict[str, list[tuple[float, Candidate, Fitted]]] = {}
    for candidate in tracked(
        [c for c in candidates if c.name not in taken], "effects and their shapes fitted"
    ):
        fit = fitted(readings, combined(before.model, candidate), rows)
        shapes.setdefault(candidate.name, []).append((fit.log_evidence - before.log_evidence, candidate, fit))
    tried = {n: float(logsumexp([s[0] for s in found]) - np.log(len(found))) for n, found in shapes.items()}
    return Step(tried, {n: max(found, key=lambda s: s[0]) for n, found in shapes.items()}, before)


def chosen_steps(readings, candidates, train: np.ndarray, differs: bool) -> list[Step]:
    """Return the steps whose winners are put into the base, one after the other, and a last one without a winner.

    The first winner is the effect of most evidence; each further one must have EVIDENCE, predict what is held out better
    than its standard error explains (what does not is refused), and of those have SURE.
    """
    model = fitted(readings, (), train)
    steps: list[Step] = []
    while True:
        tried = one_step(readings, candidates, model, train)
        if steps:
            poor = [
                n
                for n, z in tried.tried.items()
                if z > EVIDENCE and not _gains(readings, model, tried.best[n][2], train)
            ]
            tried = replace(tried, refused=tuple(poor))
        eligible = {n: z for n, z in tried.tried.items() if n not in tried.refused}
        best = max(eligible, key=eligible.__getitem__, default="")
        accepted = (
            differs and best and eligible[best] > (EVIDENCE if steps else 0.0) and len(steps) < MOST_EFFECTS
        )
        if not accepted or (steps and tried.probabilities()[best] < v.SURE):
            return [*steps, tried]
        steps.append(replace(tried, winner=best))
        model = tried.best[best][2]


def on_everything(readings: Readings, candidates: Sequence[Candidate], model: Model) -> Fitted | None:
    """Return a model fitted to all readings, the shape of each effect chosen anew, one after the other; None of nothing."""
    everything, best = np.ones(len(readings.measured), dtype=bool), None
    for name in [c.name for c in model]:
        others = tuple(c for c in (best.model if best else model) if c.name != name)
        fits = [fitted(readings, combined(others, c), everything) for c in candidates if c.name == name]
        best = max(fits, key=lambda f: f.log_evidence)
    return best


def _gains(readings, before: Fitted, after: Fitted, train) -> bool:
    gain, error = held_out_gain(readings, before, after, train)
    return gain > v.HELD_OUT_ERRORS * error


def held_out_gain(
    readings: Readings, before: Fitted, after: Fitted, train: np.ndarray
) -> tuple[float, float]:
    """Return the gain in log predictive density of all that is held out, and its standard error from its units' scatter."""
    if train.all():
        return 0.0, 0.0
    d = held_out_scores(readings, after, train) - held_out_scores(readings, before, train)
    return float(d.sum()), float(d.std(ddof=1) * np.sqrt(len(d)))


def patterns(readings: Readings) -> Atoms:
    """Return where readings may differ: kinds of branch, bands of strain, tests, branches of a test; a share of the base."""
    table = readings.table
    names, kinds, columns = [], [], []

    def add(name: str, kind: str, rows) -> None:
        rows = np.asarray(rows)
        if rows.any():
            names.append(name)
            kinds.append(kind)
            columns.append(rows * readings.base)

    moving = {"load": "loading", "unload": "unloading", "hold": "holds"}
    for branch, word in moving.items():
        own = (table["branch"] == branch).to_numpy()
        add(f"all {word}", "phase", own & ~table["is_base"].to_numpy())
        for low, high in BANDS:
            band = own & table["share"].between(low, high).to_numpy()
            add(
                f"{word} between {max(low, 0):.0%} and {min(high, 1):.0%} of the range of strain",
                "depth",
                band,
            )
        late = own & (table["progress"] > 0.5).to_numpy()
        add(f"second halves of {word}", "time", late)
    for sample in dict.fromkeys(table["sample"]):
        own = (table["sample"] == sample).to_numpy()
        add(f"specimen {sample}", "session", own)
        for branch, word in moving.items():
            add(f"{word} of {sample}", "phase", own & (table["branch"] == branch).to_numpy())
    if "place" in table:
        for place in dict.fromkeys(table["place"]):
            add(f"place {place}", "position", table["place"] == place)
    one = np.abs(readings.measured).max() * (table["branch"] == "unload").to_numpy()
    if one.any():  # where the base is zero its share is nothing
        names.append("force of its own while unloading")
        kinds.append("phase")
        columns.append(one)
    return Atoms(tuple(names), tuple(kinds), tuple({} for _ in names), np.column_stack(columns))
