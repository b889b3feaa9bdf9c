"""Shards of artificial presses (see artificial_presses), written by the dataset's own writer."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gelforge.config import Study, study_from
from gelforge.dataset.shard import writing_shard
from gelforge.dataset.splits import split_orbits


def study_of(regions: int = 40, bins: int = 20, **learning) -> Study:
    law = {"mu_kPa": [8.0], "alpha": [1.3]}
    return study_from(
        {
            "study": "artificial",
            "seed": 2,
            "materials": {"soft": {"parameters": law}},
            "sensor": {
                "layers": [{"name": "gel", "thickness_mm": 6.0, "material": "soft"}],
                "bins": {"nx": bins, "ny": bins},
            },
            "plan": {"grid": {"spacing_mm": 2.75}, "depths_mm": [1.0]},
            "features": {"regions": regions},
            "learning": learning,
        }
    )


def small_rows(cells: int = 12, presses: int = 4, seed: int = 0) -> dict[str, np.ndarray]:
    """Return rows of 2 x 16 features and 5 x 5 bins: a bump that moves and grows, the first row of a cell untouched."""
    rng = np.random.default_rng(seed)
    where = rng.uniform(0.2, 0.8, (cells, 2))
    centres = (np.arange(5) + 0.5) / 5
    rows = {
        name: []
        for name in ("feature", "label", "cell", "position", "depth", "press", "image_index", "untouched")
    }
    for c, (x, y) in enumerate(where):
        for p in range(presses):
            depth = p / (presses - 1)
            bump = depth * np.exp(-((centres[None] - x) ** 2 + (centres[:, None] - y) ** 2) / 0.05).ravel()
            bump[bump < 0.02] = 0.0
            u, v = depth * np.cos(4 * x + np.arange(16) / 3), depth * np.cos(4 * y + np.arange(16) / 2)
            noise = rng.normal(0, 0.02, (2, 16))
            rows["feature"].append(
                np.concatenate([np.hypot(u, v) + abs(noise[0]), np.arctan2(v, u) + noise[1]])
            )
            rows["label"].append(bump[:, None] * [0.2 * (x - 0.5), 0.2 * (y - 0.5), -1.0])
            for name, value in (
                ("cell", c),
                ("position", (32 * x, 32 * y)),
                ("depth", depth),
                ("press", f"p{c}_{p}"),
                ("image_index", 0),
                ("untouched", p == 0),
            ):
                rows[name].append(value)
    return {name: np.array(values) for name, values in rows.items()}


def write_shards(
    folder: Path, rows: dict[str, np.ndarray], study: Study, shards: int = 2, ft_scale: float = 1.05
) -> list[Path]:
    """Write rows, cell by cell, as the shards of a study's dataset."""
    names = [f"c{c:03d}" for c in np.unique(rows["cell"])]
    first = {name: rows["position"][rows["cell"] == int(name[1:])][0] for name in names}
    from_wall = {name: float(np.minimum(place, 32 - place).min()) for name, place in first.items()}
    split = split_orbits({n: n for n in names}, from_wall, study.dataset.test_fraction, study.seed)
    untouched = rows.get("untouched", rows["depth"] == 0)
    paths = []
    for number, chunk in enumerate(np.array_split(np.unique(rows["cell"]), shards)):
        paths.append(folder / f"shard-{number:05d}.h5")
        cells = {f"c{c:03d}": {"indenter": "ball of radius 5 mm"} for c in chunk}
        attributes = {"synthetic": True, "study": study.study, "cells": cells, "sessions": {}}
        bins = rows["label"].shape[1]
        with writing_shard(paths[-1], attributes, False, rows["feature"].shape[1], bins) as writer:
            for c in chunk:
                own = rows["cell"] == c
                name, count = f"c{c:03d}", int(own.sum())
                total = rows["label"][own].sum(axis=1)
                writer.append(
                    {
                        "feature": rows["feature"][own],
                        "force_distribution_N": rows["label"][own],
                        "force_sigma_N": np.zeros_like(rows["label"][own]),
                        "total_force_fem_N": total,
                        "total_force_fem_sigma_N": np.zeros_like(total),
                        "total_force_ft_N": ft_scale * total,
                        "position_mm": rows["position"][own],
                        "depth_mm": rows["depth"][own],
                        "phase": np.where(untouched[own], "zero", "load").astype(object),
                        "cell": np.full(count, name, object),
                        "press": rows["press"][own].astype(object),
                        "image_index": rows["image_index"][own],
                        "flow_lost": np.zeros(count, np.float32),
                        "image": np.full(count, "none.png", object),
                        "session": np.full(count, "artificial", object),
                        "split": np.full(count, split[name], object),
                        "untouched": untouched[own],
                    }
                )
    return paths
