"""Chapters about recordings and learning: agreement with F/T, predictions, error tables."""

from __future__ import annotations

import json

import numpy as np

from gelforge.indentation.sensor.unrolled import is_unrolled, place_in_bins
from gelforge.report.chapters.beside_paper import beside_paper, said_beside
from gelforge.report.chapters.chapter import Chapter, count, millinewtons
from gelforge.report.chapters.error_budget import tell_budget
from gelforge.report.chapters.network_words import network_words
from gelforge.report.chapters.results_reader import StudyResults
from gelforge.report.chapters.study_chapters import FORCE_ONLY, LABELS_ONLY
from gelforge.report.chapters.table_units import in_units_of_the_page
from gelforge.report.figures.learning.network_figure import errors_figure
from gelforge.report.figures.learning.training_figure import loss_figure
from gelforge.report.figures.simulation.force_maps import prediction_figure, total_force_figure
from gelforge.report.figures.simulation.residuals import residual_depth_figure
from gelforge.report.figures.simulation.silhouette import touched_radius_mm


def agreement(results: StudyResults) -> Chapter:
    """Return the residual of simulated against measured total force over depth."""
    chapter = Chapter("agreement", "Simulation against force/torque readings")
    if not results.study.sessions:
        return chapter.miss(f"No comparison with readings: {LABELS_ONLY}")
    if results.agreement is None:
        return chapter.miss(
            f"No comparison with readings: {results.folder / 'agreement.csv'} is not there or empty."
        )
    kind = "SYNTHETIC readings" if "recordings" in results.synthetic_parts else "readings"
    chapter.show(
        f"Measured minus simulated force ({kind}) over depth: a mean that leaves the grey band, the sensor's resolution, and"
        " grows with depth points to physics the simulation lacks.",
        residual_depth_figure(results.agreement, results.resolution_N),
    )
    return chapter.say(
        "Over position the verdict's maps show the same difference, at the end of this report."
    )


def _deepest_row(predictions: dict, score: np.ndarray) -> int | None:
    """Return the deepest touched test row among those of the smallest score, or None."""
    touched = np.flatnonzero(~predictions["untouched"].astype(bool))
    if not len(touched):
        return None
    order = np.lexsort((-predictions["depth_mm"][touched], np.round(score[touched], 3)))
    return int(touched[order[0]])


def predictions(results: StudyResults) -> Chapter:
    """Return loss curve, force maps predicted and true, and total forces."""
    chapter = Chapter("predictions", "What the network predicts")
    if not results.study.sessions:
        return chapter.miss(f"No network: {LABELS_ONLY}")
    if not results.features and results.predictions is None:
        return chapter.miss(f"No network: {FORCE_ONLY}")
    _say_how_good(chapter, results)
    _tell_onnx(chapter, results)
    tell_budget(chapter, results)
    if results.loss is not None:
        chapter.show(
            "Loss of training rows and of validation sites; the weights are those of the last step. A validation curve far"
            " above the other means overfitting.",
            loss_figure(results.loss),
        )
    else:
        chapter.miss(f"No loss curve: {results.folder / 'model' / 'loss.csv'} is not there.")
    columns = results.predictions
    if columns is None:
        return chapter.miss(f"No predictions: {results.folder / 'model' / 'predictions.h5'} is not there.")
    position, widths = columns["position_mm"], np.array(results.widths_mm)
    from_centre = np.linalg.norm(position - results.centre_mm, axis=1)
    to_edge = np.minimum(position, widths - position).min(axis=1)
    shown = []
    for place, score in (("nearest to the centre", from_centre), ("nearest to an edge", to_edge)):
        row = _deepest_row(columns, score)
        if row is None or row in shown:
            chapter.miss(f"No force map {place}: no further test row is touched.")
            continue
        shown.append(row)
        _show_map(chapter, results, row, place)
    return chapter.show(
        "Total force summed from the predicted map: points on the grey line are exact.",
        total_force_figure(columns["total_predicted_N"], columns["total_true_N"]),
    )


