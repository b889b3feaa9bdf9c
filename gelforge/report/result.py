"""The opening of the report: the result of a study in a few sentences and a small table."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from gelforge.mismatch.result.verdict import VerdictError
from gelforge.report.chapters.chapter import Chapter, count, millinewtons, newtons
from gelforge.report.chapters.network_words import beside_baselines
from gelforge.report.chapters.results_reader import SIGMAS, StudyResults
from gelforge.report.verdict.mismatch_chapters import FOLDER
from gelforge.report.verdict.mismatch_reader import MismatchResults
from gelforge.report.verdict.mismatch_words import answer_text

COLUMNS = ["quantity", "value", "to compare with"]
Part = tuple[str, list[tuple[str, str, str]]]  # a sentence, rows of the table


def result(results: StudyResults) -> Chapter:
    """Return the result: labels, network, agreement with the force sensor, verdict, and which sites are missing."""
    chapter = Chapter("result", "The result")
    made = {name: make(results) for name, make in PARTS.items()}
    parts = [part for part in made.values() if part]
    absent = [name for name, part in made.items() if part is None]
    chapter.say(" ".join([*(sentence for sentence, _ in parts), _sites(results, absent)]))
    if rows := [row for _, rows in parts for row in rows]:
        chapter.tabulate(
            "Vertical forces; errors are root mean squares.", pd.DataFrame(rows, columns=COLUMNS)
        )
    return chapter


def _labels(results: StudyResults) -> Part | None:
    """Return the standard deviation of the labels' total force at the deepest step of each solved site."""
    rows = results.label_errors if results.study.mechanics.error_bars else pd.DataFrame()
    if rows.empty:
        return None
    deepest = rows.loc[rows.groupby("cell")["depth"].idxmax()]
    sigma = np.linalg.norm(deepest[list(SIGMAS)], axis=1)
    share = 100 * sigma / deepest["force"].abs()
    comparison = f"median force {newtons(deepest['force'].median())}; largest error bar {share.max():.2g} %"
    row = ("error bar of a label's total force, median", newtons(float(np.median(sigma))), comparison)
    return f"The total force of a label is known to {share.median():.2g} % (one standard deviation).", [row]


def _network(results: StudyResults) -> Part | None:
    """Return the network's errors on held-out sites, by bin and in total, with those of the best baseline."""
    baselines = results.table("baselines")
    standing = None if baselines is None else beside_baselines(baselines)
    if baselines is None or standing is None:
        return None
    network, best, name = standing
    totals = baselines.set_index("predictor")["total_Fz_rms_N"]
    own_total, best_total = (newtons(float(totals[predictor])) for predictor in ("network", name))
    times = f"{best / network:.2g} times less" if network < best else f"{network / best:.2g} times more"
    rows = [
        ("error of the network per pressed bin", millinewtons(network), f"{name}: {millinewtons(best)}"),
        ("error of the network in total", own_total, f"{name}: {best_total}"),
    ]
    return (
        f"In a pressed bin of a held-out site the network errs {times} than the best baseline ({name}).",
        rows,
    )


def _force_sensor(results: StudyResults) -> Part | None:
    """Return how far simulated total forces, and the network's, are from the force sensor's readings."""
    readings, errors = results.agreement, results.table("rmse")
    if readings is None or not (known := readings["ft_z_N"].notna()).any():
        return None
    off = (readings["ft_z_N"] - readings["fem_z_N"])[known]
    rms, size = (float(np.sqrt((values**2).mean())) for values in (off, readings["ft_z_N"][known]))
    resolution = f"resolution of the sensor {newtons(results.resolution_N[2])}"
    comparison = f"{resolution}; mean difference {newtons(float(off.mean()))}"
    rows = [("simulation against force sensor, total force", newtons(rms), comparison)]
    measured = None if errors is None else errors.set_index("error")["z_N"].get("RMSET_FT")
    if measured is not None and np.isfinite(measured):
        rows.append(("network against force sensor, total force", newtons(float(measured)), resolution))
    return f"Simulated and measured total force differ by {100 * rms / size:.2g} % (rms).", rows


def _verdict(results: StudyResults) -> Part | None:
    """Return what the verdict says the simulation leaves out."""
    try:
        verdict = MismatchResults(results.folder / FOLDER).verdict
    except VerdictError:
        return None
    answer = answer_text(verdict) if verdict.state != "unexplained" else ""
    return f"The verdict on the simulation: {verdict.sentence}", [("verdict", verdict.state, answer or "–")]


PARTS: dict[str, Callable[[StudyResults], Part | None]] = {
    "error bars of labels": _labels,
    "a network": _network,
    "readings of a force sensor": _force_sensor,
    "a verdict": _verdict,
}


def _sites(results: StudyResults, absent: list[str]) -> str:
    failed, planned = len(results.not_converged()), len(results.planned)
    said = (
        f"{failed} of {count(planned, 'site')} failed or are missing and have no labels"
        if failed
        else f"All {count(planned, 'site')} converged"
    )
    without = f"; not in this study: {', '.join(absent)}" if absent else ""
    return f"{said}{without}."
