"""Time and memory per stage, from Snakemake's benchmark files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.indentation.cells.cell_file import read_timings

CELL_STAGE, TRUTH_STAGE = "cells", "virtual_truth"


def stage_times(results: str | Path, cells: set[str], truth: Path | None = None) -> pd.DataFrame:
    """Return one row per stage: stage, jobs, total_s, longest_s, memory_MB (largest resident set of a job).

    A file benchmarks/<stage>/<job>.tsv of the results belongs to <stage>; benchmarks/<job>.tsv is a stage of its own, or
    one of the sites if it bears a site's name. truth: the folder of a virtual lab's sites. Where a file has the memory of no
    more than the process that waited for a fork, a site's own file says it.
    """
    folder = Path(results) / "benchmarks"
    rows = []
    for path in sorted(folder.rglob("*.tsv")) if folder.is_dir() else []:
        table = pd.read_csv(path, sep="\t", na_values=["-", "NA"])
        job = path.relative_to(folder)
        parents = job.parent.parts
        product = truth / job.name if truth and parents == (TRUTH_STAGE,) else Path(results) / job
        stage = parents[0] if parents else CELL_STAGE if path.stem in cells else path.stem
        memory = pd.to_numeric(table.get("max_rss", pd.Series(dtype=float)), errors="coerce")
        # MB: between a process that waits for its fork (11) and one that has imported a numerical library (60)
        memory = memory[memory > 40.0].max()
        memory_MB = read_timings(product).get("peak_memory_MB", np.nan)
        rows.append((stage, float(table["s"].sum()), float(np.fmax(memory, memory_MB))))
    jobs = pd.DataFrame(rows, columns=["stage", "seconds", "memory_MB"])
    grouped = jobs.groupby("stage", as_index=False).agg(
        jobs=("seconds", "size"),
        total_s=("seconds", "sum"),
        longest_s=("seconds", "max"),
        memory_MB=("memory_MB", "max"),
    )
    return grouped.sort_values("total_s", ascending=False, ignore_index=True)
