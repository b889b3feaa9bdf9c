"""Error bars of totals where the errors of near and far size may cancel: a small sensor on meshes of several proportions.

usage: python benchmarks/total_bars.py      (one thread; minutes)

Each press of three places and three depths beside a mesh of half its sizes. Prints a Markdown table: the error of Fz, and
the largest error over the bar, of the total's own difference to its companion alone and with the part of the bins' bars.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

from gelforge.api.studies import paper_study  # noqa: E402
from gelforge.config import Study, study_from  # noqa: E402
from gelforge.config.basis.variants import merged  # noqa: E402
from gelforge.indentation.paths.planned_cell import PlannedCell  # noqa: E402
from gelforge.indentation.solving.companion import simulate_label  # noqa: E402
from gelforge.indentation.solving.error_bars import PART_OF_BINS  # noqa: E402
from gelforge.laws_of_study import laws_of  # noqa: E402

DEPTHS = (0.2, 0.4, 0.6)
PLACES = ((4.8, 4.8), (5.5, 3.1), (8.9, 2.3))  # mm
SIZES = ((0.3, 0.6), (0.3, 1.2), (0.4, 0.8), (0.4, 1.6), (0.5, 1.0), (0.6, 0.6))  # near and far size [mm]
SMALL = {"width_x_mm": 11.2, "width_y_mm": 9.6, "wall_mm": 0.0, "bins": {"nx": 14, "ny": 12}}


def small_study(near: float, far: float, error_bars: bool) -> Study:
    """Return the article's study on a small sensor without wall, its layers 4.8 and 1.6 mm high."""
    whole = paper_study().model_dump(mode="json")
    gel, skin = whole["sensor"]["layers"][0], whole["sensor"]["layers"][-1]
    layers = [gel | {"thickness_mm": 4.8}, skin | {"thickness_mm": 1.6}]
    changes = {
        "sensor": SMALL | {"layers": layers},
        "plan": {"grid": {"margin_mm": 2.0}, "symmetry": "none"},
        "mechanics": {
            "mesh": {"near_mm": near, "far_mm": far, "near_radius_mm": 2.4},
            "error_bars": error_bars,
        },
    }
    return study_from(merged(whole, changes))


def press(near: float, far: float, place: tuple[float, float], error_bars: bool) -> dict[str, np.ndarray]:
    study = small_study(near, far, error_bars)
    cell = simulate_label(study, laws_of(study, []), {}, PlannedCell("press", *place, DEPTHS))
    if not cell.converged:
        raise SystemExit(f"near {near} mm, far {far} mm at {place} mm: {cell.attributes['reason']}")
    return cell.arrays


def main() -> None:
    rows, inside = [], {"own difference": [], "with bins": []}
    for near, far in SIZES:
        errors, own, both = [], [], []
        for place in PLACES:
            found, finer = press(near, far, place, True), press(near / 2, far / 2, place, False)
            error = np.abs(found["total_force_N"] - finer["total_force_N"])
            bar = found["total_sigma_mesh_N"]
            bins = PART_OF_BINS * np.sqrt((found["bin_sigma_mesh_N"] ** 2).sum(axis=1))
            errors.append(100 * error[:, 2] / np.abs(finer["total_force_N"][:, 2]))
            own.append(error / np.sqrt(bar**2 - bins**2))
            both.append(error / bar)
        inside["own difference"].append(own)
        inside["with bins"].append(both)
        rows.append(
            {
                "near, far [mm]": f"{near:g}, {far:g}",
                "error of Fz, median [%]": f"{np.median(errors):.2f}",
                "largest [%]": f"{np.max(errors):.2f}",
                "largest error over the own difference's bar, x y z": _by_axis(own),
                "over the bar with bins": _by_axis(both),
            }
        )
    print(pd.DataFrame(rows).to_markdown(index=False, disable_numparse=True))
    for name, ratios in inside.items():
        print(
            f"\ninside two sigma, {name}: {100 * np.mean(np.array(ratios) <= 2):.1f} % of {np.size(ratios)}"
        )


def _by_axis(ratios: list[np.ndarray]) -> str:
    return ", ".join(f"{value:.1f}" for value in np.max(ratios, axis=(0, 1)))


if __name__ == "__main__":
    main()
