"""How well `gelforge calibrate` finds concealed moduli of SYNTHETIC sensors: coverage, error and time.

usage: python benchmarks/calibration.py [--cases 40] [--seed 0] [--kinds article,mini,dome] [--sizes 1] [--out FOLDER]

Each case draws the gel's modulus (up to a factor of three off the study's, log-uniform) and the friction (0.25 to 0.75,
the study says 0.5), and records 20 presses, five places to four depths, on a mesh of half the study's sizes, by the same
code: with noise of 0.5 % of the largest force and a contact point that scatters by 0.02 mm. Free are gel.modulus and
friction. One thread; the seconds are CPU seconds of the fit, not of the recording.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402  (threads are set before the libraries start theirs)
import pandas as pd  # noqa: E402
from scipy.stats import binomtest  # noqa: E402

from gelforge.calibration.calibrate import calibrate_folder  # noqa: E402
from gelforge.config import Study, study_from  # noqa: E402
from gelforge.config.basis.variants import merged  # noqa: E402
from gelforge.indentation.effects.catalogue import with_keys  # noqa: E402
from gelforge.indentation.paths.planned_cell import PlannedCell  # noqa: E402
from gelforge.indentation.solving.simulate import simulate_cell  # noqa: E402
from gelforge.laws_of_study import laws_of  # noqa: E402

GEL = {"mu_kPa": [7.9652, 0.3093], "alpha": [1.2769, 3.5676]}
SKIN = {"mu_kPa": [85.1168, -0.0020], "alpha": [2.8991, -8.2915]}
MINI = {"mu_kPa": [145.0], "alpha": [2.0]}
LAYERED = {"ecoflex_gel": {"parameters": GEL}, "elastosil_25_1": {"parameters": SKIN}}
# sensor, materials, size of elements under the ball [mm], places as shares of half the width from the middle, depths [mm]
KINDS = {
    "article": ("paper", LAYERED, 1.4, 0.6, (0.5, 0.9, 1.3, 1.7)),
    "mini": ("gelsight_mini", {"gelsight_gel": {"parameters": MINI}}, 1.0, 0.5, (0.3, 0.6, 0.9, 1.2)),
    "dome": ("dome", LAYERED, 2.4, 0.35, (0.5, 0.9, 1.3, 1.7)),
}
FINER = 0.5  # sizes of the recording's mesh over those of the study's: with errors of second order a quarter is left
NOISE, SCATTER_MM = 0.005, 0.02
HEADER = "press,cell,order,time_s,phase,x_mm,y_mm,depth_mm,speed_mm_per_s,dwell_s,fx_N,fy_N,fz_N,image"
SESSION = """session: concealed
synthetic: true
force: {acts_on: sensor, resolution_N: [0.0005, 0.0005, 0.0005]}
depth_zero: {by: press, press_scatter_mm: 0.02}
"""


def study_of(kind: str, sizes: float = 1.0) -> Study:
    """Return the study of a kind of sensor on a mesh of so many times its sizes."""
    sensor, materials, near, _, depths = KINDS[kind]
    mesh = {"near_mm": near * sizes, "near_radius_mm": 3.0, "far_mm": 2.5 * near * sizes}
    keys = {"study": kind, "materials": materials, "sensor": f"config/sensors/{sensor}.yaml"}
    keys["indenter"] = {"kind": "sphere", "radius_mm": 5.0}
    keys["plan"] = {"grid": {"spacing_mm": 4.0, "margin_mm": 9.0}, "depths_mm": list(depths[:2])}
    return study_from({**keys, "mechanics": {"mesh": mesh, "friction": 0.5}})


def record(folder: Path, study: Study, kind: str, rng: np.random.Generator) -> None:
    """Write a session of 20 presses on a study's sensor."""
    *_, reach, depths = KINDS[kind]
    half = np.array([study.sensor.width_x_mm, study.sensor.width_y_mm]) / 2
    turn = rng.uniform(0, np.pi / 2) + np.arange(4) * np.pi / 2
    places = [(0.0, 0.0), *zip(np.cos(turn), np.sin(turn))]
    sites = [tuple(np.round(half + reach * half * np.array(place), 3)) for place in places]
    laws = laws_of(study, [])
    true = {
        s: simulate_cell(study, laws, PlannedCell("t", *s, depths)).arrays["total_force_N"] for s in sites
    }
    noise = NOISE * max(np.abs(force[:, 2]).max() for force in true.values())
    rows, knots = [], np.array([0.0, *depths])
    presses = [(site, k) for site in sites for k in range(len(depths))]
    for number, i in enumerate(rng.permutation(len(presses))):
        (x, y), k = presses[i]
        curve = np.vstack([np.zeros(3), true[x, y]])
        held = curve[k + 1] + rng.normal(0, SCATTER_MM) * np.gradient(curve, knots, axis=0)[k + 1]
        course = [("zero", 0.1 * z, -1.0, 0.0 * held) for z in range(4)]
        course += [("load", 4.0, depths[k], held)]
        course += [("dwell", 4.5 + 0.5 * d, depths[k], held) for d in range(3)]
        for phase, after, depth, force in course:
            f = force + rng.normal(0, noise, 3)
            rows.append(
                f"p{number:02d},,{number},{20.0 * number + after:.2f},{phase},{x},{y},{depth},1,,"
                f"{f[0]:.5f},{f[1]:.5f},{f[2]:.5f},"
            )
    folder.mkdir(parents=True)
    (folder / "indentations.csv").write_text("\n".join([HEADER, *rows]) + "\n")
    (folder / "session.yaml").write_text(SESSION)


