"""The chapters of a verdict about its answer: what is missing, before and after, and on held-out readings."""

from __future__ import annotations

from math import exp, log

from gelforge.mismatch.result.scores import HeldOut, Score
from gelforge.mismatch.result.verdict import Experiment, Group, Model, Verdict
from gelforge.mismatch.thresholds import HELD_OUT_ODDS
from gelforge.progress import duration
from gelforge.report.chapters.chapter import Chapter, Facts
from gelforge.report.figures.neighbours import MAP_SITES
from gelforge.report.verdict.mismatch_maps import before_after_figure
from gelforge.report.verdict.mismatch_reader import MismatchResults
from gelforge.report.verdict.mismatch_words import (
    MOST_NAMES,
    chance_text,
    filled,
    p_text,
    pretty,
    span_text,
    two_digits,
    unbroken,
    value_text,
)

BLOCKS = {"all": "all held out", "positions": "other positions", "deepest": "deepest indentations"}


def answer(results: MismatchResults) -> Chapter:
    """Return what is missing, the readings before and after, and in folds what was tried and what would decide."""
    chapter, verdict = Chapter("answer", "What is missing"), results.verdict
    causes = len(verdict.answer)
    if verdict.answer and verdict.state == "unexplained":
        chapter.say("Known causes, of which the most probable ones do not explain the readings:")
    for k, group in enumerate(verdict.answer, start=1):
        _tabulate_set(chapter, verdict, group, f"Cause {k} of {causes}, p" if causes > 1 else "P")
    if not verdict.answer and not verdict.model:
        chapter.say(f"That nothing is missing has probability {chance_text(verdict.null_probability)}.")
    if verdict.model:
        _tabulate_model(chapter, verdict.model, results.axes)
    elif verdict.unknown is not None and verdict.state == "unexplained":
        chance = chance_text(verdict.unknown.probability)
        chapter.say(f"An unknown cause has probability {chance}. It changes {verdict.unknown.words}.")
    show_before_after(chapter, results)
    _tell_tests(chapter.fold("Tests of the readings and of the residual"), verdict)
    _tell_tried(chapter.fold(f"All {len(verdict.effects)} effects that were tried"), verdict)
    _tell_experiments(chapter.fold("Experiments that would distinguish the causes"), verdict)
    return chapter


def _tabulate_set(chapter: Chapter, verdict: Verdict, group: Group, begin: str) -> None:
    """Add the credible set of one cause, the leading effect first."""
    effects, several = {effect.name: effect for effect in verdict.effects}, len(group.names) > 1
    rows = [
        {
            "effect": unbroken(pretty(name)),
            "share": chance_text(group.shares[name]) if name in group.shares and several else None,
            "value (90 % interval), place": value_text(effects[name]),
            "same line": None if not several else "" if name == group.names[0] else name in group.members,
        }
        for name in group.names[:MOST_NAMES]
    ]
    one = f": one of these {len(group.names)} effects" if several else ""
    words = f"{begin}robability {chance_text(group.chance)}{one}."
    chapter.tabulate(words, filled(rows), [name != group.names[0] for name in group.names[:MOST_NAMES]])
    if rest := group.names[MOST_NAMES:]:
        chapter.say(f"And {', '.join(map(pretty, rest))}, whose shares and values stand below.")
    if several and group.differs_N is not None and group.differs_snr is not None:
        patch = "; one patch serves for all" if group.one_patch else ""
        size = f"{two_digits(group.differs_N)} N rms at most, {two_digits(group.differs_snr)} σ in all{patch}"
        chapter.say(
            f"No reading of this plan distinguishes effects of the same line. Predictions differ by {size}."
        )


def _tabulate_model(chapter: Chapter, model: Model, axes: list[str]) -> None:
    """Add what is modelled, with a cause of free form or without one, where it holds, and what it predicts."""
    if model.sure:
        words = f"Probability {chance_text(model.probability or 0.0)}: a cause with a free form, its map in module.csv."
    else:
        words = "Modelled without a known cause, and not extrapolated."
    row = {
        "what it changes": model.words,
        "together with": "\n".join(map(pretty, model.with_effects)) or None,
        "at most": f"{two_digits(max(model.largest_N['xyz'.index(axis)] or 0.0 for axis in axes))} N",
        "learnt from": f"{span_text(model.depth_mm)} mm at {model.sites} positions",
        "held-out log score": f"{model.held_out.gain:+.3g} ± {model.held_out.standard_error:.2g}",
    }
    correction = " Correction of simulated forces: correction.csv." if model.corrects_labels else ""
    chapter.tabulate(words + correction, filled([row]))


def show_before_after(chapter: Chapter, results: MismatchResults) -> None:
    """Add the maps before and after, or why there are none."""
    if results.verdict.sensor is None:
        chapter.miss("No maps: these readings are not of a sensor's surface.")
        return
    seen = (
        "Where the maps after are white, the answer explains the readings."
        if results.has_after
        else "Nothing was put into the simulation."
    )
    mean = f"of the {MAP_SITES} nearest sites" if results.has_one_depth_each else "at a site"
    chapter.show(
        f"Measured minus simulated force. {seen} A square is the mean over the loading {mean}, a dark frame was held out."
        " Errors that were allowed for give 1 σ. Where Fz is red, the sensor pushes back less than simulated.",
        before_after_figure(results),
    )


