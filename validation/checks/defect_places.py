"""How near a hidden defect a refit comes: at the best place that is tried, and with the place fitted between them.

usage: python -m validation.checks.defect_places SET [--kept results/concealed/sets/kept] [--limit 4]

Of a development set (`python -m validation generate SET --seed 7`), as its truths are read: the single effects
that have a place, on the plain base. The effect is given and its place is not: what is asked is where, not what. Prints for
each the distance from the hidden place and the radii [mm], and what is left in standard deviations of the readings'
errors (1: only noise), root mean square.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.evidence.refit import Refitted, refitted
from gelforge.mismatch.inference.fits import forces_of
from gelforge.mismatch.inference.holdout import split
from gelforge.mismatch.inference.posterior import weighed
from validation.checks.development_cases import SETS, Known, known_singles


def row(known: Known) -> dict:
    """Return what refits of a hidden effect at its best tried place and between places leave of the readings."""
    problem, hidden = known.problem, known.hidden
    train = split(problem.labels, known.seed).train
    candidates = [c for c in problem.candidates if c.name == hidden["name"]]
    (start,) = weighed(replace(problem, candidates=candidates))
    alone = replace(problem, candidates=start.parts)  # no place is next to it: it stays
    fixed, free = refitted(alone, start, train), refitted(problem, start, train)
    told = {
        "case": known.name,
        "hidden": hidden["name"],
        "SNR": hidden["snr"],
        "before": _left(problem, None),
    }
    for words, fit in (("tried", fixed), ("fitted", free)):
        place = fit.parts[0].hyperparameters
        away = np.hypot(place["x_mm"] - hidden["where"]["x_mm"], place["y_mm"] - hidden["where"]["y_mm"])
        told |= {f"{words}: away [mm]": away, f"{words}: left": _left(problem, fit)}
    sizes = {
        "hidden radius [mm]": hidden["where"]["radius_mm"],
        "fitted": free.parts[0].hyperparameters["radius_mm"],
    }
    return told | sizes | {"at rest": free.converged}


def _left(problem: Problem, fit: Refitted | None) -> float:
    force = problem.base if fit is None else forces_of(problem, fit)
    left = problem.observations.flat(problem.observations.force - force)
    return float(np.sqrt(np.mean(problem.covariance.whiten(left) ** 2)))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("set")
    parser.add_argument("--kept", type=Path, default=SETS / "kept")
    parser.add_argument("--limit", type=int)
    asked = parser.parse_args()
    found = []
    for known in islice(known_singles(SETS / asked.set, asked.kept, located=True), asked.limit):
        found.append(row(known))
        print(found[-1], file=sys.stderr, flush=True)
    print(pd.DataFrame(found).to_markdown(index=False, floatfmt=".2f"))


if __name__ == "__main__":
    main()
