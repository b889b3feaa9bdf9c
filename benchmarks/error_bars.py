"""Coverage of the error bars: do the true errors of bins and totals lie inside two standard deviations?

The truth is a mesh of half the sizes (near and far). Positions are drawn over the paper's grid with a fixed seed; the first
CALIBRATION of them are those on which the parts in gelforge/indentation/solving/error_bars.py were found, and are left out
of the tables. Beside the article's gel: gels whose shear moduli, friction or compressibility are far from it (GELS), at the
first four of the positions that are judged. Solutions are kept in results/error_bars: remove it after a change of the
solver.

usage: python benchmarks/error_bars.py [--positions 27] [--gels article stiff compressible] [--calibration]
       (one thread; some eight CPU minutes per position, once)
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.ndimage import binary_erosion

from gelforge.api.studies import paper_study
from gelforge.config import Study, study_from
from gelforge.config.basis.variants import merged
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.companion import simulate_label
from gelforge.laws_of_study import laws_of

DEPTHS = tuple(0.25 * (k + 1) for k in range(8))
CALIBRATION = 15  # the last two gave the parts of x and y anew, with the stiff gel at the first of the two
OF_OTHER_GELS = 4  # positions on each gel but the article's
KEPT = Path("results/error_bars")
SEED = 2026
STIFF_GEL = {
    "mu_kPa": [565.2, 21.95],
    "alpha": [1.2769, 3.5676],
}  # 71 times the article's: a modulus of 0.4 MPa
NU_049 = 2 * (1 + 0.49) / (3 * (1 - 2 * 0.49))  # K/mu
GELS = {
    "article": {},
    "stiff": {  # 0.4 MPa, friction 0.8
        "materials": {"ecoflex_gel": {"parameters": STIFF_GEL}},
        "mechanics": {"friction": 0.8},
    },
    "compressible": {"mechanics": {"bulk_to_shear": NU_049}},  # Poisson's ratio 0.49
}


def positions(count: int) -> list[tuple[float, float]]:
    """Return the centre, the corner, and positions drawn from the paper's grid area."""
    rng = np.random.default_rng(SEED)
    return [(16.0, 16.0), (27.0, 27.0)] + [
        tuple(float(v) for v in np.round(rng.uniform(5, 27, 2), 2)) for _ in range(count - 2)
    ]


def solved(name: str, x: float, y: float, study: Study) -> dict[str, np.ndarray]:
    """Return total (D, 3) and bin (D, B, 3) forces [N] of a press, and their mesh bars if any; solved or kept."""
    path = KEPT / f"{name}_{x:g}_{y:g}.npz"
    if not path.is_file():
        cell = simulate_label(study, laws_of(study, []), {}, PlannedCell(name, x, y, DEPTHS))
        if not cell.converged:
            raise SystemExit(f"{name} at ({x:g}, {y:g}) mm: {cell.attributes['reason']}")
        wanted = ("total_force_N", "bin_force_N", "total_sigma_mesh_N", "bin_sigma_mesh_N")
        KEPT.mkdir(parents=True, exist_ok=True)
        np.savez(path, **{key: cell.arrays[key] for key in wanted if key in cell.arrays})
    with np.load(path) as kept:
        return dict(kept)


def of_half_size(study: Study) -> Study:
    mesh = study.mechanics.mesh.coarser(1 / 2)
    mechanics = study.mechanics.model_copy(update={"mesh": mesh, "error_bars": False})
    return study.model_copy(update={"mechanics": mechanics})


def coverage(gel: str, places: list[tuple[float, float]]) -> pd.DataFrame:
    """Return the table of one gel: coverage and width of bars, of bins and totals, over some places (x, y) [mm]."""
    study = study_from(merged(paper_study().model_dump(mode="json"), GELS[gel]))
    bins = study.sensor.bins
    errors, sigmas, rims, totals = [], [], [], []
    for x, y in places:
        true, label = solved(f"{gel}_half", x, y, of_half_size(study)), solved(gel, x, y, study)
        force = label["bin_force_N"]
        loaded = (np.abs(force).max(axis=-1) > 0) | (np.abs(true["bin_force_N"]).max(axis=-1) > 0)
        inner = [binary_erosion(d, np.ones((3, 3))) for d in loaded.reshape(-1, bins.ny, bins.nx)]
        errors.append((force - true["bin_force_N"])[loaded])
        sigmas.append(label["bin_sigma_mesh_N"][loaded])
        rims.append(~np.reshape(inner, loaded.shape)[loaded])
        difference = label["total_force_N"] - true["total_force_N"]
        totals.append(np.stack([difference, label["total_sigma_mesh_N"]]))
        print(f"{gel} ({x:g}, {y:g}) mm: {loaded.sum()} loaded bins of {len(DEPTHS)} depths", flush=True)
    error, sigma, rim = np.concatenate(errors), np.concatenate(sigmas), np.concatenate(rims)
    rows = [
        row(f"bins, {name}", "xyz"[i], error[chosen, i], sigma[chosen, i])
        for name, chosen in (("all", rim | ~rim), ("rim", rim), ("inside", ~rim))
        for i in range(3)
    ]
    of_totals = np.concatenate(totals, axis=1)
    rows += [row("totals", "xyz"[i], of_totals[0, :, i], of_totals[1, :, i]) for i in range(3)]
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--positions", type=int, default=27, help="how many, the calibration's included")
    parser.add_argument("--gels", nargs="+", choices=GELS, default=list(GELS))
    parser.add_argument("--calibration", action="store_true", help="the calibration's positions instead")
    arguments = parser.parse_args()
    drawn = positions(arguments.positions)
    judged = drawn[:CALIBRATION] if arguments.calibration else drawn[CALIBRATION:]
    for gel in arguments.gels:
        table = coverage(gel, judged if gel == "article" else judged[:OF_OTHER_GELS])
        print(f"\n{gel}:\n\n{table.to_markdown(index=False)}\n", flush=True)


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
