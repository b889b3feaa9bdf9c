"""What was found, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.evidence.alternatives import UNKNOWN
from gelforge.mismatch.goodness.scan import Finding
from gelforge.mismatch.inference.answer import Answer, Group
from gelforge.mismatch.inference.discrepancy import Modelled
from gelforge.mismatch.inference.judge import Judgement
from gelforge.mismatch.model.effect_words import in_general, with_amount
from gelforge.mismatch.result import verdict as form
from gelforge.mismatch.summary.effect_entries import blocks_of, value_entries
from gelforge.mismatch.summary.model_section import in_words
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.terms.refit import End

MORE = "What further indentations would show: `gelforge mismatch plan`."
LIKELY = 0.5  # of something, from where it is probably there


def sentence_of(problem: Problem, judgement: Judgement) -> str:
    """Return the verdict in one plain sentence."""
    state, mismatch, answer = judgement.state, judgement.mismatch, judgement.answer
    if state == "consistent":
        return (
            f"Simulation and readings agree within their errors (p = {mismatch.p:.2g}); no physics is missing that these "
            "readings could show."
        )
    if answer is None and state == "inconclusive":
        return (
            f"Simulation and readings agree within their errors (p = {mismatch.p:.2g}), but these readings could not show "
            f"plausible values of most effects. {MORE}"
        )
    where = f"Simulation and readings differ beyond their errors, most clearly {plain(mismatch.scan.best)}"
    if state == "modelled":
        return f"{where}; it is something that no known effect explains: {_model(judgement)}."
    if state == "form_free" and judgement.modelled.sure:
        return f"{where}; {_beside(problem, judgement)}{_module(judgement.modelled)}."
    if answer is None:
        return f"{where}; no effect of the catalogue could be fitted."
    if state == "inconclusive":
        best = _joined(problem, answer, answer.groups)
        chance = min(group.probability for group in answer.groups)
        return f"{where}; these readings are too few to say why (probability {chance:.2g}: {best}). {MORE}"
    if state == "unexplained":
        why = _why_unexplained(problem, judgement)
        return f"{where}; it is something that no known effect explains{_manner(judgement)}: {why}."
    if state == "ambiguous":
        likely = sorted(answer.groups, key=lambda group: -group.probability)
        chances = " and ".join(f"{group.probability:.2f}" for group in likely)
        return f"{where}; most probably ({chances}) {_joined(problem, answer, likely)}."
    rest = [group for group in answer.groups if group not in answer.sure]
    found = f"{where}; {_joined(problem, answer, answer.sure)}{_also(problem, answer, rest)}"
    if state == "form_free":
        return f"{found}, in a form of its own or together with a discrepancy: {_model(judgement)}."
    return f"{found}{_unknown_too(judgement)}."


def _joined(problem: Problem, answer: Answer, groups: Sequence[Group]) -> str:
    """Return what acts together."""
    return "; together with this, ".join(_in_words(problem, answer, group) for group in groups)


def _also(problem: Problem, answer: Answer, groups: Sequence[Group]) -> str:
    """Return what is not sure, in addition to what is."""
    return "".join(
        f"; {'probably' if group.probability >= LIKELY else 'possibly'} also ({group.probability:.2f})"
        f" {_in_words(problem, answer, group)}"
        for group in groups
    )


def _in_words(problem: Problem, answer: Answer, group: Group) -> str:
    """Return an effect with its value, what cannot be distinguished from it, and what else may be there instead."""
    name = group.members[0]
    k = [part.name for part in answer.fit.parts].index(name)
    part, amounts, effect = answer.fit.parts[k], answer.fit.amounts[k], problem.effects[name]
    own = name.replace("_", " ")
    if part.switch:
        own += "".join(f", {key.replace('_', ' ')} {value}" for key, value in part.shape.items())
    else:
        own += " " + _clearest(value_entries(effect.parameters, amounts, blocks_of(answer.fit)[k]))
    text = f"{with_amount(effect, part.shape, tuple(amounts))} ({own})"
    if len(group.members) > 1:
        text += "".join(f", or {in_general(other)}" for other in group.members[1:])
        text += ", which these readings cannot distinguish"
    if group.or_else:
        text += f", or else {' or '.join(in_general(other) for other in group.or_else)}"
    return text


def _clearest(amounts: Sequence[form.Amount]) -> str:
    """Return the value that stands out most from none, with its interval; by name where there are several."""

    def clear(amount: form.Amount) -> float:
        low, high = amount.interval_90
        return abs(amount.value) / max(high - low, np.finfo(float).tiny)

    best = max(amounts, key=clear)
    unit = "" if best.unit == "1" else f" {best.unit}"
    low, high = best.interval_90
    which = f"{best.name} ".replace("_", " ") if len(amounts) > 1 else ""
    return f"{which}{best.value:+.2g}{unit}, 90 % interval {low:.2g} to {high:.2g}"


def _why_unexplained(problem: Problem, judgement: Judgement) -> str:
    """Return why the best answer is none."""
    answer = judgement.answered
    best = f"the best of the known, that {_joined(problem, answer, answer.groups)},"
    if answer.adequacy.p <= form.LEFT_P:
        return f"{best} leaves a residual, most clearly {plain(answer.adequacy.scan.best)}"
    if judgement.out_of_range:
        return f"{best} would need a value that is not physical"
    return f"{best} would fit, but is less likely"


def _manner(judgement: Judgement) -> str:
    """Return what a discrepancy would do, where it is likely."""
    strange = judgement.posterior.holding([UNKNOWN]) > LIKELY
    return f", a change of {judgement.answered.discrepancy_words}" if strange else ""


def _model(judgement: Judgement) -> str:
    """Return what is modelled without a known cause."""
    model = judgement.modelled
    largest = np.abs(model.change).max()
    where = "correction.csv has it" if model.of_place else "it does not concern labels"
    return (
        f"a change of {model.manner}, {largest:.2g} N at most, predicts held-out readings and is modelled as a smooth"
        f" function, its cause unknown ({where})"
    )


def _beside(problem: Problem, judgement: Judgement) -> str:
    """Return the sure effects together with which a cause acts."""
    if not judgement.modelled.beside:
        return ""
    return f"{_joined(problem, judgement.answered, judgement.answered.sure)}; together with this, "


def _module(model: Modelled) -> str:
    """Return a cause with a free form and how well it predicts."""
    return (
        f"{in_words(model)} (probability {model.probability:.2g}; module.csv has the map); with it held-out readings"
        f" are predicted better (log score {model.gain.total:+.2g})"
    )


def _unknown_too(judgement: Judgement) -> str:
    manner = _manner(judgement)
    chance = judgement.posterior.holding([UNKNOWN])
    return f"; probably also ({chance:.2f}) something that no known effect explains{manner}" if manner else ""


def plain(finding: Finding) -> str:
    """Return a pattern of the scan in words that follow "most clearly"."""
    name, _, kind = finding.name.rpartition(", ")  # the last comma: places hold one of their own
    before = {"depth": "", "position": "", "axis": "", "wave": "as a ", "phase": "in "}.get(finding.kind, "")
    if finding.kind == "depth" and name[0] == "d":
        before = "at "
    how = {"share of the force": " in proportion to the force"}.get(kind, f" in the {kind}" if kind else "")
    return f"{before}{name}{how}"


def experiments_in_words(groups: Sequence[form.Group]) -> list[form.Experiment]:
    """Return the experiments that the effects' own files name for what cannot be distinguished."""
    return [
        form.Experiment(words=group.decided_by, separates=group.names) for group in groups if group.decided_by
    ]


