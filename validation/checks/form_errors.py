"""How well the tool's own model of a hidden effect meets another form: what `change_error` and FORM_ERRORS have to hold.

usage: python -m validation.checks.form_errors SET [--weakest 8] [--kept results/concealed/sets/kept] [--only c004 ...]

Of a development set (`python -m validation generate SET --seed 7`), as its truths are read: its single effects on
the plain base. The effect is given; its values are fitted in the tool's own solver to its base and the hidden change,
without noise: what is left is form and mesh alone. Prints the signal-to-noise of the change and of what is left of it, the
share that this is of it, and hidden and fitted values.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.evidence.refit import refitted
from gelforge.mismatch.inference.fits import forces_of
from gelforge.mismatch.inference.posterior import weighed
from validation.checks.development_cases import SETS, Known, known_singles


def row(known: Known) -> dict:
    """Return what a refit of a hidden effect leaves of its change."""
    problem, hidden, began = _without_noise(known), known.hidden, time.perf_counter()
    told = {
        "case": known.name,
        "effect": hidden["name"],
        "form": hidden["form"],
        "SNR": _snr(problem, known.change),
    }
    candidates = [c for c in problem.candidates if c.name == hidden["name"]]
    every = np.ones(len(problem.labels), bool)
    found = weighed(replace(problem, candidates=candidates))
    if not found:
        return told | {"fitted": "not offered"}
    try:
        fit = refitted(problem, found[0], every)
        ours = problem.observations.flat(forces_of(problem, fit) - problem.base)
        left = _snr(problem, known.change - ours)
    except NotConverged as failure:
        return told | {"fitted": str(failure)[:60]}
    theta = [
        f"{p.name} {a:.3g} +- {s:.2g}"
        for p, a, s in zip(
            problem.effects[hidden["name"]].parameters, fit.theta[0], np.sqrt(np.diag(fit.covariance))
        )
    ]
    return told | {
        "left": left,
        "share": left / told["SNR"],
        "hidden": ", ".join(f"{name} {value:.3g}" for name, value in hidden["parameters"].items()),
        "fitted": ", ".join(theta) + ("" if fit.converged else " (not at rest)"),
        "s": time.perf_counter() - began,
    }


def _without_noise(known: Known) -> Problem:
    observations = known.problem.observations
    force = np.where(observations.read, known.problem.base, observations.force)  # what was not read stays so
    force[observations.read] += known.change
    return replace(known.problem, observations=replace(observations, force=force))


def _snr(problem: Problem, change: np.ndarray) -> float:
    """Return the signal-to-noise of a change (n,) [N]."""
    return float(np.linalg.norm(problem.covariance.whiten(change)))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("set")
    parser.add_argument("--weakest", type=float, default=8.0)
    parser.add_argument("--kept", type=Path, default=SETS / "kept")
    parser.add_argument("--only", nargs="*")
    parser.add_argument("--workers", type=int, default=1)
    asked = parser.parse_args()
    found = []
    for known in known_singles(
        SETS / asked.set, asked.kept, asked.weakest, names=asked.only, workers=asked.workers
    ):
        found.append(row(known))
        print(found[-1], file=sys.stderr, flush=True)
    print(pd.DataFrame(found).to_markdown(index=False, floatfmt=".2f"))


if __name__ == "__main__":
    main()
