"""Real readings next to predictions: FEATS's GelSight Mini, the article's sensor, and six sets of material tests.

usage: python benchmarks/real_data.py [feats article materials] [--figure docs/figures/gelsight_mini.png] [--data FOLDER]

One thread; a minute for each of the first two, six for the material tests, which are not in the repository: `--data` is
the folder that holds those of `config/mappings`. No depth is moved and no force is fitted: a row of the first two tables
is what a set of assumptions predicts at the depths read. Of material tests one loading is fitted and the others predicted.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # validation is not installed

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import matplotlib  # noqa: E402  (threads are set before the libraries start theirs)

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

from gelforge.config import Study, load_session, load_study, study_from  # noqa: E402
from gelforge.config.basis.variants import merged  # noqa: E402
from gelforge.indentation.paths.planned_cell import PlannedCell  # noqa: E402
from gelforge.indentation.planning.plan import plan_cells, press_path  # noqa: E402
from gelforge.indentation.solving.companion import simulate_label  # noqa: E402
from gelforge.laws_of_study import laws_of  # noqa: E402
from gelforge.materials.readers.material_source import read_sources  # noqa: E402
from gelforge.mismatch.material.material_tests import Judged, judge_sources  # noqa: E402
from gelforge.mismatch.readings.errors import CONTACT_POINT_MM  # noqa: E402
from gelforge.progress import Progress, show  # noqa: E402
from validation.checks.article import SITES, STATED_N, read_table  # noqa: E402

PARTS = ("feats", "article", "materials")
STUDY = Path("config/gelsight_mini.yaml")
READINGS = Path("data/gelsight_mini/feats/indentations.csv")
SESSION = Path("data/gelsight_mini/feats/session.yaml")
ARTICLE = Path("config/paper.yaml")
MATERIAL_SETS = (
    "vhb_20C",
    "oca_vhb_viscoelastic",
    "nitrile",
    "nist_foam_ageing",
    "afm_indentation",
    "two_loadcells",
)
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
    force, bar = pressed(study, planned)
    return -force[:, 2], bar[:, 2]


def pressed(study: Study, planned: PlannedCell) -> tuple[np.ndarray, np.ndarray]:
    """Return the force on the sensor (D, 3) [N] of an indentation, and the mesh's error bar (D, 3)."""
    cell = simulate_label(study, laws_of(study, []), {}, planned)
    if not cell.converged:
        raise SystemExit(f"{study.study}, {planned.name}: {cell.attributes['reason']}")
    return cell.arrays["total_force_N"], cell.arrays["total_sigma_mesh_N"]


def allowed(depths: np.ndarray, force: np.ndarray, mesh, noise_N: float, contact_mm: float) -> np.ndarray:
    """Return the standard deviation (D,) [N] of predicted less read force: mesh, reading, and contact point by the slope."""
    slope = np.gradient(np.r_[0.0, np.abs(force)], np.r_[0.0, depths])[1:]
    return np.sqrt(np.square(mesh) + noise_N**2 + (slope * contact_mm) ** 2)


def show_table(rows: list, names: list[str]) -> None:
    print(pd.DataFrame(rows, columns=names).to_markdown(index=False, disable_numparse=True), end="\n\n")


def feats(figure: Path | None) -> None:
    """Print the forces that assumptions predict next to FEATS's, and how far off they are; draw them."""
    read = pd.read_csv(READINGS)
    read = read[read["phase"] == "load"]
    rows = []
    with Progress("presses", len(ASSUMED)) as progress:
        for friction, bulk, stiffness in ASSUMED:
            force, bar = predicted(friction, bulk, stiffness)
            rows.append((friction, bulk, stiffness, force, bar))
            progress.advance()
    depths, known = read["depth_mm"].to_numpy(), -read["fz_N"].to_numpy()
    names = ["friction", "K over mu", "mu over FEATS's", *(f"{d:g} mm" for d in depths)]
    table = [["read", "", "", *(f"{f:.2f}" for f in known)]]
    table += [
        [f"{m:g}", f"{k:g}", f"{s:g}", *(f"{f:.2f} ± {b:.2f}" for f, b in zip(force, bar))]
        for m, k, s, force, bar in rows
    ]
    show_table(table, names)
    session = load_session(SESSION)
    errors = session.force.repeatability_N[2], session.depth_zero.session_scatter_mm
    table = []
    for m, k, s, force, bar in rows:
        off = zip(np.abs(force - known), allowed(depths, force, bar, *errors))
        table.append([f"{m:g}", f"{k:g}", f"{s:g}", *(f"{d:.2f} ± {b:.2f}" for d, b in off)])
    show_table(table, names)
    if figure:
        draw(figure, depths, known, rows)


