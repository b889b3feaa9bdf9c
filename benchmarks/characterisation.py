"""Characterisation: seconds of all fits and of a bootstrap, R2 on Treloar's rubber, the article's two materials, coverage.

    python benchmarks/characterisation.py [--replicates 200] [--treloar FOLDER]

The coverage is measured on SYNTHETIC samples: the article's two materials, six samples of each test that differ in
stiffness by 2 % (thickness and curing), 1 % in the slope of stiffness over stretch, and 0.5 % noise of every reading.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import t as student

from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.fitting.bootstrap import bootstrap
from gelforge.materials.fitting.choice import compare_laws
from gelforge.materials.fitting.curves import MeanCurve, mean_curves
from gelforge.materials.fitting.fit import LawFit, fit_law
from gelforge.mechanics.laws.homogeneous import LOAD_CASES, nominal_stress, stress_points
from gelforge.mechanics.laws.models import FAMILIES
from gelforge.mechanics.laws.models.ogden import Ogden

TRUTH = {  # Sferrazza et al. 2019, table 1, and the largest stretch tested
    "Ecoflex GEL": (Ogden((7.9652e-3, 0.3093e-3), (1.2769, 3.5676)), 3.0),
    "Elastosil 25:1": (Ogden((85.1168e-3, -0.0020e-3), (2.8991, -8.2915)), 2.0),
}
SAMPLES, STIFFNESS, SLOPE, NOISE, READINGS = 6, 0.02, 0.01, 0.005, 60


def synthetic_tests(
    law: Ogden,
    largest: float,
    rng: np.random.Generator,
    stiffness: float = STIFFNESS,
    slope: float = SLOPE,
    noise: float = NOISE,
) -> list[MaterialTest]:
    """Return SYNTHETIC samples of the three tests."""
    lam, tests = np.linspace(1.0, largest, READINGS), []
    for case in LOAD_CASES:
        for k in range(SAMPLES):
            factor = np.exp(stiffness * rng.normal() + slope * rng.normal() * np.linspace(-1, 1, READINGS))
            stress = nominal_stress(law, case, lam) * factor * (1 + noise * rng.normal(size=READINGS))
            tests.append(MaterialTest(case, f"s{k}", lam, stress))
    return tests


def quantities(fit: LawFit, largest: float) -> dict[str, tuple[float, float]]:
    """Return value and half-width of the 95 % interval of ln E and of ln of the stress at the largest stretch."""
    gradient, C = fit.family.modulus_gradient(fit.parameters), fit.covariance
    t, E = student.ppf(0.975, fit.freedom), fit.law.youngs_modulus * 1e3
    found = {"E": (np.log(E), t * np.sqrt(gradient @ C @ gradient) / E)}
    for case in LOAD_CASES:
        for share in (0.5, 1.0):
            lam = 1 + share * (largest - 1)
            stress, half = fit.stress_interval(stress_points(case, np.array([lam])))
            found[f"{case} at {lam:g}"] = (np.log(stress[0]), half[0] / stress[0])
    for name, value, sigma, fixed in zip(
        fit.family.parameters, fit.parameters, np.sqrt(np.diag(C)), fit.family.logarithmic
    ):
        found[name] = (np.log(abs(value)), t * sigma / abs(value)) if fixed else (value, t * sigma)
    return found


def true_quantities(law: Ogden, largest: float) -> dict[str, float]:
    """Return the same quantities of the true law."""
    found = {"E": np.log(law.youngs_modulus * 1e3)}
    for case in LOAD_CASES:
        for share in (0.5, 1.0):
            lam = 1 + share * (largest - 1)
            found[f"{case} at {lam:g}"] = float(np.log(nominal_stress(law, case, np.array(lam))))
    for k, (mu, alpha) in enumerate(zip(law.mu, law.alpha), start=1):
        found |= {f"mu_{k}_kPa": np.log(abs(mu) * 1e3), f"alpha_{k}": alpha}
    return found


def bootstrap_ends(curves: list[MeanCurve], fit: LawFit, largest: float, refits: int, seed: int) -> dict:
    """Return the ends of the bootstrap's 95 % intervals of the same quantities."""
    drawn = bootstrap(curves, fit, refits, seed)
    laws = [fit.family.law(theta) for theta in drawn.theta]
    found = {"E": drawn.interval(np.log([law.youngs_modulus * 1e3 for law in laws]))}
    for case in LOAD_CASES:
        for share in (0.5, 1.0):
            lam = 1 + share * (largest - 1)
            stress = [float(nominal_stress(law, case, np.array(lam))) for law in laws]
            found[f"{case} at {lam:g}"] = drawn.interval(np.log(stress))
    for name, values, fixed in zip(fit.family.parameters, drawn.parameters.T, fit.family.logarithmic):
        found[name] = drawn.interval(np.log(np.abs(values)) if fixed else values)
    return found