def left_over(judgement: Judgement) -> list[str]:
    """Return what an answer that is given leaves, where that is too little to doubt it and too much to pass over."""
    if judgement.state not in (*form.IDENTIFIED, "ambiguous"):
        return []
    left = judgement.answered.adequacy
    if left.p > form.ADEQUATE_P:
        return []
    return [
        f"something small may be there in addition to the answer, most clearly {plain(left.scan.best)}: as much is left by"
        f" chance with p = {left.p:.2g}; below {form.LEFT_P:g} nothing would have been identified"
    ]


def unfinished(answer: Answer | None) -> list[str]:
    """Return which fits were cut short: their values would still change by more than their intervals show."""
    fits = [] if answer is None else [*answer.refits.values(), answer.fit]
    names = dict.fromkeys(fit.name.replace("_", " ") for fit in fits if fit.end is End.MOVING)
    if not names:
        return []
    return [
        f"{', '.join(names)}: the fit was still moving after its last step, or the solver could not"
        " follow it; values and intervals are not final"
    ]


def uncomputed(problem: Problem) -> list[str]:
    """Return which effects could not be tried, or not everywhere, by reason."""
    tried = {one.name for one in problem.candidates}
    by_reason: dict[str, dict[str, None]] = {}
    for name, reason in problem.failed.items():
        effect = name.split("@")[0].split(".")[0]
        where = " (at some of its places or times)" if effect in tried else ""
        by_reason.setdefault(reason, {})[f"{effect}{where}"] = None
    return [f"{', '.join(names)} could not be tried: {reason}" for reason, names in by_reason.items()]
