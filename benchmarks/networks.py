"""The networks side by side on a finished study's dataset, whose test rows are of orbits that none has seen.

usage: python benchmarks/networks.py [results/benchmark] [--seeds 1 2 3]
       [--networks unet unet-turned cnn paper paper-converged]
       (one thread; the benchmark study: three minutes a seed for unet, eight for paper; trained networks are kept in
       results/trained)

Prints a Markdown table: medians over seeds, which also draw the validation orbits. `paper` takes as many steps as
the study's rows allow in minutes, `paper-converged` those of the article.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import argparse  # noqa: E402
import tempfile  # noqa: E402
from pathlib import Path  # noqa: E402

import pandas as pd  # noqa: E402
from kept import trained  # noqa: E402

from gelforge.config import Learning, Study, load_study  # noqa: E402
from gelforge.learning.judging.evaluation import baselines_table, reliability_table, rmse_table  # noqa: E402
from gelforge.learning.judging.predictions import LearningSets, Predictions, predict_test_rows  # noqa: E402

NETWORKS = {
    "unet": {},
    "unet-turned": {"symmetry": "d4"},
    "cnn": {"network": "cnn"},
    "paper": {"network": "paper", "steps": 3100},
    "paper-converged": {"network": "paper"},
}
USUAL = [name for name in NETWORKS if name != "paper-converged"]


def judged(study: Study, shards: list[Path], folder: Path) -> dict[str, float]:
    """Return figures of a network that is trained on the training rows, all on the test rows; a folder takes predictions."""
    model, seconds = trained(study, shards)
    predicted = folder / "predictions.h5"
    predict_test_rows(model, LearningSets.of(shards), study, predicted, threads=1)
    predictions = Predictions(predicted)
    rmse = rmse_table(predictions).set_index("error")
    trust = reliability_table(predictions).set_index("quantity")["value"]
    row = {f"RMSES {axis} [mN]": 1e3 * rmse.loc["RMSES", f"{axis}_N"] for axis in "xyz"}
    row["RMSES z of training rows [mN]"] = 1e3 * rmse.loc["RMSES_TRAINING", "z_N"]
    row["total Fz [mN]"] = 1e3 * rmse.loc["RMSET_FEM", "z_N"]
    row["CoP median [mm]"] = trust["centre of pressure, median distance"]
    row["CoP p95 [mm]"] = trust["centre of pressure, 95th percentile"]
    row["untouched Fz [mN]"] = 1e3 * trust["Fz of untouched images, rms"]
    for what in ("bins", "totals"):
        inside = [
            trust.get(f"{what}, {axis}: share inside the 90 % interval", float("nan")) for axis in "xyz"
        ]
        row |= {f"{what} {axis} in 90 % [%]": 100 * share for axis, share in zip("xyz", inside)}
    return row | {"training CPU [s]": seconds}


def baselines(folder: Path) -> pd.DataFrame:
    """Return the baselines' figures (figure, predictor), of the predictions in a folder."""
    table = baselines_table(Predictions(folder / "predictions.h5")).set_index("predictor")
    found = table.drop(index=["network", "zero"])
    rows = {f"RMSES {axis} [mN]": 1e3 * found[f"RMSES_{axis}_N"] for axis in "xyz"}
    rows["total Fz [mN]"] = 1e3 * found["total_Fz_rms_N"]
    rows["CoP median [mm]"] = found["centre_of_pressure_median_mm"]
    rows["CoP p95 [mm]"] = found["centre_of_pressure_p95_mm"]
    rows["untouched Fz [mN]"] = 1e3 * found["untouched_Fz_rms_N"]
    return pd.DataFrame(rows).T


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="?", type=Path, default=Path("results/benchmark"))
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3])
    parser.add_argument("--networks", nargs="+", choices=NETWORKS, default=USUAL)
    parser.add_argument("--steps", type=int, help="in place of each network's own number")
    arguments = parser.parse_args()
    study = load_study(arguments.results / "study.yaml")
    shards = sorted((arguments.results / "dataset").glob("shard-*.h5"))
    table, beside = {}, []
    for name in arguments.networks:
        rows = []
        for seed in arguments.seeds:
            learning = Learning(
                **{"validation_fraction": study.learning.validation_fraction, **NETWORKS[name]}
                | ({"steps": arguments.steps} if arguments.steps else {})
            )
            changed = study.model_copy(update={"learning": learning, "seed": seed})
            with tempfile.TemporaryDirectory() as folder:
                rows.append(judged(changed, shards, Path(folder)))
                beside.append(baselines(Path(folder)))
            print(
                f"{name}, seed {seed}: {', '.join(f'{k} {v:.3g}' for k, v in rows[-1].items())}", flush=True
            )
        table[name] = pd.DataFrame(rows).median()
    print()
    print(pd.DataFrame(table).to_markdown(floatfmt=".3g"))
    print("\nbaselines, medians over the same runs:\n")
    print(pd.concat(beside).groupby(level=0, sort=False).median().to_markdown(floatfmt=".3g"))


if __name__ == "__main__":
    main()
