"""Errors and cost of training rows that are moved from solved presses: labels and particle motion at places not solved.

usage: python benchmarks/synthesis.py [results/simulated] [--straight 12] [--paths 6]
       (one thread; after `snakemake --cores 2 --configfile config/simulated.yaml`; solves presses of its own, some ten CPU
       seconds each)

SYNTHETIC. Prints Markdown tables: straight presses between sites, in the middle and within six millimetres of a side;
sideways paths of the study's own indenter from solved paths of the same depth elsewhere; CPU seconds of a row.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import argparse  # noqa: E402
import time  # noqa: E402
from dataclasses import replace  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
from transfer import laws_of  # noqa: E402

from gelforge.config import Study, load_study  # noqa: E402
from gelforge.indentation.cells.cell_file import Cell, read_cell, read_timings  # noqa: E402
from gelforge.indentation.paths.planned_cell import PlannedCell  # noqa: E402
from gelforge.synthesis.draws import site_places, solution  # noqa: E402
from gelforge.synthesis.images import series_features  # noqa: E402
from gelforge.synthesis.moved import DrawnPress, MovedPresses  # noqa: E402
from gelforge.synthesis.rows import Presses, solve  # noqa: E402
from gelforge.virtual_lab.particles import interpolation, place_particles  # noqa: E402

NEAR_MM = 6.0  # of a side
DEPTHS = (0.09, 0.3, 0.65, 1.15, 1.6, 1.95)  # between the solved ones [mm]
STEPS = 5  # down and aside
SEED = 4711


def errors(study: Study, press: DrawnPress, cell: Cell, step: int, particles: np.ndarray) -> dict[str, float]:
    """Return the errors of a drawn press against its own solution: bins that carry force, total, particle motion."""
    true = cell.arrays["bin_force_N"][step]
    away, loaded = press.bins(study.sensor) - true, true[:, 2] != 0
    weights = interpolation(cell.arrays["gel_node_mm"], cell.arrays["gel_hex"], particles)
    motion = weights @ cell.arrays["gel_displacement_mm"][step].astype(float)
    return {
        "bins z, rms [mN]": 1e3 * np.sqrt((away[loaded, 2] ** 2).mean()),
        "bins x and y, rms [mN]": 1e3 * np.sqrt((away[loaded, :2] ** 2).mean()),
        "largest bin z [mN]": 1e3 * np.abs(true[:, 2]).max(),
        "total z [mN]": 1e3 * away[:, 2].sum(),
        "total horizontal [mN]": 1e3 * np.linalg.norm(away[:, :2].sum(axis=0)),
        "motion, rms [um]": 1e3 * np.sqrt(((press.moved(particles) - motion)[:, :2] ** 2).mean()),
    }


def straight(study: Study, laws: dict, source: Presses, count: int, particles: np.ndarray) -> pd.DataFrame:
    rng, rows = np.random.default_rng(SEED), []
    sample = solution(study, 0)
    for number in range(count):
        place = np.round(rng.uniform(source.straight.low, source.straight.high), 4)
        cell = solve(replace(sample, planned=PlannedCell(f"t{number}", *map(float, place), DEPTHS)), laws)
        side = min(*place, *(np.array([study.sensor.width_x_mm, study.sensor.width_y_mm]) - place))
        for step, depth in enumerate(cell.arrays["depth_mm"]):
            found = errors(study, source.straight.at(place, float(depth)), cell, step, particles)
            rows.append(
                {"place": "near a side" if side < NEAR_MM else "middle", "depth [mm]": depth, **found}
            )
    return pd.DataFrame(rows).groupby(["place", "depth [mm]"]).agg(lambda v: np.sqrt((v**2).mean()))


def sideways_path(study: Study, laws: dict, at: np.ndarray, depth: float, way: np.ndarray) -> Cell:
    """Return a solved path of the study's own indenter: down to a depth, then aside by (2,) [mm]."""
    depths = [depth * (k + 1) / STEPS for k in range(STEPS)] + [depth] * STEPS
    shears = [(0.0, 0.0)] * STEPS + [tuple(map(float, way * k / STEPS)) for k in range(1, STEPS + 1)]
    phases = ("load",) * STEPS + ("shear",) * STEPS
    place = map(float, np.round(at, 4))
    planned = PlannedCell("path", *place, tuple(depths), phases=phases, shears_mm=tuple(shears))
    return solve(replace(solution(study, 0), planned=planned), laws)


def sideways(study: Study, laws: dict, source: Presses, count: int, particles: np.ndarray) -> pd.DataFrame:
    """Return errors of sideways paths solved in the middle and moved to other places, turned by other angles."""
    rng, rows, width = np.random.default_rng(SEED + 1), [], study.sensor.width_x_mm
    free = source.moved.free_mm
    for _ in range(count):
        depth, way = rng.uniform(0.6, study.synthesis.depth_mm[1]), rng.uniform(0.4, 1.2)
        angle, place = rng.uniform(0, 2 * np.pi), np.round(rng.uniform(free, width - free, 2), 4)
        middle = sideways_path(study, laws, np.full(2, width / 2), depth, np.array([way, 0.0]))
        there = sideways_path(study, laws, place, depth, way * np.array([np.cos(angle), np.sin(angle)]))
        moved = MovedPresses(study, [middle], [True], source.straight)
        for step in range(STEPS, 2 * STEPS):
            found = errors(study, moved.turned(0, step, place, angle), there, step, particles)
            push = 1e3 * np.linalg.norm(there.arrays["total_force_N"][step][:2])
            share = round((step - STEPS + 1) / STEPS, 2)
            rows.append({"sideways [share]": share, "horizontal force [mN]": push, **found})
    return pd.DataFrame(rows).groupby("sideways [share]").agg(lambda v: np.sqrt((v**2).mean()))


def cost(study: Study, source: Presses) -> str:
    """Return the CPU seconds of drawn rows, in words."""
    rng, begin = np.random.default_rng(SEED), time.process_time()
    presses = [source.draw(rng) for _ in range(400)]
    drawn = time.process_time()
    for part in range(25):
        list(series_features(study, presses[16 * part : 16 * part + 16], f"cost {part}", rng))
    done = time.process_time()
    press, images = (drawn - begin) / 400, (done - drawn) / 400
    return f"a row {press + images:.3f} CPU s: press {press:.3f}, image and flow {images:.3f}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="?", type=Path, default=Path("results/simulated"))
    parser.add_argument("--straight", type=int, default=12)
    parser.add_argument("--paths", type=int, default=6)
    arguments = parser.parse_args()
    study = load_study(arguments.results / "study.yaml")
    laws = laws_of(arguments.results, study)
    files = sorted((arguments.results / "synthetic" / "solved").glob("*.h5"))
    solved = [read_cell(path) for path in files]
    source = Presses(study, solved)
    particles = place_particles(study.synthesis.particles, study.sensor, "compared")
    seconds = sum(read_timings(path)["cpu_seconds"] for path in files)
    counts = f"{len(site_places(study))} sites and {len(source.moved.cells)} paths solved"
    print(f"{counts}, {seconds:.0f} CPU s; {cost(study, source)}\n")
    print(straight(study, laws, source, arguments.straight, particles).to_markdown(floatfmt=".3g"))
    print("\nsideways paths, moved from the middle and turned:\n")
    print(sideways(study, laws, source, arguments.paths, particles).to_markdown(floatfmt=".3g"))


if __name__ == "__main__":
    main()
