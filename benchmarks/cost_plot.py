"""Cost against the number of unknowns and of cells, measured, on log-log axes: a PNG and the slopes.

Left: CPU seconds and peak memory of one cell (centre of the paper's sensor, 8 depths, error bars included) on meshes of
several sizes, each in a process of its own. Right: seconds of all jobs of a finished run up to its n-th cell, in the order
in which they ended, as Snakemake measured them; a mirrored cell is a job too.

usage: python benchmarks/cost_plot.py [--near 0.6 0.45 0.3 0.2] [--study config/config.yaml] [--results results/demo]
       [--out docs/figures/cost.png]      (one thread; about two minutes)
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from cell_cost import run
from matplotlib.ticker import NullFormatter
from paper_study import job

from gelforge.config import load_study
from gelforge.indentation.plan import plan_cells
from gelforge.report.style import FAINT, MEASURED, SIMULATED, new_figure, styled

CENTRE = (16.0, 16.0)
MiB_PER_GB = 1e9 / 2**20


def of_meshes(sizes: list[float]) -> pd.DataFrame:
    """Return unknowns, CPU seconds and peak memory of the centre's cell at several element sizes [mm] under the ball."""
    script = str(Path(__file__).with_name("cell_cost.py"))
    rows = []
    for near in sizes:
        printed = run([sys.executable, script, "--one", *map(str, (*CENTRE, near))])
        rows.append(json.loads(printed.splitlines()[-1]))
    return pd.DataFrame(rows)[["near [mm]", "unknowns", "CPU [s]", "wall [s]", "peak [MiB]", "status"]]


def of_cells(study: str, results: Path) -> tuple[pd.DataFrame, str]:
    """Return number of cells and seconds of their jobs up to then, and what the run was."""
    described = load_study(study)
    planned = plan_cells(described)
    files = {name: results / "benchmarks" / "cells" / f"{name}.tsv" for name in planned}
    jobs = pd.DataFrame([job(file) for file in files.values() if file.is_file()])
    if jobs.empty:
        raise SystemExit(
            f"{results}: no job of a cell was measured there; run its cells with Snakemake first"
        )
    jobs = jobs.sort_values("end", ignore_index=True)
    solved = sum(cell.source is None for cell in planned.values())
    words = f"study {described.study}: {len(jobs)} cells, {solved} of them solved, the others mirrored"
    return pd.DataFrame({"cells": np.arange(len(jobs)) + 1, "seconds": jobs["job_s"].cumsum()}), words


def slope(x: pd.Series, y: pd.Series) -> float:
    """Return the exponent of the power law through the points."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


@styled
def cost_figure(meshes: pd.DataFrame, cells: pd.DataFrame, words: str):
    """Return the two panels."""
    figure, axes = new_figure(8.6, 3.4, ncols=2)
    left, right = axes[0]
    for column, colour, marker, label in (
        ("CPU [s]", SIMULATED, "o", "CPU seconds"),
        ("peak [GB]", MEASURED, "s", "peak memory [GB]"),
    ):
        exponent = slope(meshes["unknowns"], meshes[column])
        left.loglog(
            meshes["unknowns"],
            meshes[column],
            marker + "-",
            color=colour,
            label=f"{label}, slope {exponent:.2f}",
        )
    left.set_xticks(meshes["unknowns"], [f"{count:,}" for count in meshes["unknowns"]])
    left.xaxis.set_minor_formatter(NullFormatter())
    left.set_xlabel("unknowns of the cell")
    left.set_title("One cell, 8 depths, error bars included")
    first = cells["seconds"].iloc[0] * cells["cells"]
    right.loglog(cells["cells"], first, "--", color=FAINT, label="each as dear as the first")
    right.loglog(cells["cells"], cells["seconds"], "-", lw=2, color=SIMULATED, label="measured")
    right.set_xlabel("cells")
    right.set_ylabel("seconds of all jobs")
    right.set_title(words.replace(": ", ":\n", 1), fontsize=9)
    for ax in (left, right):
        ax.grid(True, which="both")
        ax.legend(loc="upper left")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--near", type=float, nargs="+", default=[0.6, 0.45, 0.3, 0.2])
    parser.add_argument("--study", default="config/config.yaml")
    parser.add_argument(
        "--results", type=Path, help="its results folder, if it is another than the study's own"
    )
    parser.add_argument("--out", type=Path, default=Path("docs/figures/cost.png"))
    arguments = parser.parse_args()
    cells, words = of_cells(arguments.study, arguments.results or load_study(arguments.study).results_folder)
    meshes = of_meshes(arguments.near).sort_values("unknowns", ignore_index=True)
    meshes["peak [GB]"] = meshes["peak [MiB]"] / MiB_PER_GB
    print(meshes.round(3).to_markdown(index=False), "\n")
    for column in ("CPU [s]", "peak [GB]"):
        print(f"slope of {column} over unknowns: {slope(meshes['unknowns'], meshes[column]):.2f}")
    later = cells[cells["cells"] >= 4]  # the first ones are each their own mesh and position
    print(f"{words}; slope of job seconds over cells: {slope(later['cells'], later['seconds']):.2f}")
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    cost_figure(meshes, cells, words).savefig(arguments.out, dpi=110, metadata={"Software": None})
    print(f"written to {arguments.out}")


if __name__ == "__main__":
    main()
