"""The gel's modulus by `gelforge calibrate` from nulls of a concealed set, which FElupe made, starting from a wrong one.

usage: python -m validation.checks.calibrated SET [--cases c001 ...] [--factors 0.5 ...] [--out FOLDER]

The base study of the small sensor with elements of 0.3 and 0.6 mm and the gel's modulus times a factor; in a null the true
one is that of the study. Each case takes some four CPU minutes. SYNTHETIC.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.calibration.calibrate import calibrate_folder
from gelforge.config import load_study, study_from
from gelforge.config.basis.variants import merged
from gelforge.indentation.effects.catalogue import with_keys
from validation.__main__ import SETS
from validation.sets import CONFIG

FACTORS = [0.5, 2.0, 0.35, 2.9, 0.6, 1.7, 0.75, 1.3, 0.9, 1.1]  # within the prior, a factor of three
MESH = {"mechanics": {"mesh": {"near_mm": 0.3, "far_mm": 0.6}}}


def calibrated(recording: Path, factor: float, out: Path) -> dict[str, str]:
    """Return the row of one null: the modulus found over the true one, its interval, and the cost."""
    study = study_from(merged(load_study(CONFIG / "concealed.yaml").model_dump(mode="json"), MESH))
    study = with_keys(study, material={"stiffness_factor": {"gel": factor}})
    clock = time.process_time()
    content = calibrate_folder(study, recording, ["gel.modulus"], {}, out)
    modulus = content["parameters"][0]
    true = modulus["study"] / factor
    low, high = (value / true for value in modulus["interval_90"])
    return {
        "case": recording.name,
        "study over truth": f"{factor:g}",
        "found over truth": f"{modulus['value'] / true:.4f}",
        "90 % interval": f"{low:.3f} to {high:.3f}",
        "holds": "yes" if low <= 1 <= high else "no",
        "solutions": str(content["solved"]),
        "converged": "yes" if content["converged"] else "no",
        "CPU s": f"{time.process_time() - clock:.0f}",
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("set")
    parser.add_argument("--cases", nargs="+", default=[f"c{number:03d}" for number in range(1, 11)])
    parser.add_argument("--factors", nargs="+", type=float, default=FACTORS)
    parser.add_argument("--out", type=Path, default=Path("results/concealed/calibrated"))
    asked = parser.parse_args()
    rows = [
        calibrated(SETS / asked.set / "cases" / case, factor, asked.out / f"{case}_{factor:g}")
        for case, factor in zip(asked.cases, asked.factors, strict=True)
    ]
    table = pd.DataFrame(rows)
    print(table.to_markdown(index=False, disable_numparse=True))
    off = table["found over truth"].astype(float) - 1
    held = int((table["holds"] == "yes").sum())
    print(f"\nOff by {np.sqrt((off**2).mean()):.1%} rms; {held} of {len(table)} intervals hold the truth.")


if __name__ == "__main__":
    main()