def article() -> None:
    """Print the article's 16 readings next to its own two curves and our solutions with its parameters."""
    table, study, rows, all_off = read_table(), load_study(ARTICLE), [], []
    for place, (x, y) in SITES.items():
        published = table[table["location"] == place]
        depths = published["depth_mm"].to_numpy()
        force, mesh = pressed(study, press_path(place, x, y, list(depths), None, False))
        read = -published["ft_sensor_N"].to_numpy()
        curves = [-published["fem_linear_N"].to_numpy(), -published["fem_N"].to_numpy(), -force[:, 2]]
        off = np.abs(np.array(curves) - read)  # (3, D)
        bar = [allowed(depths, f, m, STATED_N, CONTACT_POINT_MM) for f, m in zip(curves, (0, 0, mesh[:, 2]))]
        all_off.append(off)
        for i, depth in enumerate(depths):
            own = f"{curves[2][i]:.3f} ± {mesh[i, 2]:.3f}"
            beyond = (f"{off[k, i]:.3f} ± {bar[k][i]:.3f}" for k in range(3))
            rows.append([place, f"{depth:g}", f"{read[i]:.3f}", own, *beyond])
        sideways = ", ".join(f"{force[-1, a]:+.3f} ± {mesh[-1, a]:.3f}" for a in (0, 1))
        print(f"predicted Fx, Fy at {depths[-1]:g} mm, {place}: {sideways} N")
    rms = np.sqrt(np.mean(np.hstack(all_off) ** 2, axis=1))
    rows.append(["rms", "", "", "", *(f"{value:.3f}" for value in rms)])
    names = ["place", "depth [mm]", "read [N]", "ours [N]"]
    show_table(rows, [*names, "its linear curve off by", "its hyperelastic curve off by", "ours off by"])


def materials(data: Path) -> None:
    """Print, for each set of material tests, what was fitted, how far off all others are, and what remains of that."""
    rows = []
    for name in MATERIAL_SETS:
        if not (data / name).is_dir():
            print(f"{data / name} is not there; --data names the folder with material tests")
            continue
        judged, reasons = judge_sources(read_sources([data / name], Path(f"config/mappings/{name}.yaml")))
        rows += [material_row(name, one) for one in judged]
        for reason in reasons:
            print(f"not judged: {reason}")
    names = [
        "set",
        "tests of",
        "fitted",
        "readings",
        "nominal model off by (allowed)",
        "held out: off by, nominal; with what was found",
    ]
    show_table(rows, [*names, "state", "what was found"])


def material_row(name: str, judged: Judged) -> list[str]:
    """Return a verdict's row; differences are root mean squares [MPa, or N of indentations and load cells]."""
    verdict, table = judged.verdict, judged.table
    stress = verdict.provenance.base.endswith("undeformed section")
    largest = np.abs(table["measured"]).max()
    unit, factor = ("kPa", 1e3) if stress else ("nN", 1e9) if largest < 1e-3 else ("N", 1.0)
    fit, allowed_N = verdict.fit, np.sqrt(np.mean(table["sigma"] ** 2))

    def size(value: float) -> str:
        return f"{factor * value:.3g}"

    held = "none held out"
    if fit.held_out:
        held = f"{size(fit.held_out.before.rmse_N[2])}; {size(fit.held_out.after.rmse_N[2])} {unit}"
    fitted = verdict.provenance.base.partition(";")[0]
    before = f"{size(fit.before.rmse_N[2])} ({size(allowed_N)}) {unit}"
    found = ", ".join(" or ".join(group.members) for group in verdict.answer) or "nothing"
    return [name, judged.name, fitted, str(fit.before.readings), before, held, verdict.state, found]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "parts",
        nargs="*",
        choices=[*PARTS, []],
        metavar="PART",
        help=f"of {', '.join(PARTS)}; all if none is named",
    )
    parser.add_argument("--figure", type=Path, help="PNG of FEATS's readings to write")
    parser.add_argument(
        "--data", type=Path, default=Path("../shared/data"), help="folder with the material tests"
    )
    options = parser.parse_args()
    show()
    for part in options.parts or PARTS:
        print(f"{part}\n")
        {
            "feats": lambda: feats(options.figure),
            "article": article,
            "materials": lambda: materials(options.data),
        }[part]()


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
