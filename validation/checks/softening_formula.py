"""How well the screen's formula of softening meets the solver's own: what a refit starts from.

usage: python -m validation.checks.softening_formula SET [--only c063 ...] [--kept FOLDER] [--value 0.1]

On the presses of a development set's single effects, whatever is hidden in them; that of docs/mismatch-method.md is made by
`python -m validation generate dev7 --seed 94 --nulls 0 --singles 140 --pairs 0 --outside 0`.
Prints, for each scale m of the softening, the signal-to-noise of the solved change, the value at which the formula meets
it best, and the share that it leaves then.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from validation.checks.development_cases import SETS, Known, known_singles


def rows_of(known: Known, value: float) -> list[dict]:
    """Return a row per scale of the softening."""
    problem, found = known.problem, []
    observations, every = problem.observations, np.ones(len(problem.observations.table), bool)
    for candidate in (c for c in problem.candidates if c.name == "mullins"):
        forces = problem.forces_with([(candidate, np.array([value]))], every)
        change = problem.covariance.whiten(observations.flat(forces - problem.base))
        formula = problem.covariance.whiten(candidate.columns[:, 0])
        best = float(formula @ change / (formula @ formula))
        size = float(np.linalg.norm(change))
        found.append(
            {
                "case": known.name,
                "m [kPa]": candidate.hyperparameters["m_kPa"],
                "solved value": value,
                "SNR": size,
                "formula's value": best,
                "left": float(np.linalg.norm(change - best * formula)) / size,
            }
        )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("set")
    parser.add_argument("--only", nargs="*")
    parser.add_argument("--kept", type=Path, default=SETS / "kept")
    parser.add_argument("--value", type=float, default=0.1)
    asked = parser.parse_args()
    rows = []
    for known in known_singles(SETS / asked.set, asked.kept, names=asked.only):
        rows += rows_of(known, asked.value)
    print(pd.DataFrame(rows).to_markdown(index=False, floatfmt=".2f"))


if __name__ == "__main__":
    main()
