"""FEATS's four readings of a GelSight Mini beside simulations: what friction, compressibility and stiffness make of them.

usage: python benchmarks/real_data.py [--figure docs/figures/gelsight_mini.png]      (one thread; a minute)

Nothing is fitted and no depth is moved: a row is what a set of assumptions predicts at the depths read.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import matplotlib  # noqa: E402  (threads are set before the libraries start theirs)

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

from gelforge.config import load_study, study_from  # noqa: E402
from gelforge.config.basis.variants import merged  # noqa: E402
from gelforge.indentation.planning.plan import plan_cells  # noqa: E402
from gelforge.indentation.solving.companion import simulate_label  # noqa: E402
from gelforge.laws_of_study import laws_of  # noqa: E402
from gelforge.progress import Progress, show  # noqa: E402

STUDY = Path("config/gelsight_mini.yaml")
READINGS = Path("data/gelsight_mini/feats/indentations.csv")
# friction [-], bulk over shear modulus [-], shear modulus over that of FEATS [-]
ASSUMED = [
    (0.0, 1000, 1.0),
    (0.2, 1000, 1.0),
    (0.5, 1000, 1.0),
    (1.0, 1000, 1.0),
    (0.5, 20, 1.0),
    (1.0, 20, 1.0),
]
ASSUMED += [(0.0, 1000, 0.9), (0.0, 1000, 1.1)]


def predicted(friction: float, bulk: float, stiffness: float) -> tuple[np.ndarray, np.ndarray]:
    """Return -Fz (D,) [N] of the study's press under some assumptions, and its error bar (D,)."""
    study = load_study(STUDY)
    known = study.model_dump(mode="json")
    gel = known["materials"]["gelsight_gel"]["parameters"]
    changes = {
        "mechanics": {"friction": friction, "bulk_to_shear": bulk},
        "materials": {
            "gelsight_gel": {
                "parameters": {"mu_kPa": [stiffness * mu for mu in gel["mu_kPa"]], "alpha": gel["alpha"]}
            }
        },
    }
    study = study_from(merged(known, changes))
    (planned,) = plan_cells(study).values()
    cell = simulate_label(study, laws_of(study, []), {}, planned)
    if not cell.converged:
        raise SystemExit(f"friction {friction:g}, bulk over shear {bulk:g}: {cell.attributes['reason']}")
    return -cell.arrays["total_force_N"][:, 2], cell.arrays["total_sigma_mesh_N"][:, 2]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--figure", type=Path, help="PNG to write")
    options = parser.parse_args()
    read = pd.read_csv(READINGS)
    read = read[read["phase"] == "load"]
    rows = []
    show()
    with Progress("presses", len(ASSUMED)) as progress:
        for friction, bulk, stiffness in ASSUMED:
            force, bar = predicted(friction, bulk, stiffness)
            rows.append((friction, bulk, stiffness, force, bar))
            progress.advance()
    depths = read["depth_mm"].to_numpy()
    table = [["read", "", "", *(f"{-f:.2f}" for f in read["fz_N"])]]
    table += [
        [f"{m:g}", f"{k:g}", f"{s:g}", *(f"{f:.2f} ± {b:.2f}" for f, b in zip(force, bar))]
        for m, k, s, force, bar in rows
    ]
    names = ["friction", "K over mu", "mu over FEATS's", *(f"{d:g} mm" for d in depths)]
    print(pd.DataFrame(table, columns=names).to_markdown(index=False, disable_numparse=True))
    if options.figure:
        draw(options.figure, depths, -read["fz_N"].to_numpy(), rows)


def draw(path: Path, depths: np.ndarray, read: np.ndarray, rows: list) -> None:
    """Draw predicted forces over depth as lines, the readings as points, and their ratio below."""
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(7, 7), sharex=True, height_ratios=(2, 1), layout="constrained"
    )
    for friction, bulk, stiffness, force, _ in rows:
        if stiffness != 1:
            continue
        line = "-" if bulk == 1000 else "--"
        colour = plt.get_cmap("viridis")(0.85 * friction)
        label = f"friction {friction:g}, K/mu {bulk:g}"
        above.plot(depths, force, line, color=colour, label=label)
        below.plot(depths, force / read, line, color=colour)
    above.plot(depths, read, "ko", label="read (FEATS)")
    below.axhline(1, color="k", lw=0.8)
    above.set(
        ylabel="force towards the gel [N]",
        title="GelSight Mini, ball of 7.5 mm radius at the centre: predicted, not fitted",
    )
    below.set(xlabel="depth [mm]", ylabel="predicted over read [-]")
    above.legend(fontsize=8)
    for axes in (above, below):
        axes.grid(alpha=0.3)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