def coverage(law: Ogden, largest: float, replicates: int, refits: int) -> pd.DataFrame:
    """Return by quantity how often the 95 % intervals of sandwich and bootstrap hold the truth."""
    truth, inside = true_quantities(law, largest), []
    for seed in range(replicates):
        curves = mean_curves(synthetic_tests(law, largest, np.random.default_rng(seed)))
        fit = fit_law(curves, "ogden2")
        ends = bootstrap_ends(curves, fit, largest, refits, seed) if refits else {}
        for name, (value, half) in quantities(fit, largest).items():
            row = {"quantity": name, "sandwich": abs(value - truth[name]) <= half, "half-width": half}
            if refits:
                row["bootstrap"] = ends[name][0] <= truth[name] <= ends[name][1]
            inside.append(row)
    return pd.DataFrame(inside).groupby("quantity", sort=False).mean()


def speed(folder: Path | None) -> None:
    """Print seconds of all fits of a material and of 1000 bootstrap refits."""
    law, largest = TRUTH["Ecoflex GEL"]
    curves = mean_curves(synthetic_tests(law, largest, np.random.default_rng(0)))
    start = time.process_time()  # of one core, whatever else the machine does
    compare_laws(curves, list(FAMILIES))
    print(
        f"all {len(FAMILIES)} laws, held-out tests included: {time.process_time() - start:.1f} s (limit 20 s, one core)"
    )
    start = time.process_time()
    only = compare_laws([c for c in curves if c.test == "uniaxial"], list(FAMILIES))
    print(f"  uniaxial alone, with the widths elsewhere:   {time.process_time() - start:.1f} s")
    print("  " + "\n  ".join(only.warnings))
    fit = fit_law(curves, "ogden2")
    start = time.perf_counter()
    bootstrap(curves, fit, 1000, 1, workers=2)
    print(
        f"1000 bootstrap refits of Ogden, K = 2: {time.perf_counter() - start:.1f} s (limit 60 s, two cores)"
    )
    if folder is None or not folder.is_dir():
        print("Treloar's rubber: folder not given or absent; skipped")
        return
    tests = []
    for mode, case in (("UT", "uniaxial"), ("PS", "pure_shear"), ("ET", "equibiaxial")):
        table = pd.read_csv(folder / f"Treloar_1944__{mode}.csv")
        tests.append(MaterialTest(case, mode, table["stretch"].to_numpy(), table["stress_11"].to_numpy()))
    r2 = fit_law(mean_curves(tests), "ogden3").r2_nominal
    print("Treloar 1944, joint Ogden, K = 3, R2 of the nominal stress (limits 0.996, 0.998, 0.998):", end=" ")
    print(", ".join(f"{case} {value:.4f}" for case, value in r2.items()))


def recovery(replicates: int) -> None:
    """Print by how much the stress fitted to SYNTHETIC tests of the article's materials is off the true one."""
    print(
        "\nThe article's materials from SYNTHETIC tests: largest error of the fitted stress over the tested range"
    )
    print(
        f"(limit 2 %; |model - truth| / truth from a strain of 5 % on; worst of {replicates} sets of samples)"
    )
    for name, (law, largest) in TRUTH.items():
        lam, worst = np.linspace(1.05, largest, 100), {}
        for case in LOAD_CASES:
            worst[case] = {"exact": 0.0, "noise": 0.0, "all scatter": 0.0}
        for kind in ("exact", "noise", "all scatter"):
            for seed in range(1 if kind == "exact" else replicates):
                scatter = {
                    "exact": (0, 0, 0),
                    "noise": (0, 0, NOISE),
                    "all scatter": (STIFFNESS, SLOPE, NOISE),
                }[kind]
                tests = synthetic_tests(law, largest, np.random.default_rng(seed), *scatter)
                fitted = fit_law(mean_curves(tests), "ogden2").law
                for case in LOAD_CASES:
                    error = nominal_stress(fitted, case, lam) / nominal_stress(law, case, lam) - 1
                    worst[case][kind] = max(worst[case][kind], float(np.abs(error).max()))
        table = pd.DataFrame(worst).T.rename(
            columns={
                "noise": f"noise of {NOISE:.1%}",
                "all scatter": f"samples that differ by {STIFFNESS:.0%} too",
            }
        )
        print(f"{name}, to stretch {largest:g}")
        print(table.to_string(float_format=lambda v: f"{v:.2%}"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--replicates", type=int, default=200)
    parser.add_argument("--refits", type=int, default=200, help="bootstrap refits per replicate, 0 for none")
    parser.add_argument(
        "--treloar", type=Path, help="folder with Treloar_1944__UT.csv, __PS.csv and __ET.csv"
    )
    arguments = parser.parse_args()
    shared = Path(os.environ.get("GELFORGE_SHARED", Path(__file__).parents[1] / ".." / "shared"))
    speed(arguments.treloar or shared / "data" / "hyper_literature")
    recovery(arguments.replicates)
    for name, (law, largest) in TRUTH.items():
        print(f"\n{name}, SYNTHETIC: share of {arguments.replicates} intervals of 95 % that hold the truth")
        table = coverage(law, largest, arguments.replicates, arguments.refits)
        print(table.to_string(float_format=lambda v: f"{v:.3f}"))


if __name__ == "__main__":
    main()