def _say_how_good(chapter: Chapter, results: StudyResults) -> None:
    """Say in a paragraph and a figure how good the network is, where its tables are there."""
    baselines, by, reliability, errors = (
        results.table(name) for name in ("baselines", "errors_by", "reliability", "rmse")
    )
    if baselines is None or by is None or reliability is None or errors is None:
        return
    steady = results.loss if results.study.learning.network == "paper" else None
    has_budget = results.table("error_budget") is not None
    synthesis = results.study.synthesis
    only_simulated = synthesis is not None and synthesis.train_on == "simulated"
    chapter.say(network_words(baselines, by, reliability, errors, steady, only_simulated, has_budget))
    chapter.show(
        "RMSES on held-out sites, the rms error over the bins whose label is not zero, of the vertical force: the network"
        " and its baselines, and the network by depth, distance from the nearest wall and session.",
        errors_figure(baselines, by),
    )


def _tell_onnx(chapter: Chapter, results: StudyResults) -> None:
    """Say how far forces by ONNX Runtime are from the network's own, where the study compares them."""
    path = results.folder / "model" / "onnx_check.json"
    if path.is_file():
        onnx = json.loads(path.read_text(encoding="utf-8"))
        chapter.say(
            f"Exported to ONNX, the network gives the same forces on {count(onnx['images'], 'held-out image')}: bins differ"
            f" by {millinewtons(onnx['largest_difference_N'])} at most, of up to {millinewtons(onnx['largest_N'])}."
        )


def _show_map(chapter: Chapter, results: StudyResults, row: int, place: str) -> None:
    columns, bins = results.predictions, results.study.sensor.bins
    assert columns is not None  # row is one of theirs
    predicted, true = results.predicted_map(row)
    x, y = columns["position_mm"][row]
    sensor = results.study.sensor
    depth = float(columns["depth_mm"][row])
    radius = touched_radius_mm(results.study.indenter, depth)
    chapter.show(
        f"Held-out site {columns['cell'][row]} {place}, indenter at ({x:g}, {y:g}) mm, {depth:g} mm deep: left and"
        " middle are predicted and true, the right is their difference, on one colour scale per row. The dashed circle is"
        " where the indenter cuts the undeformed surface"
        + (", which is drawn unrolled." if is_unrolled(sensor) else "."),
        prediction_figure(
            predicted, true, bins.nx, bins.ny, results.widths_mm, place_in_bins(sensor, x, y), radius
        ),
    )


TABLES = {
    "rmse": "Errors of the network on held-out sites, and on rows that it was trained on, rms{with the paper's (another"
    " sensor, 13,448 indentations)}.",
    "baselines": "The network and baselines on the same rows and inputs: ridge, kernel ridge, nearest neighbours, inverse"
    " elasticity, the mean label of training, no force at all. RMSES: rms error of the bins whose label is not zero; total"
    " Fz: rms error of the sum over bins.",
    "errors_by": "The same errors of the network by depth, by distance from the nearest wall and from the nearest training"
    " site, and by session (of touched rows), and the share whose total is not that of inverse elasticity.",
    "error_budget": "Parts of the network's error on held-out sites of the virtual sensor (SYNTHETIC), rms: optics and"
    " learning make the error against the label, mechanics is that of the label. The contact point's scatter is in learning"
    " and in mechanics.",
    "reliability": "How far to trust the network on held-out sites. A share far from 0.9 in the 90 % intervals means that"
    " the validation sites differ from these. Measured totals are readings. Their noise and what the labels lack of the"
    " real gel are not in the interval.",
    "rmse_gt": "Total force, force/torque sensor (F/T) minus simulation (FEM). RMSE_GT: rms of the difference over all"
    " indentations{with the paper's}.",
    "force_ranges": "Range of the labels{with the paper's}.",
}


WITH_TRUTH = {
    "error_budget"
}  # of recordings whose truth is known; the chapter on predictions says why it is not there


def error_tables(results: StudyResults) -> Chapter:
    """Return the tables of the evaluation, of the article's study with its numbers next to them."""
    chapter = Chapter("errors", "Error tables")
    for name, words in TABLES.items():
        table = results.table(name)
        if table is not None:
            shown = in_units_of_the_page(name, beside_paper(name, table, results.paper))
            chapter.tabulate(said_beside(words, results.paper), shown)
        elif name not in WITH_TRUTH and (results.study.sessions or name == "force_ranges"):
            chapter.miss(f"No table {name}: {results.folder / 'tables' / name}.csv is not there.")
    if not results.study.sessions:
        chapter.miss(f"No network and no readings to compare with: {LABELS_ONLY}")
    return chapter
