"""Made-up tables of errors and checks, and the paper's numbers, as the report reads them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.files import write_table

PAPER_ERRORS = {
    "RMSE": {"x": 0.001, "y": 0.001, "z": 0.003},
    "RMSES": {"x": 0.007, "y": 0.006, "z": 0.016},
    "RMSET_FEM": {"x": 0.004, "y": 0.004, "z": 0.045},
    "RMSET_FT": {"x": 0.025, "y": 0.021, "z": 0.082},
}


def error_budget(optics: float = 0.004, learning: float = 0.003, mechanics: float = 0.012) -> pd.DataFrame:
    """Return parts of an error [N] of bins, those of totals ten times as large but for learning's, twenty times."""
    label, truth = np.hypot(optics, learning), np.linalg.norm([optics, learning, mechanics])
    sizes = {"optics": optics, "learning": learning, "mechanics": mechanics}
    sizes |= {"against the label": label, "against the truth": truth, "contact point": 0.001}
    columns = [f"{what}_{axis}_N" for what in ("bins", "total") for axis in "xyz"]
    factors = {name: 20 if name == "learning" else 10 for name in sizes}
    rows = [(name, *[size] * 3, *[factors[name] * size] * 3) for name, size in sizes.items()]
    table = pd.DataFrame(rows, columns=["part", *columns])
    for name, value in (("flow_px", 1.5), ("flow_off_px", 0.28), ("flow_off_mm", 0.022)):
        table[name] = np.where(table["part"] == "optics", value, np.nan)
    return table


def write_error_tables(folder: Path) -> None:
    """Write the tables of the evaluation."""
    errors = {"RMSE": 0.002, "RMSES": 0.012, "RMSES_TRAINING": 0.008, "RMSET_FEM": 0.03, "RMSET_FT": 0.04}
    rmse = pd.DataFrame(
        [(name, v, v, 3 * v) for name, v in errors.items()], columns=["error", "x_N", "y_N", "z_N"]
    )
    columns = ["session", "axis", "presses", "RMSE_GT_N", "mean_difference_N", "ft_resolution_N"]
    gt = pd.DataFrame([("all", axis, 96, 0.011, -0.01, 0.03) for axis in "xyz"], columns=columns)
    ends = [f"{axis}_{end}_N" for axis in "xyz" for end in ("min", "max")]
    bins, total = (-0.05, 0.05, -0.05, 0.05, -0.14, 0.0), (-0.1, 0.1, -0.1, 0.1, -1.46, 0.0)
    ranges = pd.DataFrame([("force per bin", *bins), ("total force", *total)], columns=["quantity", *ends])
    errors = [f"RMSES_{axis}_N" for axis in "xyz"]
    figures = ["RMSES_N", *errors, "total_Fz_rms_N", "centre_of_pressure_median_mm"]
    predictors = {"network": 0.01, "ridge": 0.03, "training mean": 0.04, "zero": 0.05}
    baselines = pd.DataFrame(
        [(n, *[e] * 4, 3 * e, 0.8) for n, e in predictors.items()], columns=["predictor", *figures]
    )
    classes = [
        ("depth", "0.5 mm", 0.01),
        ("depth", "1 mm", 0.02),
        ("place", "0 to 6.4 mm from a wall", 0.03),
    ]
    classes += [("place", "11.2 mm and more from a wall", 0.01), ("session", "day1", 0.01)]
    errors_by = pd.DataFrame(
        [(by, name, 96, *[e] * 4, 3 * e, 0.8) for by, name, e in classes],
        columns=["by", "class", "rows", *figures],
    )
    reliability = pd.DataFrame(
        [("Fz of untouched images, rms", 0.0, "N"), ("totals, z: share inside the 90 % interval", 0.91, "1")],
        columns=["quantity", "value", "unit"],
    )
    made = {
        "error_budget": error_budget(),
        "rmse": rmse,
        "rmse_gt": gt,
        "force_ranges": ranges,
        "baselines": baselines,
        "errors_by": errors_by,
        "reliability": reliability,
    }
    for name, table in made.items():
        write_table(folder / "tables", name, table)


def write_verification(folder: Path) -> None:
    """Write the table of the finite elements' checks."""
    columns = ["quantity", "source", "reference", "found", "error", "limit", "passed"]
    rows = [("Hertz: force [N]", "Hertz 1882", 1.0, 1.01, 0.01, 0.02, True)]
    rows += [("motions without force", "rigid motions", 6.0, 7.0, 1.0, 0.0, False)]
    write_table(folder / "tables", "verification", pd.DataFrame(rows, columns=columns))


def write_paper(folder: Path) -> None:
    """Write the paper's numbers that the tests need, under the names of data/paper."""
    folder.mkdir(parents=True)
    depth = np.arange(0.25, 2.01, 0.25)
    tables = []
    for location, factor in (("center", 1.0), ("corner", 1.34)):
        fem = -0.39 * factor * depth**1.6
        tables.append(
            pd.DataFrame(
                {
                    "location": location,
                    "depth_mm": depth,
                    "fem_N": fem,
                    "fem_linear_N": 0.85 * fem,
                    "ft_sensor_N": 1.02 * fem,
                }
            )
        )
    pd.concat(tables).to_csv(folder / "force_depth.csv", index=False)
    content = {
        "source": "the paper",
        "errors_N": PAPER_ERRORS,
        "force_agreement_rmse_N": {"x": 0.02, "y": 0.02, "z": 0.06},
        "ft_resolution_N": {"x": 0.03, "y": 0.03, "z": 0.06},
        "force_ranges_N": {
            "per_bin": {"x": [-0.06, 0.06], "y": [-0.06, 0.06], "z": [-0.15, 0.0]},
            "total": {"x": [-0.13, 0.13], "y": [-0.13, 0.13], "z": [-1.66, 0.0]},
        },
        "ogden": {
            "ecoflex_gel": {"mu_kPa": [7.9652, 0.3093], "alpha": [1.2769, 3.5676], "E_kPa": 16.9},
            "elastosil_25_1": {"mu_kPa": [85.1168, -0.0020], "alpha": [2.8991, -8.2915], "E_kPa": 370.2},
        },
    }
    (folder / "paper_tables.json").write_text(json.dumps(content))
