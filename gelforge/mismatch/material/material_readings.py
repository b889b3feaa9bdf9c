"""Stress tests beside the law of their fastest loading branch: rows reduced, and every error that is no missing physics.

The law is fitted to one loading of one sample. What another branch may differ by without any missing physics: the
instrument, the zero of force and of strain, the law's own misfit and covariance, and that samples made alike differ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.covariates.circumstances import CIRCUMSTANCES, alike_groups
from gelforge.materials.covariates.effects import NEGLIGIBLE, Scatter, scatter_between
from gelforge.materials.fitting.curves import mean_curves, monotonic_loading
from gelforge.materials.plausibility.findings import STRAIN_AT_START
from gelforge.mismatch.material.material_evidence import Readings
from gelforge.mismatch.material.material_law import BaseLaw, base_law

KINDS = ("uniaxial", "compression", "pure_shear", "equibiaxial", "simple_shear")  # one stress for one stretch
MOST_ROWS = 600  # in all; the covariance is dense
ROWS_OF_BRANCH = (4, 24)
LARGEST_PATH = 3000  # rows of one test that the hereditary integral walks along
FORCE_CLASS = (
    5e-3  # of a test's largest stress: an ordinary load cell's class, and what a digitised point is off by
)
ZERO_STRAIN = STRAIN_AT_START  # slack that a test may begin with
SAMPLE_SCATTER = Scatter(
    NEGLIGIBLE, 2
)  # of samples of one sheet, weighed as two repeats beside those measured
LAW_LENGTH = 0.15  # of the range of strain, over which a law's misfit keeps its sign
BEYOND = 1.1  # of the range that the law was fitted in: what lies farther is not judged


@dataclass(frozen=True)
class Path:
    """One test along its time: m rows up to where it leaves the range of the law, and which rows make a reading."""

    test: MaterialTest
    time_s: np.ndarray  # (m,)
    stress: np.ndarray  # (m,) [MPa] of the base law
    strain: np.ndarray  # (m,) distance from rest, positive
    groups: tuple[np.ndarray, ...]  # rows averaged into one reading each
    time_from: str  # "columns", or "rate"
    started_s: float  # when it left rest

    def reduced(self, values: np.ndarray) -> np.ndarray:
        """Return values (m, ...) averaged into readings (k, ...)."""
        return np.array([values[g].mean(axis=0) for g in self.groups])


@dataclass(frozen=True)
class StressTests:
    """The readings of one material's stress tests, and what its candidates need to know of their histories."""

    readings: Readings
    paths: tuple[Path, ...]
    laws: dict[str, BaseLaw]  # by kind of test
    base_tests: dict[str, MaterialTest]  # whose fastest loading each law is fitted to
    base_words: str
    sample_scatter: float


def stress_tests(tests: list[MaterialTest]) -> StressTests:
    """Return the readings of stress tests beside their base laws; raises ValueError (FitError) where there is none."""
    usable = [t for t in tests if t.test in KINDS and t.cauchy_difference is None]
    said = [f"{t.sample}: tests of kind {t.test} are not judged" for t in tests if t.test not in KINDS]
    timed = [t for t in usable if t.time_s is not None or t.rate_per_s]
    said += [
        f"{t.sample}: neither time nor rate is stated, so it is not known where it belongs; left out"
        for t in usable
        if t not in timed
    ]
    bases, laws = {}, {}
    for kind in dict.fromkeys(t.test for t in timed):
        own = [t for t in timed if t.test == kind]
        loading = fastest_loading(own)
        if loading is None:
            said.append(f"{kind}: no loading to fit a constitutive model to; not judged")
            continue
        curves = mean_curves(monotonic_loading([loading])[0])
        bases[kind], laws[kind] = loading, base_law(curves, kind)
    if not laws:
        raise ValueError(
            f"{'; '.join(said) or 'no stress test'}: a nominal model needs a loading with a time or a rate"
        )
    paths = _paths([t for t in timed if t.test in laws], laws, bases)
    said += _assumed(paths)
    table = pd.concat([_rows(number, p, bases) for number, p in enumerate(paths)], ignore_index=True)
    measured = np.concatenate(
        [p.reduced(p.test.nominal_stress[: len(p.time_s)] * _away(p.test)) for p in paths]
    )
    base = np.concatenate([p.reduced(p.stress) for p in paths])
    table["segment"] = pd.factorize(table["sample"] + "/" + table["part"].astype(str))[0]
    scatter = _scatter(timed)
    C, shared, noise, law = _covariance(table, measured, base, paths, laws, bases, scatter)
    zero = FORCE_CLASS * float(np.abs(measured).max())
    pushed = (table["test"] == "compression").to_numpy()
    readings = Readings(table, measured, base, C, noise, law, zero, tuple(said), pushed, shared)
    return StressTests(readings, tuple(paths), laws, bases, _words(bases, laws), scatter)


