"""A small study with cells, features and readings in the formats of the stages before; no mechanics and no images."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pandas as pd

from gelforge.config import Study, study_from
from gelforge.files import write_product_table
from gelforge.hdf5 import writing
from gelforge.indentation.cells.cell_file import Cell, write_cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import plan_cells

REGIONS, DWELL = 4, 3  # features of 2 x 16; images per press at depth
FEATURES = 2 * REGIONS**2
DEPTHS = [0.5, 1.0]


def small_study(root: Path, sessions=("day1", "day2"), spacing: float = 11.0, **more) -> Study:
    """Return a study of 3 x 3 positions (spacing 11 mm) and 5 x 5 bins."""
    law = {"mu_kPa": [8.0], "alpha": [1.3]}
    return study_from(
        {
            "study": "small",
            "data": str(root / "data"),
            "materials": {"soft": {"parameters": law}},
            "sensor": {
                "layers": [{"name": "gel", "thickness_mm": 6.0, "material": "soft"}],
                "bins": {"nx": 5, "ny": 5},
            },
            "plan": {"grid": {"spacing_mm": spacing}, "depths_mm": DEPTHS},
            "sessions": list(sessions),
            "features": {"regions": REGIONS},
            **more,
        }
    )


def label(cell, depth: float) -> np.ndarray:
    """Return (25, 3) bin forces [N]: a bump around the position x_mm, y_mm."""
    x, y = (np.arange(25) % 5 + 0.5) * 6.4, (np.arange(25) // 5 + 0.5) * 6.4
    pressure = depth * np.exp(-((x - cell.x_mm) ** 2 + (y - cell.y_mm) ** 2) / 40)
    pressure[pressure < 0.05] = 0.0
    return pressure[:, None] * np.stack([(x - cell.x_mm) / 50, (y - cell.y_mm) / 50, -np.ones(25)], axis=-1)


def cell_of(planned: PlannedCell, failed: bool = False) -> Cell:
    """Return a cell; a failed one keeps its first depth."""
    depths = planned.depths_mm[:1] if failed else planned.depths_mm
    bins = np.array([label(planned, depth) for depth in depths])
    arrays = {"depth_mm": np.array(depths), "total_force_N": bins.sum(axis=1), "bin_force_N": bins}
    attributes = {
        "cell": planned.name,
        "x_mm": planned.x_mm,
        "y_mm": planned.y_mm,
        "status": "failed" if failed else "converged",
        "reason": "no equilibrium at 1 mm" if failed else "",
        "last_good_depth_mm": float(depths[-1]),
        "inputs_digest": f"digest of {planned.name}",
        "code_version": "0",
        "seconds": 1.0,
        "iterations": 3,
    }
    return Cell(arrays, attributes)


def write_cells(study: Study, folder: Path, failed=()) -> dict[str, Path]:
    paths = {name: folder / "cells" / f"{name}.h5" for name in plan_cells(study)}
    for name, planned in plan_cells(study).items():
        write_cell(paths[name], cell_of(planned, name in failed))
    return paths


def sample_table(study: Study, session: str) -> pd.DataFrame:
    """Return the rows with an image of a session: a zero image and DWELL dwell images of each press of its cells."""
    number = list(study.sessions).index(session)
    cells = [c for i, c in enumerate(plan_cells(study).values()) if i % len(study.sessions) == number]
    rows = []
    for order, (cell, depth) in enumerate((c, d) for c in cells for d in c.depths_mm):
        for index in range(DWELL + 1):
            phase = "zero" if index == 0 else "dwell"
            press = f"p{order:03d}"
            rows.append(
                (
                    session,
                    press,
                    cell.name,
                    order,
                    phase,
                    cell.x_mm,
                    cell.y_mm,
                    0.0 if index == 0 else depth,
                    f"{press}_{index}.png",
                    index,
                )
            )
    names = ["session", "press", "cell", "order", "phase", "x_mm", "y_mm", "depth_mm", "image", "image_index"]
    return pd.DataFrame(rows, columns=names)


def measured(table: pd.DataFrame) -> np.ndarray:
    """Return (N, 3) readings [N]: the label's total force, 10 % more, zero before contact."""
    return np.array([1.1 * label(row, row.depth_mm).sum(axis=0) for row in table.itertuples()])


def feature_rows(table: pd.DataFrame, width: int = FEATURES) -> np.ndarray:
    """Return (N, width) features that tell position and depth, with some noise."""
    rng = np.random.default_rng(len(table))
    k = np.arange(width // 2)
    angle = np.outer(table["x_mm"], k) / 20 + table["y_mm"].to_numpy()[:, None] / 10
    magnitude = table["depth_mm"].to_numpy()[:, None] * (1.5 + np.sin(angle)) + rng.uniform(
        0, 0.02, angle.shape
    )
    return np.concatenate([magnitude, np.angle(np.exp(1j * angle))], axis=1).astype(np.float32)


def write_features(path: Path, study: Study, table: pd.DataFrame, synthetic: bool = True, **columns) -> Path:
    """Write a feature file of a table of rows; columns replace those of the table."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with writing(path) as file:
        file.attrs["format"], file.attrs["synthetic"] = "gelforge-features-1", synthetic
        file.attrs["digest"] = f"digest of {path.stem}"
        for name in ("session", "press", "cell", "phase", "image"):
            file.create_dataset(name, data=table[name].to_numpy(object), dtype=h5py.string_dtype())
        for name in ("order", "image_index", "depth_mm"):
            file[name] = table[name].to_numpy()
        file["position_mm"] = table[["x_mm", "y_mm"]].to_numpy()
        file["force_N"] = measured(table)
        file["flow_lost"] = np.zeros(len(table), np.float32)
        file["feature"] = columns.get("feature", feature_rows(table, 2 * study.features.regions**2))
    return path


def write_all_features(study: Study, folder: Path) -> dict[str, Path]:
    return {
        session: write_features(folder / "features" / f"{session}.h5", study, sample_table(study, session))
        for session in study.sessions
    }


def write_readings(path: Path, study: Study, session: str, noise_N: float = 0.0) -> Path:
    """Write recordings/<session>.csv; an approach and an unload row stand between the samples."""
    table = sample_table(study, session)
    table[["fx_N", "fy_N", "fz_N"]] = measured(table)
    table[["fx_N", "fy_N", "fz_N"]] += np.random.default_rng(1).normal(0, noise_N, (len(table), 3))
    unload = table[table["image_index"] == DWELL].assign(
        phase="unload", depth_mm=0.3, image="", fx_N=9.0, fy_N=9.0, fz_N=9.0
    )
    table = pd.concat([table, unload]).sort_values(["order", "image_index"], kind="stable")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_product_table(path, table.drop(columns="image_index"))
    return path