def _tell_tests(chapter: Chapter, verdict: Verdict) -> None:
    test, left = verdict.mismatch, verdict.adequacy
    chances = {
        "Mismatch (chi-square)": test.p,
        "Strongest pattern, corrected for the search": test.scan_p,
        "Evidence for a discrepancy (at most)": test.unknown_p,
        "Evidence for known effects (at most)": test.known_p,
    }
    facts = [(name, p_text(p)) for name, p in chances.items() if p is not None]
    if left:
        facts.append(
            (
                "After the answer",
                f"{left.words}: {p_text(left.p)}, of the strongest pattern {p_text(left.scan_p)}",
            )
        )
    chapter.add(Facts(facts))


def _tell_tried(chapter: Chapter, verdict: Verdict) -> None:
    """Add all effects, the most probable first; those of the answer with their share of its probability."""
    if not verdict.effects:
        chapter.miss("No effect was tried.")
        return
    chances = {effect.name: chance_text(effect.probability) for effect in verdict.effects}
    for group in verdict.answer:
        chances |= {
            name: f"{chance_text(share)} of {chance_text(group.chance)}"
            for name, share in group.shares.items()
        }
    rows = [
        {
            "effect": unbroken(pretty(effect.name)),
            "probability": unbroken(chances[effect.name]),
            "log Bayes factor": round(effect.log_bayes_factor, 1),
            "signal over noise": effect.snr and round(effect.snr, 1),
            "value (90 % interval), place or time": value_text(effect),
            "possible": effect.in_range,
            "judged in": unbroken("solver" if effect.refitted else "first order"),
        }
        for effect in verdict.effects
    ]
    none = f"That nothing is missing has probability {chance_text(verdict.null_probability)}"
    if verdict.unknown is not None:
        chance = chance_text(verdict.unknown.probability)
        none += f", that an unknown cause acts {chance} (it would change {verdict.unknown.words})"
    chapter.tabulate(f"{none}. A value must also be physically possible.", filled(rows))


def _tell_experiments(chapter: Chapter, verdict: Verdict) -> None:
    """Add the experiments that would distinguish what these readings cannot."""
    for group in verdict.answer:
        if group.decided_by:
            chapter.say(f"{', '.join(map(pretty, group.names))}: {group.decided_by.rstrip('.')}.")
    if verdict.next_experiments:
        chapter.tabulate(
            "First what is expected to decide, where its cost and odds are known.",
            filled([_experiment_row(experiment) for experiment in verdict.next_experiments]),
        )


def _experiment_row(experiment: Experiment) -> dict:
    odds, seconds = experiment.expected_log_odds, experiment.cost_s
    said = "" if odds is None else "> 1000" if odds > log(1000) else two_digits(exp(odds))
    return {
        "experiment": experiment.words,
        "distinguishes": ", ".join(pretty(name) for name in experiment.separates),
        "indentations": experiment.presses,
        "time": None if seconds is None else unbroken(duration(seconds)),
        "expected odds": None if odds is None else unbroken(f"{said} : 1"),
    }


def held_out(results: MismatchResults) -> Chapter:
    """Return the errors before and after on blocks that were held out, and on all readings."""
    chapter, fit = Chapter("held-out", "On held-out readings"), results.verdict.fit
    blocks = [] if fit.held_out is None else [fit.held_out, *fit.held_out_blocks]
    rows = [_errors(BLOCKS.get(b.block, b.block), b.before, b.after, results.axes) | _gain(b) for b in blocks]
    rows.append(_errors("all, fitted ones included", fit.before, fit.after, results.axes))
    words = (
        "Root mean square errors, before → after: the answer, fitted to the other readings, predicts these. Less the"
        f" penalty of selection, a gain counts above two standard errors or {log(HELD_OUT_ODDS):.1f}. It decides nothing."
        if blocks
        else "Nothing was put into the simulation, so there is nothing to try on held-out readings."
    )
    chapter.tabulate(words, filled(rows))
    if fit.flow:
        after = "" if fit.flow.rmse_after_px is None else f", {fit.flow.rmse_after_px:.3g} px after"
        chapter.say(
            f"The images' flow was {fit.flow.used}: error {fit.flow.rmse_before_px:.3g} px before{after};"
            f" as much before by chance alone: {p_text(fit.flow.p)}."
        )
    return chapter


def _errors(name: str, before: Score, after: Score | None, axes: list[str]) -> dict:
    """Return the errors of each axis, before and after."""
    row: dict = {"readings": name, "values": before.readings}
    for axis in axes:
        k = "xyz".index(axis)
        values = [score.rmse_N[k] for score in (before, after) if score and score.rmse_N[k] is not None]
        row[f"F{axis}_N"] = unbroken(" → ".join(f"{value:.3g}" for value in values)) or None
    return row


def _gain(block: HeldOut) -> dict:
    return {
        "log score gains": unbroken(f"{block.gain:+.3g} ± {block.standard_error:.2g}"),
        "penalty": f"{block.selection_penalty:.2g}" if block.selection_penalty else None,
        "counts": block.shown,
    }
