"""Patterns that a mismatch may have over places, depths, times, phases and axes, of the forces and of the images' flow."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from gelforge.mismatch.readings.observations import spread_out

AXES = "xyz"
FLOW = {
    "force along x": "flow along u",
    "force along y": "flow along v",
    "share of the force": "share of the flow",
}


@dataclass(frozen=True)
class Pattern:
    """A pattern over the readings in words, and its score once it was looked for."""

    name: str
    kind: str  # position, depth, time, phase, history, wave, axis, session
    region: Mapping = field(default_factory=dict)  # x_mm, y_mm, radius_mm; depth_mm; time_s; axis; ...
    z: float = 0.0  # normal score; |z| is the SNR sqrt(d' C^-1 d) at the fitted size d

    @property
    def snr(self) -> float:
        """Return the signal over noise."""
        return abs(self.z)


@dataclass(frozen=True, eq=False)
class Atoms:
    """Patterns with their values (n, m) [N] over the n entries; whitened where it says so."""

    patterns: tuple[Pattern, ...]
    values: np.ndarray


# A pattern, its values (n,), and the axes along which it may be a force of its own.
Profile = tuple[Pattern, np.ndarray, str]


def dictionary(labels: pd.DataFrame, base: np.ndarray) -> Atoms:
    """Return the atoms of readings with these labels (n rows) and base (n,), channel by channel where they name one.

    Each pattern comes relative to the base, and as a force (or flow) of its own.
    """
    atoms, channel = [], labels["channel"] if "channel" in labels else np.full(len(labels), "force")
    for name, rows in labels.groupby(np.asarray(channel), sort=False).indices.items():
        for pattern, values in _atoms(labels.iloc[rows].reset_index(drop=True), base[rows]):
            if np.any(values):
                column = np.zeros(len(labels))
                column[rows] = values
                atoms.append((pattern if name == "force" else _of_flow(pattern), column))
    patterns, columns = zip(*atoms)
    return Atoms(patterns, np.column_stack(columns))


def _atoms(labels: pd.DataFrame, base: np.ndarray) -> Iterator[tuple[Pattern, np.ndarray]]:
    axis = labels["axis"].to_numpy()
    for family in (_axes, _bumps, _waves, _depths, _times, _phases, _histories):
        for pattern, values, axes in family(labels):
            yield replace(pattern, name=f"{pattern.name}, share of the force"), values * base
            for k in map(AXES.index, axes):
                region = {**pattern.region, "axis": AXES[k]}
                name = f"{pattern.name}, force along {AXES[k]}"
                yield replace(pattern, name=name, region=region), values * (axis == k)


def _of_flow(pattern: Pattern) -> Pattern:
    region = {key: value for key, value in pattern.region.items() if key != "axis"} | {"channel": "flow"}
    name = pattern.name
    for force, flow in FLOW.items():
        name = name.replace(force, flow)
    return replace(pattern, name=f"the images: {name}", region=region)


def _axes(labels: pd.DataFrame) -> Iterator[Profile]:
    yield Pattern("everywhere", "axis"), np.ones(len(labels)), AXES
    for k in np.unique(labels["axis"]):
        values = (labels["axis"] == k).to_numpy(float)
        yield Pattern(f"everywhere along {AXES[k]}", "axis", {"axis": AXES[k]}), values, ""


def _bumps(labels: pd.DataFrame) -> Iterator[Profile]:
    xy = labels[["x_mm", "y_mm"]].to_numpy(float)
    sites = np.unique(xy, axis=0)
    if len(sites) < 2:
        return
    spacing = float(np.median(cKDTree(sites).query(sites, k=2)[0][:, 1]))
    reach = np.hypot(*np.ptp(sites, axis=0))
    for width in (0.7 * spacing, 1.5 * spacing, 3.0 * spacing):  # standard deviations
        # 7 x 7 centres resolve what bumps as wide as their spacing can show
        for x, y in sites[spread_out(sites, 49)] if width < reach else ():
            values = np.exp(-((xy - (x, y)) ** 2).sum(axis=1) / (2 * width**2))
            region = {"x_mm": float(x), "y_mm": float(y), "radius_mm": float(width)}
            yield (
                Pattern(f"near ({x:.4g}, {y:.4g}) mm within {width:.3g} mm", "position", region),
                values,
                "z",
            )


def _waves(labels: pd.DataFrame) -> Iterator[Profile]:
    u, v = (_between_0_and_1(labels[name].to_numpy(float)) for name in ("x_mm", "y_mm"))
    for i, j in ((1, 0), (0, 1), (1, 1), (2, 0), (0, 2)):
        values = np.cos(np.pi * i * u) * np.cos(np.pi * j * v)
        if np.ptp(values) > 0:
            yield Pattern(f"wave with {i} half waves along x and {j} along y", "wave"), values, AXES


def _depths(labels: pd.DataFrame, bands: int = 4) -> Iterator[Profile]:
    depth = labels["depth_mm"].to_numpy(float)
    deepest = depth.max(initial=0)
    if deepest <= 0 or np.ptp(depth) == 0:
        return
    edges = deepest * np.arange(bands + 1) / bands
    for lo, hi in zip(edges, edges[1:]):
        values = ((depth > lo) & (depth <= hi)).astype(float)
        yield Pattern(f"depths {lo:.3g} to {hi:.3g} mm", "depth", {"depth_mm": [lo, hi]}), values, "z"
    for power, name in enumerate(("growing with depth", "growing with depth squared"), start=1):
        yield Pattern(name, "depth", {"depth_mm": [0.0, deepest]}), (depth / deepest) ** power, "z"


def _times(labels: pd.DataFrame, parts: int = 8) -> Iterator[Profile]:
    sessions = labels["session"].to_numpy()
    names = list(dict.fromkeys(sessions))
    for session in names:
        here = sessions == session
        order, time = labels["order"].to_numpy(float), labels["time_s"].to_numpy(float)
        t = _between_0_and_1(order[here])
        of = f" of session {session}" if len(names) > 1 else ""
        if len(names) > 1:
            yield Pattern(f"session {session}", "session", {"session": session}), here.astype(float), AXES
        if np.ptp(t) == 0:
            continue
        begin, end = float(time[here].min()), float(time[here].max())
        extent = {"session": session, "time_s": [begin, end]}
        yield Pattern(f"growing over the time{of}", "time", extent), _placed(here, t - 0.5), AXES
        for k in range(1, parts):
            late = t > k / parts
            if late.any() and not late.all():
                begin = float(time[here][late].min())
                region = {**extent, "time_s": [begin, end]}
                yield Pattern(f"from {begin:.4g} s on{of}", "time", region), _placed(here, late), AXES


def _phases(labels: pd.DataFrame) -> Iterator[Profile]:
    phase = labels["phase"].to_numpy()
    for name in ("dwell", "unload"):
        here = (phase == name).astype(float)
        if 0 < here.sum() < len(here):
            yield Pattern(f"{name} against the rest", "phase", {"phase": name}), here, AXES
    shallow = (phase == "unload") * np.exp(-labels["depth_mm"].to_numpy(float) / 0.2)  # mm, where gels let go
    if np.ptp(shallow) > 0:
        yield Pattern("letting go", "phase", {"phase": "unload"}), shallow, "z"


def _histories(labels: pd.DataFrame) -> Iterator[Profile]:
    presses = labels.groupby("press", sort=False).agg(site=("site", "first"), order=("order", "min"))
    earlier = presses.sort_values("order").groupby("site").cumcount()
    if presses["order"].nunique() == 1:  # nobody stated the order
        earlier[:] = 0
    columns: dict[str, tuple[pd.Series, Callable]] = {
        "growing with the indentation's time": (labels["press_time_s"], np.log1p),
        "indentations before at the same site": (labels["press"].map(earlier), np.log1p),
        "growing with age": (labels["age_days"], np.asarray),
        "growing with temperature": (labels["temperature_C"], np.asarray),
    }
    for name, (column, scaled) in columns.items():
        values = column.to_numpy(float)
        if np.isfinite(values).all() and np.ptp(values) > 0:
            yield Pattern(name, "history"), _between_0_and_1(scaled(values - values.min())), "z"


def _placed(here: np.ndarray, values: np.ndarray) -> np.ndarray:
    everywhere = np.zeros(len(here))
    everywhere[here] = values
    return everywhere


def _between_0_and_1(values: np.ndarray) -> np.ndarray:
    low, high = values.min(), values.max()
    return (values - low) / (high - low) if high > low else np.zeros(len(values))
