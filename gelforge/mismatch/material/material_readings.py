"""Rows of material tests with a nominal model, reduced, with every error that is no missing physics; what is held out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pandas as pd
from scipy.linalg import solve_triangular

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.inference.patterns import Atoms, Pattern
from gelforge.mismatch.model.effect import Effect, Hyperparameters, Parameter
from gelforge.mismatch.thresholds import FEW_SITES, HELD_OUT

# Of a test's largest stress: the errors of a load cell of class 0.5 (ISO 7500-1:2018), and what a digitised point is off by.
FORCE_CLASS = 5e-3
# Of each effect: the experiment on a material that decides.
DECIDED_BY = {
    "viscoelastic": "hold at one strain for a hundred times the duration of the loading, and load at a tenth of its rate",
    "mullins": "load again after a rest as long as ten loadings: damage stays, viscosity has recovered",
    "ageing": "load three specimens at either date: each one's own stiffness is then distinguished from the date",
    "temperature": "load one specimen at two temperatures, there and back",
    "adhesion": "withdraw at a tenth of the speed, and from a tenth of the push",
    "force_gain": "hang a known weight on the load cell",
    "force_offset": "read the load cell without load before and after",
    "force_drift": "read the load cell without load for as long as the test",
    "force_hysteresis": "load and unload a steel spring",
    "clock_offset": "tap once and compare the instants",
}
BRANCHES = {"load": "loading", "unload": "unloading", "hold": "holds"}


class Dense(Covariance):
    """A covariance (n, n) of some hundred entries as it is, whitened by its Cholesky factor."""

    matrix: np.ndarray

    def __init__(self, matrix: np.ndarray):
        super().__init__(np.diag(matrix))
        object.__setattr__(self, "matrix", matrix)

    def whiten(self, v: np.ndarray) -> np.ndarray:
        """Return W v for v (n,) or (n, k), where W C W' = I."""
        return solve_triangular(self._root, v, lower=True, check_finite=False)

    @property
    def log_det(self) -> float:
        """Return the logarithm of the determinant."""
        return 2 * float(np.log(np.diag(self._root)).sum())

    def errors(self, directions: np.ndarray) -> np.ndarray:
        """Return the directions (n, k) themselves: errors along them are drawn once."""
        return directions

    def restricted(self, mask: np.ndarray) -> Dense:
        """Return the covariance of some entries, by a mask (n,) bool or by numbers."""
        return Dense(self.matrix[mask][:, mask])

    @cached_property
    def _root(self) -> np.ndarray:
        return np.linalg.cholesky(self.matrix)


@dataclass(frozen=True)
class Change:
    """An effect at one choice of hyperparameters: what becomes of a prediction (n,) at values (p,); 0 is no effect."""

    name: str
    parameters: tuple[Parameter, ...]
    apply: Callable[[np.ndarray, np.ndarray], np.ndarray]
    hyperparameters: Hyperparameters = field(default_factory=dict)

    @property
    def effect(self) -> Effect:
        """Return the effect of the catalogue with the parameters of this choice."""
        return replace(CATALOGUE[self.name], parameters=self.parameters, separated_by=DECIDED_BY[self.name])

    def scaled(self, scale: float) -> Change:
        """Return the change with other plausible values."""
        return replace(self, parameters=tuple(replace(p, width=scale * p.width) for p in self.parameters))


@dataclass(frozen=True)
class Readings:
    """n reduced rows of material tests next to the nominal model, and what may change them.

    fixed and shared: the covariance of measured minus a prediction f that lacks nothing is fixed + S * outer(t, t), S the
    shared errors (of sample, law, strain: shares of the stress that is there) and t = |f / base|, 1 at most. Taken of the
    measured stress instead, they would pull every fit below the readings (Peelle's puzzle; D'Agostini 1994,
    doi:10.1016/0168-9002(94)90719-6): a smaller prediction has a smaller misfit of shape, and the size is a shared error.

    table: sample, branch (load, unload, hold), segment (number, unique), progress (0..1 along it), at (stretch, shear, or
    position in mm), share (of the base's range), time_s, is_base (fitted by the nominal model), words of each.
    """

    table: pd.DataFrame
    measured: np.ndarray  # (n,) nominal stress [MPa], or force [N]
    base: np.ndarray  # (n,)
    fixed: np.ndarray  # (n, n)
    noise: np.ndarray  # (n,) standard deviation of a row by the instrument alone
    law: np.ndarray  # (n,) standard deviation that the nominal model's parameters and misfit bring
    zero: float  # standard deviation of the zero of stress or force
    words: str  # what the nominal model is
    cannot_know: tuple[str, ...] = ()
    # (n,) bool: between plates, which cannot pull whatever the material does
    pushed: np.ndarray | None = None
    shared: np.ndarray | None = None  # (n, n); None: all errors are fixed
    changes: tuple[Change, ...] = ()

    def covariance_of(self, prediction: np.ndarray) -> Dense:
        """Return the covariance of measured minus a prediction (n,)."""
        if self.shared is None:
            return Dense(self.fixed)
        there = np.clip(np.abs(prediction) / np.maximum(np.abs(self.base), 1e-12), 0.0, 1.0)
        return Dense(self.fixed + self.shared * np.outer(there, there))

    @cached_property
    def covariance(self) -> Dense:
        """Return the covariance of measured minus base if nothing is missing."""
        return self.covariance_of(self.base)

    def changed_by(self, changes: Sequence[Change], *unseen: str) -> Readings:
        """Return the readings with what may change them, and sentences on what they cannot show."""
        return replace(self, changes=tuple(changes), cannot_know=(*self.cannot_know, *unseen))

    def with_form_error(self) -> Readings:
        """Return the readings with the error allowed for every formula, 0.05 of the mismatch: along 0.3 of one branch.

        What a formula with few values misses of what it stands for (judgement). It is the same for all sets of effects: an
        error in proportion to the change would favour what misses most.
        """
        x = self.table["progress"].to_numpy()
        near = np.exp(-np.abs(x[:, None] - x) / 0.3)  # of all scales: a formula also misses a corner
        off, sample = self.measured - self.base, self.table["sample"]
        # of each test's stress: where effects cancel, their formulas' errors do not
        squares = pd.DataFrame({"off": off**2, "measured": self.measured**2}).groupby(sample).transform("sum")
        share = np.minimum(np.sqrt(squares["off"] / squares["measured"]), 1.0).to_numpy()
        d = 0.05 * np.hypot(off, share * self.measured)
        return replace(self, fixed=self.fixed + np.outer(d, d) * near * same(self.table["segment"]))


