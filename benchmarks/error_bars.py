"""Coverage of the error bars: do the true errors of bins and totals lie inside two standard deviations?

The truth is a mesh of half the sizes (near and far), solved once per position and kept in results/error_bars. Positions are
drawn over the paper's grid with a fixed seed; the first CALIBRATION of them are those on which the parts in
gelforge/indentation/error_bars.py were found, and are left out of the table.

usage: python benchmarks/error_bars.py [--positions 25] [--all]     (one thread; two minutes per position, once)
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.ndimage import binary_erosion

from gelforge.cli.bench import laws_of, paper_study
from gelforge.indentation.companion import simulate_label
from gelforge.indentation.plan import PlannedCell

DEPTHS = tuple(0.25 * (k + 1) for k in range(8))
CALIBRATION = 13
KEPT = Path("results/error_bars")
SEED = 2026


def positions(count: int) -> list[tuple[float, float]]:
    """Return the centre, the corner, and positions drawn from the paper's grid area."""
    rng = np.random.default_rng(SEED)
    return [(16.0, 16.0), (27.0, 27.0)] + [
        tuple(float(v) for v in np.round(rng.uniform(5, 27, 2), 2)) for _ in range(count - 2)
    ]


def truth(number: int, x: float, y: float, study, laws) -> tuple[np.ndarray, np.ndarray]:
    """Return total (D, 3) and bins (D, B, 3) [N] of the finer mesh, solved or as kept."""
    path = KEPT / f"{number:02d}_{x:g}_{y:g}.npz"
    if not path.is_file():
        mesh = study.mechanics.mesh.coarser(1 / 2)
        mechanics = study.mechanics.model_copy(update={"mesh": mesh, "error_bars": False})
        fine = study.model_copy(update={"mechanics": mechanics})
        cell = simulate_label(fine, laws, {}, PlannedCell("truth", x, y, DEPTHS))
        KEPT.mkdir(parents=True, exist_ok=True)
        np.savez(path, total=cell.arrays["total_force_N"], bins=cell.arrays["bin_force_N"])
    with np.load(path) as kept:
        return kept["total"], kept["bins"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--positions", type=int, default=25, help="how many, the calibration's included")
    parser.add_argument("--all", action="store_true", help="do not leave the calibration's out")
    arguments = parser.parse_args()
    study = paper_study()
    laws, bins = laws_of(study, []), study.sensor.bins
    errors, sigmas, rims, totals = [], [], [], []
    for number, (x, y) in enumerate(positions(arguments.positions)):
        if number < CALIBRATION and not arguments.all:
            continue
        total, true = truth(number, x, y, study, laws)
        a = simulate_label(study, laws, {}, PlannedCell("label", x, y, DEPTHS)).arrays
        loaded = (np.abs(a["bin_force_N"]).max(axis=-1) > 0) | (np.abs(true).max(axis=-1) > 0)
        inner = [binary_erosion(d, np.ones((3, 3))) for d in loaded.reshape(-1, bins.ny, bins.nx)]
        errors.append((a["bin_force_N"] - true)[loaded])
        sigmas.append(a["bin_sigma_mesh_N"][loaded])
        rims.append(~np.reshape(inner, loaded.shape)[loaded])
        totals.append(np.stack([a["total_force_N"] - total, a["total_sigma_mesh_N"]]))
        print(f"({x:g}, {y:g}) mm: {loaded.sum()} loaded bins of {len(DEPTHS)} depths", flush=True)
    error, sigma, rim = np.concatenate(errors), np.concatenate(sigmas), np.concatenate(rims)
    rows = [
        row(f"bins, {name}", "xyz"[i], error[chosen, i], sigma[chosen, i])
        for name, chosen in (("all", rim | ~rim), ("rim", rim), ("inside", ~rim))
        for i in range(3)
    ]
    of_totals = np.concatenate(totals, axis=1)
    rows += [row("totals", "xyz"[i], of_totals[0, :, i], of_totals[1, :, i]) for i in range(3)]
    print(pd.DataFrame(rows).to_markdown(index=False))


def row(where: str, axis: str, error: np.ndarray, sigma: np.ndarray) -> dict:
    """Return one row of the table: coverage of two sigma and how wide the bars are."""
    return {
        "where": where,
        "axis": axis,
        "n": len(error),
        "inside 2 sigma [%]": round(100 * float((np.abs(error) <= 2 * sigma).mean()), 1),
        "median sigma / median error": round(float(np.median(sigma) / np.median(np.abs(error))), 2),
        "median error [mN]": round(1e3 * float(np.median(np.abs(error))), 3),
    }


if __name__ == "__main__":
    main()
