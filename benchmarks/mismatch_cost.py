"""What a verdict costs: 25 positions x 8 depths on the article's sensor screened, judged, and judged again without mismatch.

The recording is SYNTHETIC: the base's own forces, changed, with noise and contact-point errors. Screened: base presses,
derivatives to every effect, covariance, tests and the linear pass, from nothing. Judged: all of it, fits included. What is
hidden is 12 % more force, or waves over the surface that no effect of the catalogue makes. In the second recording nothing
is hidden, and all that is solved was solved before. With --unloading every press is read during unloading too, at the next
depth. CPU seconds are those of this process: all of them with --workers 1.

usage: python benchmarks/mismatch_cost.py [--workers 2] [--sites 5] [--hidden gain | waves] [--unloading]
           [--study config/paper.yaml]
"""

# ruff: noqa: E402  (threads are set before the libraries start theirs)

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import numpy as np
import pandas as pd

from gelforge.config import load_study
from gelforge.laws_of_study import laws_of
from gelforge.mismatch.evidence.problem import at_first_order
from gelforge.mismatch.fem.nominal import problem_of
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.inference.judge import judge
from gelforge.mismatch.pipeline.stage import judge_recording
from gelforge.mismatch.readings.sessions import observe

SPACING, DEPTHS = 4.0, 0.25 * np.arange(1, 9)  # mm
NOISE_N, CONTACT_POINT_MM = 0.01, 0.01
HIDDEN = {  # factor of the force at places x, y [mm]
    "nothing": lambda x, y: np.ones(len(x)),
    "gain": lambda x, y: np.full(len(x), 1.12),
    "waves": lambda x, y: 1 + 0.12 * np.sin(2 * np.pi * x / 9.0) * np.sin(2 * np.pi * y / 13.0),
}
FORCES = ["fx_N", "fy_N", "fz_N"]
SESSION = """session: {name}
synthetic: true
base_parameters: exact
force: {{acts_on: sensor, resolution_N: [0.001, 0.001, 0.001]}}
depth_zero: {{by: press, press_scatter_mm: 0.01}}
"""


def planned(study, per_side: int, unloading: bool, seed: int) -> pd.DataFrame:
    """Return the rows of a session in random order: per press three at zero, one at depth, two after a wait, one unloading.

    Forces are of the right size only: the cost of a screen does not depend on them.
    """
    middle = np.array([study.sensor.width_x_mm, study.sensor.width_y_mm]) / 2
    along = SPACING * (np.arange(per_side) - (per_side - 1) / 2)
    presses = [(x, y, d) for x in along + middle[0] for y in along + middle[1] for d in DEPTHS]
    rows = []
    for order, k in enumerate(np.random.default_rng(seed).permutation(len(presses))):
        x, y, depth = presses[k]
        course = [("zero", 0.1 * n, -1.0) for n in range(3)]
        course += [("load", 1 + depth, depth), ("dwell", 2 + depth, depth), ("dwell", 3 + depth, depth)]
        if unloading and depth > DEPTHS[0]:
            course.append(("unload", 3.5 + depth, depth - DEPTHS[0]))
        rows += [
            (
                f"p{order:04d}",
                "",
                order,
                20.0 * order + at,
                phase,
                x,
                y,
                d,
                1.0,
                "",
                0.0,
                0.0,
                -0.3 * max(d, 0) ** 1.5,
                "",
            )
            for phase, at, d in course
        ]
    names = "press cell order time_s phase x_mm y_mm depth_mm speed_mm_per_s dwell_s".split()
    return pd.DataFrame(rows, columns=[*names, *FORCES, "image"])


def write(folder: Path, rows: pd.DataFrame) -> Path:
    folder.mkdir(parents=True)
    rows.to_csv(folder / "indentations.csv", index=False)
    (folder / "session.yaml").write_text(SESSION.format(name=folder.name))
    return folder


def with_forces(
    rows: pd.DataFrame, loaded: np.ndarray, slope: np.ndarray, hidden: str, seed: int
) -> pd.DataFrame:
    """Return the rows with forces (R, 3) [N] under load, with errors of the contact point along their slope, and noise."""
    rng = np.random.default_rng(seed)
    under = (rows["phase"] != "zero").to_numpy()
    press = pd.factorize(rows["press"][under])[0]
    force = rng.normal(0, NOISE_N, (len(rows), 3))
    factor = HIDDEN[hidden](rows["x_mm"][under].to_numpy(), rows["y_mm"][under].to_numpy())
    force[under] += factor[:, None] * (
        loaded + rng.normal(0, CONTACT_POINT_MM, press.max() + 1)[press][:, None] * slope
    )
    return rows.assign(**dict(zip(FORCES, force.round(5).T)))


def clocks() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--sites", type=int, default=5, help="positions along each side")
    parser.add_argument("--hidden", choices=HIDDEN, default="gain")
    parser.add_argument("--unloading", action="store_true", help="read every press during unloading too")
    parser.add_argument("--study", type=Path, default=Path("config/paper.yaml"))
    arguments = parser.parse_args()
    study = load_study(arguments.study)
    found = []

    def told(what: str, began: tuple[float, float]) -> None:
        wall, cpu = (now - then for now, then in zip(clocks(), began))
        found.append({"what": what, "wall [s]": wall, "CPU [s]": cpu})
        print(f"{what}: {wall:.0f} s, {cpu:.0f} CPU s", flush=True)

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        solver = Solver(study, laws_of(study, []), {}, folder / "kept", workers=arguments.workers)
        began = clocks()
        plain = write(folder / "plain", planned(study, arguments.sites, arguments.unloading, 0))
        problem, base = problem_of(solver, observe([plain], study.sensor, 1.0))
        judge(replace(problem, forces_with=at_first_order(problem)), study.mismatch, study.seed)
        told(f"{arguments.sites**2} positions x {len(DEPTHS)} depths screened, from nothing", began)
        # readings in the order of the recording, as the observations have them
        first = with_forces(
            planned(study, arguments.sites, arguments.unloading, 0),
            base.context.force,
            base.context.slope(),
            arguments.hidden,
            1,
        )
        began = clocks()
        verdict = judge_recording(solver, [write(folder / "first", first)], folder / "out", "first")
        told("refitted and judged, beyond that", began)
        began = clocks()
        again = with_forces(
            planned(study, arguments.sites, arguments.unloading, 0),
            base.context.force,
            base.context.slope(),
            "nothing",
            2,
        )
        second = judge_recording(solver, [write(folder / "second", again)], folder / "again", "second")
        told("second recording of the same plan judged, nothing hidden", began)
    print()
    print(pd.DataFrame(found).to_markdown(index=False, floatfmt=".0f"))
    print(
        f"\nverdict on hidden {arguments.hidden} (SYNTHETIC): {verdict.state}, {[group.names for group in verdict.answer]}"
        f"\n{verdict.sentence}\nand on nothing hidden: {second.state}"
    )


if __name__ == "__main__":
    main()
