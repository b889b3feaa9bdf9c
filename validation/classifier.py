"""A plain classifier as a baseline: gradient boosting on averages of residuals, trained on cases of the generator itself.

It gets more than any laboratory has: hundreds of recordings of the very base, with the very forms of the effects that it
is tested on, under their names. It knows no effect that it was not shown, gives no value and corrects no force.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from .baselines import Table, table_from, table_of
from .draw import BASES, SNR, Case, cases
from .library import Library
from .score import CONFIDENT, STRONG, Judged

SEED = 801  # a development seed: no reporting set has it
NULL = "nothing"
LEAST = 0.2  # probability from which a name stands in an ambiguous answer


@dataclass(frozen=True)
class Classifier:
    """A classifier of recordings on one base."""

    library: Library
    model: object  # scikit-learn's

    def judge(self, case: Path, truth: dict) -> Judged:
        """Return what it says of a written case."""
        chance = self.model.predict_proba(features(table_of(self.library, case, truth))[None])[0]
        ranked = sorted(zip(self.model.classes_, chance), key=lambda pair: -pair[1])
        name, p = ranked[0]
        if name == NULL:
            state, answer = "consistent", ()
        elif p >= CONFIDENT:
            state, answer = "identified", (((name,), float(p)),)
        else:
            likely = [(n, q) for n, q in ranked if n != NULL and q >= LEAST]
            state, answer = "ambiguous", (((name,), float(p)), *(((n,), float(q)) for n, q in likely[1:]))
        each = tuple(float(effect["snr"]) for effect in truth["effects"])
        true = tuple(effect["name"] for effect in truth["effects"])
        return Judged(truth["content"], truth["snr"], true, state, answer, snr_each=each)


def trained(libraries: Mapping[str, Library], base: str, singles: int, least: float = STRONG) -> Classifier:
    """Return a classifier of single effects, and of nothing, on a base; least: their smallest signal-to-noise ratio."""
    from sklearn.ensemble import HistGradientBoostingClassifier

    library = libraries[BASES[base].sensor]
    numbers = {"null": max(singles // 4, 5), "single": singles}
    rows, names = [], []
    for case in cases(libraries, SEED, numbers, (base,), max(least, SNR[0])):
        rows.append(features(_table(library, case)))
        names.append(case.truth["effects"][0]["name"] if case.truth["effects"] else NULL)
    model = HistGradientBoostingClassifier(max_iter=60, min_samples_leaf=5, random_state=0)
    return Classifier(library, model.fit(np.array(rows), names))


def _table(library: Library, case: Case) -> Table:
    return table_from(library, case.truth, case.instrument, case.rows, case.readings)


def features(table: Table) -> np.ndarray:
    """Return averages (p,) of a recording's residuals in standard deviations: by ring, depth, phase; along x, y and time."""
    rows, r = table.rows, (table.measured - table.base) / table.sigma
    xy = rows[["x_mm", "y_mm"]].to_numpy()
    away = np.linalg.norm(xy, axis=1)
    out = xy / np.maximum(away, 1e-9)[:, None]
    radial, across = (r[:, :2] * out).sum(axis=1), r[:, 1] * out[:, 0] - r[:, 0] * out[:, 1]
    last = rows.groupby(["session", "order"])["dwell_s"].transform("max")
    phase = np.where(rows["dwell_s"] == last, "rest", rows["phase"])
    seen = pd.DataFrame({"x": r[:, 0], "y": r[:, 1], "z": r[:, 2], "radial": radial, "across": across})
    keys = [np.round(away, 3), rows["depth_mm"].to_numpy(), phase]
    rings, depths, phases = (sorted(set(key)) for key in keys)
    means = seen.groupby(keys).mean()
    every = pd.MultiIndex.from_product([rings, depths, phases])
    parts = [means.reindex(every).fillna(0.0).to_numpy().ravel()]  # what is not read: 0
    on = (rows["phase"] != "zero").to_numpy()
    time = rows["time_s"].to_numpy() + 1e5 * rows["session"].to_numpy()
    tests = [xy[:, 0], xy[:, 1], time, (rows["session"] > 0).to_numpy(float)]
    for which in (on, ~on):
        for test in tests:
            centred = test[which] - test[which].mean()
            parts.append(centred @ seen.to_numpy()[which] / max(np.linalg.norm(centred), 1e-9))
    sites = seen[on].groupby([xy[on, 0].round(3), xy[on, 1].round(3)]).mean()
    return np.concatenate([*parts, sites.to_numpy().ravel(), [rows["session"].max()]])
