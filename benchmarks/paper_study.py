"""Summary of a finished run of a study's cells: solved, mirrored, interpolated, failed, force ranges, time and memory.

usage: python benchmarks/paper_study.py [--study config/paper.yaml] [--results results/paper] [--cores 2]

Read are the cells and what Snakemake measured of each job; nothing is simulated. The run itself is
`snakemake cells --cores 2 --configfile config/paper.yaml`. Wall time is from the start of the first cell's job to the end of
the last, by the times of the benchmark files: it holds for a run that was not interrupted, and not for a copy.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import load_study
from gelforge.indentation.cells.cell_file import CellError, read_cell, read_timings
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import plan_cells

ARRAYS = ["depth_mm", "total_force_N"]
BARS = ["total_sigma_mesh_N"]


def job(path: Path) -> dict:
    """Return start, end [s since 1970], wall and CPU seconds and memory [MB] of the job that a benchmark file measured."""
    table = pd.read_csv(path, sep="\t", na_values=["-", "NA"])
    seconds, end = float(table["s"].iloc[-1]), path.stat().st_mtime
    memory = pd.to_numeric(table["max_rss"], errors="coerce").max()
    cpu = float(table["cpu_time"].iloc[-1])
    return {
        "start": end - seconds,
        "end": end,
        "job_s": seconds,
        "job_cpu_s": cpu,
        "memory_MB": float(memory),
    }


def kind(planned: PlannedCell) -> str:
    """Return how a cell's label is made."""
    return "mirrored" if planned.source else "interpolated" if planned.between else "solved"


def row(name: str, how: str, results: Path, folder: str = "cells") -> tuple[dict, pd.DataFrame]:
    """Return what is known of a cell, and its forces by depth; a file that cannot be read is missing."""
    known = {"cell": name, "kind": how}
    benchmark = results / "benchmarks" / folder / f"{name}.tsv"
    known |= job(benchmark) if benchmark.is_file() else {}
    path = results / folder / f"{name}.h5"
    timings = read_timings(path)
    known |= {name: timings.get(name, np.nan) for name in ("seconds", "cpu_seconds")}
    if "peak_memory_MB" in timings:
        known["memory_MB"] = timings["peak_memory_MB"]  # Snakemake does not see that of a fork
    try:
        cell = read_cell(path, ARRAYS, BARS)
    except CellError as error:
        return known | {"status": "missing", "reason": str(error)}, pd.DataFrame()
    a, force = cell.attributes, cell.arrays["total_force_N"]
    known |= {name: a[name] for name in ("status", "reason", "x_mm", "y_mm")}
    if "iterations" in a:  # not of an interpolated label, nor of its mirror images
        known["degrees_of_freedom"], known["iterations"] = (
            a["degrees_of_freedom"],
            int(np.sum(a["iterations"])),
        )
        known["balance"] = np.max(a["force_balance"], initial=0.0)
    by_depth = pd.DataFrame(force, columns=["Fx", "Fy", "Fz"]).assign(
        depth=np.round(cell.arrays["depth_mm"], 6)
    )
    if (bars := cell.arrays.get("total_sigma_mesh_N")) is not None:
        between = cell.arrays.get("total_sigma_interpolation_N", np.zeros_like(bars))
        by_depth["sigma"] = np.hypot(bars, between)[:, 2]
    return known, by_depth


def bulk_jobs(results: Path) -> list[dict]:
    """Return what is known of the jobs that make mirrored and interpolated cells."""
    return [
        job(path) | {"kind": "bulk"} for path in sorted((results / "benchmarks" / "derived").glob("*.tsv"))
    ]


