"""Is there a mismatch, and where: a global test, and a scan over places, depths, times and axes that pays for looking."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree
from scipy.stats import chi2 as chi2_distribution

from gelforge.mismatch.evidence.covariance import Covariance, Estimated
from gelforge.mismatch.evidence.spread import spread_out

DRAWS = 2000  # the p-value of the maximum then moves by 0.0035 at 0.025
MOST_CENTRES = 49  # of bumps: a grid of 7 x 7 resolves what bumps as wide as their spacing can show
BUMP_WIDTHS = (0.7, 1.5, 3.0)  # standard deviations, in distances of neighbouring sites
PARTS = 4  # depth bands
STEPS = 8  # parts of a session, between which the readings may step
CHUNK = 128  # columns whitened at once: 120 000 entries take 120 MB each time
NOTHING = 1e-9  # of the largest atom: an atom smaller than that is zero on these readings
SAME = 1e-8  # of the largest singular value: columns that rounding distinguishes are one
AXES = "xyz"


@dataclass(frozen=True, eq=False)
class Atoms:
    """Patterns that a mismatch might have over the n entries."""

    names: tuple[str, ...]
    kinds: tuple[str, ...]  # position, depth, time, phase, history, wave, axis, session
    regions: tuple[
        Mapping, ...
    ]  # where the pattern lives: x_mm, y_mm, radius_mm; depth_mm; time_s; axis; ...
    values: np.ndarray  # (n, m) [N]; whitened where it says so

    def whitened(self, covariance: Covariance, fitted: np.ndarray | None = None) -> Atoms:
        """Return the atoms with W values, less what the columns fitted (n, p) [N] of a model could have taken up."""
        values = np.empty_like(self.values)
        for first in range(0, values.shape[1], CHUNK):
            part = slice(first, first + CHUNK)
            values[:, part] = covariance.whiten(self.values[:, part])
        if fitted is not None:
            Q = _basis(covariance.whiten(fitted))
            values -= Q @ (Q.T @ values)
        return Atoms(self.names, self.kinds, self.regions, values)


@dataclass(frozen=True)
class Finding:
    """One atom beside the residual."""

    name: str
    kind: str
    region: Mapping
    z: float  # its normal score; with |z| the SNR at the fitted amplitude
    amplitude: float  # in units of the atom: a share of the base force, or N

    @property
    def snr(self) -> float:
        """Return sqrt(d' C^-1 d), d the atom at its fitted amplitude."""
        return abs(self.z)


@dataclass(frozen=True)
class Scan:
    """What the scan found, strongest first, and the probability of a maximum as large without any mismatch."""

    ranked: tuple[Finding, ...]
    p: float

    @property
    def best(self) -> Finding:
        """Return the strongest atom."""
        return self.ranked[0]


@dataclass(frozen=True)
class GlobalTest:
    """Sum of squares of the whitened residual against its law without any mismatch."""

    chi2: float
    degrees: int
    p: float


def global_test(residual: np.ndarray, covariance: Covariance, fitted: np.ndarray | None = None) -> GlobalTest:
    """Return the test of r' C^-1 r for residual r (n,).

    Nuisances are part of C and not fitted, so without a mismatch the sum has the chi-square law with n degrees, exactly
    for normal draws: a parametric bootstrap gives the same p. Of a model with fitted values the columns fitted (n, p)
    take their degrees with them, so that what was fitted neither helps nor harms. Of variances that were estimated the
    sum has an F law, and heavy tails widen it: a chi-square law of the same mean and variance stands for it (Satterthwaite
    1946, doi:10.2307/3002019).
    """
    white, degrees = covariance.whiten(residual), len(residual)
    if fitted is not None:
        Q = _basis(covariance.whiten(fitted))
        white, degrees = white - Q @ (Q.T @ white), degrees - Q.shape[1]
    found = float(white @ white)
    mean, variance = float(degrees), 2.0 * degrees
    if covariance.estimated is not None:
        mean, variance = _law_of_sum(covariance.estimated, degrees)
    p = chi2_distribution.sf(2 * mean * found / variance, 2 * mean**2 / variance)
    return GlobalTest(found, degrees, float(p))


def _law_of_sum(estimated: Estimated, degrees: int) -> tuple[float, float]:
    """Return mean and variance of the sum of squares of whitened draws whose variances were estimated."""
    count = np.bincount(estimated.group, minlength=len(estimated.repeats)) * degrees / len(estimated.group)
    freedom = estimated.repeats / estimated.tails
    bias = 1 / (1 - 2 / np.maximum(freedom, 4.0))
    variance = 2 * estimated.tails * count + 2 * count**2 / freedom
    return float(np.sum(count * bias)), float(np.sum(variance * bias**2))


def _basis(columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (n, rank) of columns (n, p)."""
    norms = np.linalg.norm(columns, axis=0)
    U, s, _ = np.linalg.svd(columns[:, norms > 0] / norms[norms > 0], full_matrices=False)
    return U[:, s > SAME * s.max(initial=0)]


def scan(
    residual: np.ndarray,
    atoms: Atoms,
    rng: np.random.Generator,
    draws: int = DRAWS,
    estimated: Estimated | None = None,
) -> Scan:
    """Return the scan of a whitened residual (n,) by whitened atoms, p for the maximum over all of them.

    An atom's score is z = a'r / |a|. Without a mismatch the scores are jointly normal with the atoms' cosines as
    covariance; the largest |z| of that many draws is compared, so p pays for looking everywhere. Where variances were
    estimated (from repeats), each draw has errors of theirs too.
    """
    norms = np.linalg.norm(atoms.values, axis=0)
    here = np.flatnonzero(norms > NOTHING * norms.max(initial=0))
    if not len(here):
        raise ValueError("no pattern changes these readings; give readings whose nominal forces are not zero")
    unit = atoms.values[:, here] / norms[here]
    z = unit.T @ residual
    l, E = np.linalg.eigh(unit.T @ unit)
    root = E * np.sqrt(np.maximum(l, 0))
    drawn = np.abs(root @ rng.standard_normal((len(here), draws)))
    if estimated is not None:
        drawn *= np.sqrt(_shares(unit, estimated.group) @ _variance_ratios(estimated, rng, draws))
    largest = drawn.max(axis=0)
    p = (1 + np.sum(largest >= np.abs(z).max())) / (1 + draws)
    order = np.argsort(-np.abs(z))
    ranked = tuple(
        Finding(
            atoms.names[here[k]],
            atoms.kinds[here[k]],
            atoms.regions[here[k]],
            float(z[k]),
            z[k] / norms[here[k]],
        )
        for k in order
    )
    return Scan(ranked, float(p))


def _shares(unit: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Return the share (m, G) of each unit atom (n, m) that lies on each group of entries."""
    found = np.zeros((unit.shape[1], group.max() + 1))
    for k in range(found.shape[1]):
        found[:, k] = (unit[group == k] ** 2).sum(axis=0)
    return found


def _variance_ratios(estimated: Estimated, rng: np.random.Generator, draws: int) -> np.ndarray:
    """Return draws (G, draws) of true over estimated variance."""
    ratios = np.ones((estimated.group.max() + 1, draws))
    for k, (repeats, tails) in enumerate(zip(estimated.repeats[: len(ratios)], estimated.tails)):
        if np.isfinite(repeats):
            freedom = repeats / tails
            ratios[k] = freedom / rng.chisquare(freedom, draws)
    return ratios


@dataclass(frozen=True, eq=False)
class _Profile:
    """A pattern (n,) over the readings, to be multiplied by the base force or by one newton along some axes."""

    name: str
    kind: str
    region: Mapping
    values: np.ndarray
    axes: str = "z"  # of the additive atoms


def dictionary(labels: pd.DataFrame, base: np.ndarray) -> Atoms:
    """Return the atoms of readings with these labels (n rows) and base forces (n,) [N].

    Each pattern comes relative to the base force (amplitude: a share) and as a force of its own (amplitude: N).
    """
    axis = labels["axis"].to_numpy()
    names, kinds, regions, columns = [], [], [], []

    def add(name: str, profile: _Profile, region: Mapping, values: np.ndarray) -> None:
        if np.any(values):
            names.append(name)
            kinds.append(profile.kind)
            regions.append(region)
            columns.append(values)

    for profile in _profiles(labels):
        add(f"{profile.name}, share of the force", profile, profile.region, profile.values * base)
        for k in map(AXES.index, profile.axes):
            region = {**profile.region, "axis": AXES[k]}
            add(f"{profile.name}, force along {AXES[k]}", profile, region, profile.values * (axis == k))
    return Atoms(tuple(names), tuple(kinds), tuple(regions), np.column_stack(columns))


def _profiles(labels: pd.DataFrame) -> Iterator[_Profile]:
    for family in (_axes, _bumps, _waves, _depths, _times, _phases, _histories):
        yield from family(labels)


def _axes(labels: pd.DataFrame) -> Iterator[_Profile]:
    yield _Profile("everywhere", "axis", {}, np.ones(len(labels)), AXES)
    for k in np.unique(labels["axis"]):
        values = (labels["axis"] == k).to_numpy(float)
        yield _Profile(f"everywhere along {AXES[k]}", "axis", {"axis": AXES[k]}, values, "")


def _bumps(labels: pd.DataFrame) -> Iterator[_Profile]:
    xy = labels[["x_mm", "y_mm"]].to_numpy(float)
    sites = np.unique(xy, axis=0)
    if len(sites) < 2:
        return
    spacing = float(np.median(cKDTree(sites).query(sites, k=2)[0][:, 1]))
    reach = np.hypot(*np.ptp(sites, axis=0))
    for width in (w * spacing for w in BUMP_WIDTHS):
        for x, y in sites[spread_out(sites, MOST_CENTRES)] if width < reach else ():
            values = np.exp(-((xy - (x, y)) ** 2).sum(axis=1) / (2 * width**2))
            region = {"x_mm": float(x), "y_mm": float(y), "radius_mm": float(width)}
            yield _Profile(f"near ({x:.4g}, {y:.4g}) mm within {width:.3g} mm", "position", region, values)


def _waves(labels: pd.DataFrame) -> Iterator[_Profile]:
    u, v = (_between_0_and_1(labels[name].to_numpy(float)) for name in ("x_mm", "y_mm"))
    for i, j in ((1, 0), (0, 1), (1, 1), (2, 0), (0, 2)):
        values = np.cos(np.pi * i * u) * np.cos(np.pi * j * v)
        if np.ptp(values) > 0:
            name = f"wave with {i} half waves along x and {j} along y"
            yield _Profile(name, "wave", {"half_waves": (i, j)}, values, AXES)


def _depths(labels: pd.DataFrame) -> Iterator[_Profile]:
    depth = labels["depth_mm"].to_numpy(float)
    deepest = depth.max(initial=0)
    if deepest <= 0 or np.ptp(depth) == 0:
        return
    edges = deepest * np.arange(PARTS + 1) / PARTS
    for lo, hi in zip(edges, edges[1:]):
        values = ((depth > lo) & (depth <= hi)).astype(float)
        yield _Profile(f"depths {lo:.3g} to {hi:.3g} mm", "depth", {"depth_mm": [lo, hi]}, values)
    for power in (1, 2):
        name = "growing with depth" + " squared" * (power == 2)
        yield _Profile(name, "depth", {"depth_mm": [0.0, deepest]}, (depth / deepest) ** power)


def _times(labels: pd.DataFrame) -> Iterator[_Profile]:
    sessions = labels["session"].to_numpy()
    names = list(dict.fromkeys(sessions))
    for session in names:
        here = sessions == session
        order, time = labels["order"].to_numpy(float), labels["time_s"].to_numpy(float)
        t = _between_0_and_1(order[here])
        of = f" of session {session}" if len(names) > 1 else ""
        if len(names) > 1:
            yield _Profile(f"session {session}", "session", {"session": session}, here.astype(float), AXES)
        if np.ptp(t) == 0:
            continue
        extent = {"session": session, "time_s": [float(time[here].min()), float(time[here].max())]}
        yield _Profile(f"growing over the time{of}", "time", extent, _placed(here, t - 0.5), AXES)
        for k in range(1, STEPS):
            late = t > k / STEPS
            if late.any() and not late.all():
                begin = float(time[here][late].min())
                region = {**extent, "time_s": [begin, extent["time_s"][1]]}
                yield _Profile(f"from {begin:.4g} s on{of}", "time", region, _placed(here, late), AXES)


def _phases(labels: pd.DataFrame) -> Iterator[_Profile]:
    phase = labels["phase"].to_numpy()
    for name in ("dwell", "unload"):
        here = (phase == name).astype(float)
        if 0 < here.sum() < len(here):
            yield _Profile(f"{name} against the rest", "phase", {"phase": name}, here, AXES)
    shallow = (phase == "unload") * np.exp(
        -labels["depth_mm"].to_numpy(float) / 0.2
    )  # 0.2 mm: where gels let go
    if np.ptp(shallow) > 0:
        yield _Profile("letting go", "phase", {"phase": "unload"}, shallow)


def _histories(labels: pd.DataFrame) -> Iterator[_Profile]:
    presses = labels.groupby("press", sort=False).agg(site=("site", "first"), order=("order", "min"))
    earlier = presses.sort_values("order").groupby("site").cumcount()
    if presses["order"].nunique() == 1:  # nobody stated the order
        earlier[:] = 0
    held = labels["press_time_s"].to_numpy(float)
    columns: dict[str, tuple[np.ndarray, Callable]] = {
        "growing with the indentation's time": (held, np.log1p),
        "indentations before at the same site": (labels["press"].map(earlier).to_numpy(float), np.log1p),
        "growing with age": (labels["age_days"].to_numpy(float), np.asarray),
        "growing with temperature": (labels["temperature_C"].to_numpy(float), np.asarray),
    }
    for name, (values, scaled) in columns.items():
        if np.isfinite(values).all() and np.ptp(values) > 0:
            yield _Profile(name, "history", {}, _between_0_and_1(scaled(values - values.min())))


def _placed(here: np.ndarray, values: np.ndarray) -> np.ndarray:
    found = np.zeros(len(here))
    found[here] = values
    return found


def _between_0_and_1(values: np.ndarray) -> np.ndarray:
    low, high = values.min(), values.max()
    return (values - low) / (high - low) if high > low else np.zeros(len(values))