def case(number: int, seed: int, kind: str, sizes: float, out: Path) -> dict:
    """Return what was found in one concealed case, by a study with so many times the usual sizes of elements."""
    rng = np.random.default_rng([seed, number])
    factor, friction = float(3 ** rng.uniform(-1, 1)), float(rng.uniform(0.25, 0.75))
    truth = study_from(
        merged(study_of(kind, FINER * sizes).model_dump(mode="json"), {"mechanics": {"friction": friction}})
    )
    truth = with_keys(truth, material={"stiffness_factor": {"gel": factor}})
    folder = out / f"{kind}_{number:03d}_seed_{seed}_sizes_{sizes:g}"
    if not (folder / "concealed").is_dir():
        record(folder / "concealed", truth, kind, rng)
    clock = time.process_time()
    content = calibrate_folder(
        study_of(kind, sizes), folder / "concealed", ["gel.modulus", "friction"], {}, folder / "out"
    )
    row = {"case": number, "kind": kind, "seconds": time.process_time() - clock, "solved": content["solved"]}
    row |= {"converged": content["converged"], "p": content["p"], "factor": factor}
    modulus, slip = content["parameters"]
    for name, one, value in (
        ("modulus", modulus, factor * modulus["study"]),
        ("friction", slip, friction),
    ):
        low, high = one["interval_90"]
        row |= {f"{name}_off": one["value"] / value - 1, f"{name}_held": bool(low <= value <= high)}
        row |= {f"{name}_sd": one["sd"], f"{name}_at_prior": one["at_prior"]}
    return row


def share(held: pd.Series) -> str:
    """Return how many of some intervals hold the truth, with the 90 % interval of that share."""
    found = binomtest(int(held.sum()), len(held)).proportion_ci(0.9, "wilson")
    return f"{held.sum()} of {len(held)} ({held.mean():.0%}, {found.low:.0%} to {found.high:.0%})"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", default=",".join(KINDS), help="in turn")
    parser.add_argument(
        "--sizes", type=float, default=1.0, help="of the study's elements, over those of KINDS"
    )
    parser.add_argument("--out", type=Path, help="folder to keep, whose recordings are used again")
    options = parser.parse_args()
    out, kinds = options.out or Path(tempfile.mkdtemp()), options.kinds.split(",")
    rows = []
    for number in range(options.first, options.first + options.cases):
        rows.append(case(number, options.seed, kinds[number % len(kinds)], options.sizes, out))
        print(" ".join(f"{k}={v:.3g}" if isinstance(v, float) else f"{k}={v}" for k, v in rows[-1].items()))
    table = pd.DataFrame(rows)
    lines = []
    for kind, own in [*table.groupby("kind"), ("all", table)]:
        lines.append(
            {
                "sensor (SYNTHETIC)": kind,
                "90 % intervals of the modulus that hold it": share(own["modulus_held"]),
                "of friction": share(own["friction_held"]),
                "rms error of the modulus": f"{100 * np.sqrt((own['modulus_off'] ** 2).mean()):.1f} %",
                "within 3 %": f"{(own['modulus_off'].abs() < 0.03).mean():.0%}",
                "converged": f"{own['converged'].sum()} of {len(own)}",
                "CPU s of a fit (median)": f"{own['seconds'].median():.0f}",
            }
        )
    print(pd.DataFrame(lines).to_markdown(index=False))


if __name__ == "__main__":
    main()