def fastest_loading(tests: list[MaterialTest]) -> MaterialTest | None:
    """Return the test whose loading was the fastest; of rates alike the least treated, youngest, farthest strained."""
    loading = [
        t
        for t in tests
        if t.rate_per_s and t.cycle in (None, 1) and any(s.kind == "load" for s in t.segments)
    ]
    loading = [t for t in loading if len(monotonic_loading([t])[0])]
    if not loading:
        return None
    rates = [float(t.rate_per_s or 0.0) for t in loading]
    alike = [t for t, rate in zip(loading, rates) if np.log10(max(rates) / rate) <= CIRCUMSTANCES[0].alike]
    return min(
        alike,
        key=lambda t: (t.dose or 0.0, t.age_days or 0.0, -np.abs(t.stretch - t.at_rest).max(), t.sample),
    )


def _away(test: MaterialTest) -> float:
    """Return the sign of the strain: stress and strain are positive in what follows, in compression too."""
    return float(np.sign(test.stretch[np.argmax(np.abs(test.stretch - test.at_rest))] - test.at_rest)) or 1.0


def _range(law: BaseLaw, test: MaterialTest) -> float:
    return float(max(abs(end - test.at_rest) for end in law.valid))


def _paths(tests, laws, bases) -> list[Path]:
    kept = []
    for test in tests:
        away, reach = _away(test), _range(laws[test.test], test)
        strain = away * (test.stretch - test.at_rest)
        inside = (strain <= BEYOND * reach) & np.isfinite(test.nominal_stress)
        m = len(inside) if inside.all() else int(np.argmin(inside))
        if m >= 2 and away == _away(bases[test.test]):
            kept.append((test, m))
    segments = sum(sum(s.start < m - 1 for s in t.segments) for t, m in kept)
    count = int(np.clip(MOST_ROWS // max(segments, 1), *ROWS_OF_BRANCH))
    return [_path(t, m, laws[t.test], count) for t, m in kept]


def _path(test: MaterialTest, m: int, law: BaseLaw, count: int) -> Path:
    away = _away(test)
    strain = away * (test.stretch[:m] - test.at_rest)
    if test.time_s is not None:
        time, origin = np.asarray(test.time_s[:m], dtype=float), "columns"
    else:
        time, origin = np.r_[0, np.cumsum(np.abs(np.diff(strain)))] / test.rate_per_s, "rate"
    held = test.history == "relaxation" and test.segments and test.segments[0].kind == "hold"
    before = 0.0 if held or not test.rate_per_s else max(strain[0], 0.0) / test.rate_per_s
    started = min(0.0, time[0]) if held else time[0] - before
    groups = [g for s in test.segments for g in _groups(s, strain, time, m, count)]
    stress = away * law.stress(test.stretch[:m])[0]
    return Path(test, time, stress, strain, tuple(groups), origin, float(started))


def _groups(segment, strain, time, m, count) -> list[np.ndarray]:
    """Return the rows of one branch in bins: equal in strain, or equal in log time of a hold."""
    rows = np.arange(segment.start, min(segment.stop, m))
    if len(rows) < 2:
        return []
    if segment.kind == "hold":
        since = time[rows] - time[rows[0]]
        x = np.log(np.maximum(since, since[since > 0].min(initial=since[-1] + 1e-9)))
    else:
        x = strain[rows]
    if len(rows) <= count:
        return [rows[i : i + 1] for i in range(len(rows))]
    number = np.minimum((count * (x - x.min()) / max(np.ptp(x), 1e-300)).astype(int), count - 1)
    return sorted((rows[number == k] for k in np.unique(number)), key=lambda g: g[0])


def _rows(number: int, path: Path, bases) -> pd.DataFrame:
    test = path.test
    first_unload = next((k for k, s in enumerate(test.segments) if s.kind == "unload"), len(test.segments))
    of_row = [
        next(k for k, s in enumerate(test.segments) if s.start <= g[0] < s.stop and g[-1] < s.stop)
        for g in path.groups
    ]
    reach = float(np.abs(bases[test.test].stretch - bases[test.test].at_rest).max())
    columns = {
        "path": number,
        "test": test.test,
        "sample": test.sample,
        "part": of_row,
        "branch": [test.segments[k].kind for k in of_row],
        "at": path.reduced(test.stretch[: len(path.time_s)]),
        "share": path.reduced(path.strain) / reach,
        "time_s": path.reduced(path.time_s),
        "rate": test.rate_per_s or np.nan,
        "is_base": [
            test is bases[test.test] and test.segments[k].kind == "load" and k < first_unload for k in of_row
        ],
    }
    table = pd.DataFrame(columns)
    by_part = table.groupby("part").cumcount()
    sizes = table.groupby("part")["part"].transform("size")
    return table.assign(progress=(by_part / (sizes - 1).clip(lower=1)).to_numpy())


def _assumed(paths: list[Path]) -> list[str]:
    by_rate = [p.test.sample for p in paths if p.time_from == "rate"]
    cut = [p.test.sample for p in paths if len(p.time_s) < len(p.test.stretch)]
    said = []
    if by_rate:
        said.append(
            f"{', '.join(by_rate)}: no time is recorded; unloading is taken to have gone at the stated rate of loading, and"
            " holds between them cannot be seen"
        )
    if cut:
        said.append(
            f"{', '.join(cut)}: not judged from where the strain leaves the range in which the nominal model was fitted"
        )
    return said


def _scatter(tests: list[MaterialTest]) -> float:
    """Return the standard deviation of a sample's factor: repeats where there are some, shrunk to what sheets scatter by."""
    own = SAMPLE_SCATTER
    groups = [
        g for g in alike_groups([t for t in tests if any(s.kind == "load" for s in t.segments)]) if len(g) > 1
    ]
    try:
        found = scatter_between(groups)
    except ValueError:
        return own.deviation
    freedom = found.freedom + own.freedom
    return float(np.sqrt((found.freedom * found.deviation**2 + own.freedom * own.deviation**2) / freedom))


def row_noise(values: np.ndarray) -> float:
    """Return the standard deviation of one row about the line through its neighbours (robust), 0 for few rows."""
    if len(values) < 5:
        return 0.0
    return float(1.4826 * np.median(np.abs(values[1:-1] - (values[:-2] + values[2:]) / 2)) / np.sqrt(1.5))


def _covariance(table, measured, base, paths, laws, bases, scatter):
    """Return what a prediction's errors are of: C (n, n) whatever it is, S (n, n) of one equal to the base (see Readings).

    And the instrument's standard deviation (n,) and the law's (n,).
    """
    n, number = len(table), table["path"].to_numpy()
    largest = np.array([np.abs(measured[number == k]).max() for k in range(len(paths))])
    count = np.concatenate([[len(g) for g in p.groups] for p in paths])
    rows = np.array([row_noise(p.test.nominal_stress[: len(p.time_s)]) for p in paths])
    noise = np.hypot(rows[number] / np.sqrt(count), FORCE_CLASS * largest[number])
    C = np.diag(noise**2) + (FORCE_CLASS * largest[number]) ** 2 * (number[:, None] == number)
    # errors of a sample, of its strain and of the law are shares of the stress that is there, however much of it relaxed
    slope = np.concatenate([p.reduced(_slope(p, laws[p.test.test])) for p in paths])
    S = ZERO_STRAIN**2 * np.outer(slope, slope) * (number[:, None] == number)
    law = np.zeros((n, n))
    for kind, fitted in laws.items():
        here = (table["test"] == kind).to_numpy()
        law[np.ix_(here, here)] = _law_error(table[here], measured[here] - base[here], fitted)
    sample, share = pd.factorize(table["sample"])[0], table["share"].to_numpy()
    other = ~table["sample"].isin([t.sample for t in bases.values()]).to_numpy()
    together = np.outer(other, other) * (
        (sample[:, None] == sample) + 1.0
    )  # both samples are drawn: other and base
    for pattern, size in ((base, scatter), (base * (2 * share - 1), scatter / 2)):
        S += size**2 * np.outer(pattern, pattern) * together
    return C, S + law, noise, np.sqrt(np.diag(law))


def _slope(path: Path, law: BaseLaw) -> np.ndarray:
    """Return d stress / d strain (m,) of the law [MPa]."""
    step, test = 1e-4, path.test
    lam = test.stretch[: len(path.time_s)]
    away = _away(test)
    return away * (law.stress(lam)[0] - law.stress(lam - away * step)[0]) / step


def _law_error(table: pd.DataFrame, residual: np.ndarray, law: BaseLaw) -> np.ndarray:
    """Return the covariance of the law: its parameters, and its misfit on its own branch, smooth over the strain."""
    inside = np.clip(
        table["at"].to_numpy(), *law.valid
    )  # beyond it the polynomial's errors are not the law's
    J = law.stress(inside)[1]
    share = table["share"].to_numpy()
    misfit = float(np.sqrt(np.mean(residual[table["is_base"].to_numpy()] ** 2)))
    kernel = np.exp(-np.abs(share[:, None] - share) / LAW_LENGTH)
    return J @ law.covariance @ J.T + misfit**2 * kernel


def _words(bases: dict[str, MaterialTest], laws: dict[str, BaseLaw]) -> str:
    return " and ".join(
        f"{laws[kind].title} fitted to the loading of specimen {t.sample} ({kind.replace('_', ' ')}) at"
        f" {t.rate_per_s:.3g} 1/s"
        for kind, t in bases.items()
    )