def facts(cells: pd.DataFrame, places: pd.DataFrame, bulk: pd.DataFrame, cores: int) -> pd.DataFrame:
    """Return quantity and value of the run as a whole; places: sites that are solved between those of the plan."""
    made = cells.kind.where(cells.status == "converged", "failed or missing").value_counts()
    jobs = pd.concat([cells, places, bulk])
    wall = jobs["end"].max() - jobs["start"].min()
    busy = jobs["job_s"].sum()
    cells = pd.concat([cells, places])
    solved = cells.kind == "solved"
    cpu = cells.loc[solved, "cpu_seconds"]
    of_jobs = cells.loc[solved, "job_s"]
    facts = [
        ("positions", int(made.sum())),
        *(
            (name, int(made.get(name, 0)))
            for name in ("solved", "mirrored", "interpolated", "failed or missing")
        ),
        ("sites solved between them", len(places)),
        ("unknowns of a solved cell", _range(cells.loc[solved, "degrees_of_freedom"], "{:.0f}")),
        (
            "Newton iterations of a solved cell, median (largest)",
            _median(cells.loc[solved, "iterations"], "{:.0f}"),
        ),
        ("worst force balance", f"{cells.balance.max():.0e}"),
        ("wall, first job's start to last job's end", f"{wall / 60:.1f} min"),
        ("seconds of all jobs / cores / wall", f"{busy / cores / wall:.2f}"),
        ("CPU of all jobs, Snakemake's own process aside", f"{jobs['job_cpu_s'].sum() / 60:.1f} min"),
        ("CPU in solving", f"{cpu.sum() / 60:.1f} min"),
        ("CPU of a solved cell, median (largest)", _median(cpu, "{:.1f} s")),
        ("job of a solved cell, median (largest)", _median(of_jobs, "{:.1f} s")),
        (
            "the job beyond its solution, median (largest)",
            _median(of_jobs - cells.loc[solved, "seconds"], "{:.2f} s"),
        ),
        ("seconds of all bulk jobs", f"{bulk['job_s'].sum():.0f} s of {len(bulk)}"),
        ("memory of a process, median (largest)", _median(cells.loc[solved, "memory_MB"], "{:.0f} MB")),
    ]
    return pd.DataFrame(facts, columns=["quantity", "value"])


def _median(values: pd.Series, form: str) -> str:
    values = values.dropna()
    return f"{form.format(values.median())} ({form.format(values.max())})" if len(values) else "none"


def _range(values: pd.Series, form: str) -> str:
    values = values.dropna()
    return f"{form.format(values.min())} to {form.format(values.max())}" if len(values) else "none"


def force_table(forces: pd.DataFrame) -> pd.DataFrame:
    """Return the ranges of total forces over all converged cells by depth, and how sure Fz is of the mesh."""
    rows = []
    for depth, at in forces.groupby("depth"):
        ranges = {
            f"{name} [N]": f"{at[name].min():+.4f} to {at[name].max():+.4f}" for name in ("Fx", "Fy", "Fz")
        }
        median = {"Fz, median [N]": f"{at.Fz.median():+.4f}"}
        if "sigma" in at:
            relative = 100 * at.sigma / at.Fz.abs()
            median["sigma of Fz, median (largest) [%]"] = f"{relative.median():.2f} ({relative.max():.2f})"
        rows.append({"depth [mm]": depth, "cells": len(at)} | ranges | median)
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--study", default="config/paper.yaml")
    parser.add_argument(
        "--results", type=Path, help="its results folder, if it is another than the study's own"
    )
    parser.add_argument("--cores", type=int, default=2, help="how many the run had")
    arguments = parser.parse_args()
    study = load_study(arguments.study)
    results = arguments.results or study.results_folder
    read = [row(planned.name, kind(planned), results) for planned in plan_cells(study).values()]
    sites = sorted((results / "solved_sites").glob("*.h5"))
    between = [row(path.stem, "solved", results, "solved_sites")[0] for path in sites]
    tables = cells, _, _ = [
        _with_columns(pd.DataFrame(rows))
        for rows in ([known for known, _ in read], between, bulk_jobs(results))
    ]
    print(
        f"{study.study}: {study.indenter.words}, error bars {'stored' if study.mechanics.error_bars else 'not stored'}\n"
    )
    print(facts(*tables, arguments.cores).to_markdown(index=False), "\n")
    good = [forces for known, forces in read if known["status"] == "converged"]
    if good:
        print(force_table(pd.concat(good)).to_markdown(index=False), "\n")
    failed = cells[cells.status != "converged"]
    if len(failed):
        print(failed[["cell", "x_mm", "y_mm", "status", "reason"]].to_markdown(index=False))


def _with_columns(cells: pd.DataFrame) -> pd.DataFrame:
    """Return the table with the columns of a run that measured and solved everything; empty where this one did not."""
    of_jobs = ["kind", "start", "end", "job_s", "job_cpu_s", "memory_MB"]
    of_cells = ["seconds", "cpu_seconds", "degrees_of_freedom", "iterations", "balance"]
    return cells.reindex(
        columns=[*cells.columns, *(name for name in of_jobs + of_cells if name not in cells)]
    )


if __name__ == "__main__":
    main()
