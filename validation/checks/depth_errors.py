"""Nulls whose depth has both errors, judged by a session.yaml that states one of them, and by one that states both.

usage: python -m validation.checks.depth_errors [--nulls 12] [--out FOLDER]

SYNTHETIC: recordings by FElupe as in validation, nothing hidden, all on the plain base: solutions are shared
(FOLDER/../kept). Prints by what is stated the false alarms (p below 0.01 of the verdict's four tests) and each null's p.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import Study, load_study
from gelforge.mismatch.evidence.covariance import readings_covariance
from gelforge.mismatch.evidence.kernels import kernels_of, weighed_unknown
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.fem.nominal import observations_of, problem_of
from gelforge.mismatch.inference.posterior import chance_of_known
from gelforge.mismatch.inference.scan import residual_tests
from gelforge.mismatch.model.effect import Context
from gelforge.mismatch.pipeline.stage import solver_of
from gelforge.mismatch.thresholds import ALARM_P
from validation.draw import base_world
from validation.library import Library, load_library
from validation.presses import timeline
from validation.recording import (
    STAGE_MM,
    Instrument,
    drawn_instrument,
    recorded,
    with_circumstances,
    write_recording,
)
from validation.sets import CONFIG

SEED = 35


def nulls(library: Library, number: int) -> Iterator[tuple[str, pd.DataFrame, np.ndarray, Instrument]]:
    """Yield name, rows, readings and instrument of nulls with both errors of the depth."""
    world = base_world(library, "concealed")
    for k in range(number):
        rng = np.random.default_rng([SEED, k])
        instrument = drawn_instrument(rng, zero_by="session")
        instrument = replace(instrument, stage_mm=float(rng.uniform(*STAGE_MM)))
        rows = with_circumstances(timeline(rng, library.sensor.plan), instrument)
        yield f"n{k:03d}", rows, recorded(world, rows, instrument, rng), instrument


def stating(problem: Problem, context: Context, base, press_mm: float, session_mm: float) -> Problem:
    """Return the problem with these standard deviations of the depth in its covariance."""
    seen, R = problem.observations, len(problem.observations.force)
    seen = replace(seen, press_depth_mm=np.full(R, press_mm), session_depth_mm=np.full(R, session_mm))
    covariance = readings_covariance(replace(context, observations=seen), base.law, base.floor, base.solution)
    return replace(problem, observations=seen, covariance=covariance)


def chance(problem: Problem, study: Study) -> float:
    """Return the p of whether there is a mismatch, as the judge takes it from its four tests."""
    rng = np.random.default_rng([study.seed, 5])
    unknown = weighed_unknown(problem, kernels_of(problem))
    found = residual_tests(problem, problem.residual, study.mismatch.draws, rng)
    return replace(found, unknown_p=unknown.p, known_p=chance_of_known(problem)).p


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--nulls", type=int, default=12, help="how many")
    parser.add_argument(
        "--out", type=Path, default=Path("results/concealed/sets/depth_errors"), help="folder of recordings"
    )
    asked = parser.parse_args()
    study = load_study(CONFIG / "concealed.yaml")
    rows = []
    for name, table, readings, instrument in nulls(load_library(), asked.nulls):
        folders = write_recording(asked.out / name, name, table, readings, instrument)
        solver = solver_of(study, asked.out, [], asked.out.parent / "kept", 1, folders)
        problem, base = problem_of(solver, observations_of(folders, study)[0])
        stage, contact = instrument.stage_mm, instrument.touchdown_mm
        stated = {
            "contact point alone": (0.0, contact),
            "stage alone": (stage, 0.0),
            "both": (stage, contact),
        }
        p = {
            key: chance(stating(problem, base.context, base, *sizes), study) for key, sizes in stated.items()
        }
        rows.append({"null": name, "stage_mm": stage, "contact_mm": contact, **p})
        print(
            pd.DataFrame(rows[-1:]).to_csv(index=False, header=len(rows) == 1, float_format="%.3g"),
            end="",
            flush=True,
        )
    for key in stated:
        print(f"{key}: {sum(row[key] < ALARM_P for row in rows)} false alarms of {len(rows)}")


if __name__ == "__main__":
    main()
