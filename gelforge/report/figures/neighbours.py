"""Neighbouring sites, whose values are pooled where each site has one depth: a single site then makes no curve."""

from __future__ import annotations

import numpy as np
import pandas as pd

# How much a figure shows, on which no result depends:
CURVE_SITES = 8  # that make a curve over depth together
MAP_SITES = 5  # whose mean stands at each place of a map


def one_depth_each(sites: pd.Series, depths_mm: pd.Series) -> bool:
    """Return whether most sites have a single depth; sites, depths_mm: a row per reading."""
    depths = depths_mm.round(3).groupby(np.asarray(sites)).nunique()
    return len(depths) > 1 and float(depths.median()) == 1


def nearest(positions_mm: np.ndarray, place_mm: np.ndarray, most: int) -> tuple[np.ndarray, float]:
    """Return which of the positions (N, 2) are nearest to a place (2,), most at most, and how far the last of them is."""
    distance = np.linalg.norm(np.asarray(positions_mm, float) - np.asarray(place_mm, float), axis=-1)
    chosen = np.argsort(distance, kind="stable")[:most]
    return chosen, float(distance[chosen].max(initial=0.0))


def pooled_means(positions_mm: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values (N, ...) averaged at each position (N, 2) over the MAP_SITES nearest ones, itself among them."""
    return np.array([values[nearest(positions_mm, at, MAP_SITES)[0]].mean(axis=0) for at in positions_mm])


def depth_classes(depths_mm: pd.Series) -> tuple[pd.Series, dict[float, str]]:
    """Return for each depth the mean depth [mm] of its class, and each class's name by it.

    Every depth is a class of its own, unless most depths have fewer than 3 rows: then 8 classes have equally many.
    """
    depth = depths_mm.astype(float).round(3)
    number = depth.value_counts()
    levels = np.sort(number.index.to_numpy())
    few = len(levels) > 8 and float(number.median()) < 3
    groups = np.array_split(levels, 8) if few else [levels[k : k + 1] for k in range(len(levels))]
    means = [float(group[0] if len(group) == 1 else depth[depth.isin(group)].mean()) for group in groups]
    mean_of = {level: mean for group, mean in zip(groups, means) for level in group}
    names = {mean_of[g[0]]: f"{g[0]:g}" if len(g) == 1 else f"{g[0]:g} to {g[-1]:g}" for g in groups}
    return depth.map(mean_of), names