def binned(x: np.ndarray, rows: np.ndarray, count: int, low: float | None = None) -> list[np.ndarray]:
    """Return row numbers (k,) in at most so many groups, in the order of time: equal bins of their values x (k,).

    low: where the first bin begins; at the least value where none is given.
    """
    if len(rows) <= count:
        return list(rows[:, None])
    x = x - (x.min() if low is None else low)
    number = np.minimum((count * x / max(x.max(), 1e-300)).astype(int), count - 1)
    return sorted((rows[number == k] for k in np.unique(number)), key=lambda group: group[0])


def means(groups: list[np.ndarray], values: np.ndarray) -> np.ndarray:
    """Return values (m, ...) averaged over groups of their rows (k, ...)."""
    return np.array([values[group].mean(axis=0) for group in groups])


def reduced(
    groups: list[np.ndarray], segment: Sequence[int] | np.ndarray, **values: np.ndarray
) -> pd.DataFrame:
    """Return a table of readings (k rows): values (m,) averaged over groups, their segments, and progress along these."""
    table = pd.DataFrame(
        {"segment": segment} | {name: means(groups, column) for name, column in values.items()}
    )
    by_segment = table.groupby("segment")["segment"]
    last = (by_segment.transform("size") - 1).clip(lower=1)
    return table.assign(progress=(by_segment.cumcount() / last).to_numpy())


def same(column: pd.Series) -> np.ndarray:
    """Return 1 (n, n) where two rows have the same value, else 0."""
    codes = pd.factorize(column)[0]
    return (codes[:, None] == codes).astype(float)


def misfit_covariance(share: np.ndarray, misfit: float) -> np.ndarray:
    """Return the covariance (n, n) of a law's misfit at shares (n,) of its range, which keeps its sign over 0.15 of it."""
    return misfit**2 * np.exp(-np.abs(share[:, None] - share) / 0.15)


def held_pieces(table: pd.DataFrame, rng: np.random.Generator) -> pd.Series:
    """Return the piece of each reading (n,) that is held out, a quarter of all pieces; "no" of the others.

    None of what the nominal model was fitted to. Indentations of a pair of load cells; else whole samples where there are
    enough; else whole branches; else quarters of branches. Training keeps every kind of branch and every place.
    """
    free, segment = ~table["is_base"], "branch " + table["segment"].astype(str)
    others = free & ~table["sample"].isin(table["sample"][~free])
    quarter = (4 * table["progress"]).astype(int).clip(upper=3) + 1
    choices = [
        (others, table["sample"].astype(str), FEW_SITES),
        (free, segment, 12),
        (free, segment + ", quarter " + quarter.astype(str), 0),
    ]
    if "place" in table:
        choices = [(free, table["part"].astype(str), 0)]
    rows, piece = next((rows, piece) for rows, piece, least in choices if piece[rows].nunique() >= least)
    names = pd.unique(piece[rows])
    for _ in range(500 if len(names) > 1 else 0):
        chosen = names[rng.permutation(len(names))[: max(2, round(HELD_OUT * len(names)))]]
        held = piece.where(rows & piece.isin(chosen), "no")
        if all(set(table[k][held == "no"]) == set(table[k]) for k in ("branch", "place") if k in table):
            return held
    return piece.where(False, "no")


def patterns(readings: Readings) -> Atoms:
    """Return where readings may differ: kinds of branch, bands of strain, tests, branches of a test; a share of the base."""
    table, regions = readings.table, []
    share, branch, sample = table["share"], table["branch"], table["sample"]
    for kind, word in BRANCHES.items():
        of_kind = branch == kind
        regions.append((f"all {word}", "phase", of_kind & ~table["is_base"]))
        for low, high in ((0.0, 1 / 3), (1 / 3, 2 / 3), (2 / 3, 1.1)):
            words = f"{word} between {low:.0%} and {min(high, 1):.0%} of the range of strain"
            regions.append((words, "depth", of_kind & share.between(low, high)))
        regions.append((f"second halves of {word}", "time", of_kind & (table["progress"] > 0.5)))
    for name in pd.unique(sample):
        regions.append((f"specimen {name}", "session", sample == name))
        for kind, word in BRANCHES.items():
            regions.append((f"{word} of {name}", "phase", (sample == name) & (branch == kind)))
    for place in pd.unique(table["place"]) if "place" in table else ():
        regions.append((f"place {place}", "position", table["place"] == place))
    atoms = [
        (Pattern(name, kind), rows.to_numpy() * readings.base) for name, kind, rows in regions if rows.any()
    ]
    unloading = (branch == "unload").to_numpy()
    if unloading.any():  # where the base is zero its share is nothing
        size = np.abs(readings.measured).max()
        atoms.append((Pattern("force of its own while unloading", "phase"), size * unloading))
    names, values = zip(*atoms)
    return Atoms(names, np.column_stack(values))
