"""The chapters of a verdict about its answer: effects in their order, held-out readings, what is undecided."""

from __future__ import annotations

from math import log

import pandas as pd

from gelforge.mismatch.result.verdict import HELD_OUT_ODDS, Experiment, HeldOut, Model, Score
from gelforge.report.chapters.chapter import Chapter
from gelforge.report.verdict.mismatch_curves import held_out_figure, profile_figure
from gelforge.report.verdict.mismatch_maps import chance_text, pretty
from gelforge.report.verdict.mismatch_reader import MismatchResults
from gelforge.report.verdict.mismatch_words import (
    amounts_text,
    filled,
    number,
    odds_text,
    p_text,
    shape_text,
    unbroken,
    unknown_text,
)

RANKED = 12  # effects in the table; the others are named below it


def ranking(results: MismatchResults) -> Chapter:
    """Return all effects that were tried, the most probable first."""
    chapter, verdict = Chapter("effects", "Which physics"), results.verdict
    if not verdict.effects:
        chapter.miss("No effect was tried.")
        return chapter
    rows = [
        {
            "effect": unbroken(pretty(effect.name)),
            "probability": chance_text(effect.probability),
            "log Bayes factor": round(effect.log_bayes_factor, 1),
            "signal over noise": round(number(effect.snr), 1),
            "value (90 % interval), place or time": unbroken(
                "; ".join(filter(None, (amounts_text(effect), shape_text(effect.shape))))
            ),
            "possible": effect.in_range,
            "judged in": "solver" if effect.refitted else "first order",
        }
        for effect in verdict.effects[:RANKED]
    ]
    chapter.tabulate(
        f"What was tried, the most probable first, alone or together with others; that nothing is missing has probability"
        f" {chance_text(verdict.null_probability)}{unknown_text(verdict.unknown)}. A good fit alone names nothing: the"
        " value must also be physically possible.",
        filled(rows),
    )
    rest = verdict.effects[RANKED:]
    if rest:
        names = ", ".join(pretty(effect.name) for effect in rest)
        most = max(effect.probability for effect in rest)
        chapter.say(f"Also tried ({chance_text(most)}{' each' if most < 0.005 else ' or less'}): {names}.")
    answered = {name for group in verdict.answer for name in group.members}
    profiled = [e for e in verdict.effects if e.name in answered and any(a.profile for a in e.amounts)]
    if profiled:
        chapter.show(
            "The narrower the peak, the better the readings determine the value; shaded is the 90 % interval, and"
            " the effect's"
            " absence is at 0.",
            profile_figure(profiled),
        )
    if verdict.model:
        chapter.say(_model_text(verdict.model, results.axes))
    return chapter


def _model_text(model: Model, axes: list[str]) -> str:
    """Return in words what is modelled, with a cause of free form or without one, where it holds, and what it predicts."""
    largest = max(model.largest_N["xyz".index(axis)] or 0.0 for axis in axes)
    low, high = model.depth_mm
    beside = f" together with {' and '.join(map(pretty, model.beside))}" if model.beside else ""
    held = model.held_out
    what = (
        f"A cause with a free form, of probability {model.probability:.2g}; module.csv has its map"
        if model.sure
        else "Modelled without a known cause"
    )
    return (
        f"{what}{beside}: {model.words}, {largest:.2g} N at most, learnt from depths of {low:.3g} to"
        f" {high:.3g} mm at {model.sites} positions and not extrapolated. On held-out readings the log score gains"
        f" {held.gain:+.3g} ± {held.standard_error:.2g}."
        + (" correction.csv holds it as a correction of simulated forces." if model.corrects_labels else "")
    )


def set_aside(results: MismatchResults) -> Chapter:
    """Return the errors before and after on blocks that were held out."""
    chapter, fit = Chapter("held-out", "On held-out readings"), results.verdict.fit
    if fit.held_out is None:
        chapter.miss("Nothing was put into the simulation, so there is nothing to try on held-out readings.")
    else:
        blocks = [fit.held_out, *fit.held_out_blocks]
        chapter.show(
            "Blue should lie left of grey: with the effect in it, fitted to the other readings, the simulation predicts"
            " these. The values given elsewhere follow all readings.",
            held_out_figure(blocks, results.axes),
        )
        chapter.tabulate(
            "The held-out gain is reported and decides nothing. Less the selection penalty (these readings helped to choose"
            f" the answer) it counts above two standard errors, or above {log(HELD_OUT_ODDS):.1f}: odds of a hundred.",
            filled([_gain_row(block) for block in blocks]),
        )
    rows = [_score_row("before", fit.before)] + ([_score_row("after", fit.after)] if fit.after else [])
    chapter.tabulate("The same on all readings, those that were fitted included.", pd.DataFrame(rows))
    if fit.flow:
        after = "" if fit.flow.rmse_after_px is None else f", {fit.flow.rmse_after_px:.3g} px after"
        chapter.say(
            f"The images' flow was {fit.flow.used}: error {fit.flow.rmse_before_px:.3g} px before{after};"
            f" as much before by chance alone: {p_text(fit.flow.p)}."
        )
    return chapter


def _gain_row(block: HeldOut) -> dict:
    return {
        "held out": block.block,
        "values": block.before.readings,
        "log score before": block.before.log_score,
        "log score after": block.after.log_score,
        "gain": f"{block.gain:+.3g} ± {block.standard_error:.2g}",
        "selection penalty": f"{block.paid:.2g}" if block.paid else None,
        "counts": block.shown,
    }


def _score_row(name: str, score: Score) -> dict:
    errors = {f"rms error {axis}_N": number(value) for axis, value in zip("xyz", score.rmse_N)}
    return {"simulation": name, "values": score.readings, **errors, "log score": score.log_score}


def undecided(results: MismatchResults) -> Chapter:
    """Return the experiments that would distinguish what these readings cannot."""
    chapter, verdict = Chapter("undecided", "What to record next"), results.verdict
    for group in verdict.answer:
        if group.decided_by:
            names = ", ".join(map(pretty, group.names))
            chapter.say(f"{names}: {group.decided_by.rstrip('.')}.")
    if verdict.next_experiments:
        chapter.tabulate(
            "What to record next; first what is expected to decide, where its cost and odds are known.",
            filled([_experiment_row(experiment) for experiment in verdict.next_experiments]),
        )
    else:
        chapter.say("No further experiment is proposed.")
    return chapter


def _experiment_row(experiment: Experiment) -> dict:
    odds = experiment.expected_log_odds
    cost = experiment.cost_s
    return {
        "experiment": experiment.words,
        "distinguishes": ", ".join(pretty(name) for name in experiment.separates),
        "indentations": experiment.presses,
        "time": None if cost is None else unbroken(_time_text(cost)),
        "expected odds": None if odds is None else unbroken(f"{odds_text(odds)} : 1"),
    }


def _time_text(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
