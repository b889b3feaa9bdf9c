"""What was found, in words."""

from __future__ import annotations

from gelforge.mismatch import verdict as form
from gelforge.mismatch.effects_told import groups_told
from gelforge.mismatch.judge import Judgement
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.refit import End
from gelforge.mismatch.scan import Finding
from gelforge.mismatch.search import Answer

MORE = "What further presses would show: `gelforge mismatch plan`."


def sentence_of(problem: Problem, judgement: Judgement) -> str:
    """Return the verdict in one plain sentence."""
    state, mismatch = judgement.state, judgement.mismatch
    if state == "null":
        return (
            f"Simulation and readings agree within their errors (p = {mismatch.p:.2g}); no physics is missing that these "
            "readings could show."
        )
    if judgement.answer is None and state == "insufficient":
        return (
            f"Simulation and readings agree within their errors (p = {mismatch.p:.2g}), but these readings could not show "
            f"plausible amounts of most effects. {MORE}"
        )
    where = f"Simulation and readings differ beyond their errors, most clearly {plain(mismatch.scan.best)}"
    if judgement.answer is None:
        return f"{where}; no effect of the catalogue could be fitted."
    words = _answer_words(problem, judgement)
    if state == "open":
        return f"{where}; no effect of the catalogue explains it: {_why_open(judgement, words)}{_manner(judgement)}."
    if state == "insufficient" and not judgement.answer.fit.converged:
        return (
            f"{where}; {words} would fit, but its fit in the solver has not come to rest: no name is given."
        )
    if state == "insufficient" and judgement.answer.gain is not None and judgement.answer.gain.clear:
        return f"{where}; {words} would fit, but nothing is likely enough to be named: too few readings to say. {MORE}"
    if state == "insufficient":
        return f"{where}; {words} would fit, but the readings set aside do not confirm it: too few to say. {MORE}"
    beside = (
        f"; something unknown may be there too, a change of {judgement.answer.stranger}"
        if judgement.strange
        else ""
    )
    return f"{where}; it is explained by {words}{beside}."


def _why_open(judgement: Judgement, words: str) -> str:
    """Return why the best answer, in words, is none."""
    answer = judgement.answer
    if answer.adequacy.p <= form.LEFT_P:
        return f"the best, {words}, leaves something, most clearly {plain(answer.adequacy.scan.best)}"
    if judgement.refuted:
        everywhere = answer.everywhere
        most = f", most clearly {plain(everywhere.scan.best)}" if everywhere.p <= form.ADEQUATE_P else ""
        return (
            f"the best, {words}, fits the readings that it was fitted to, but those set aside refute it{most}"
        )
    if judgement.out_of_range:
        return f"the best, {words}, would need an amount that is not physical"
    if judgement.strange:
        return f"the best, {words}, would fit, but something unknown is likelier"
    return f"the readings set aside refute one effect alone, and {words} would fit, but nothing is likely enough to be named"


def _manner(judgement: Judgement) -> str:
    """Return what something unknown would do, where it is likely."""
    return f"; it would be a change of {judgement.answer.stranger}" if judgement.strange else ""


def _answer_words(problem: Problem, judgement: Judgement) -> str:
    """Return the effects of the answer with amounts and what cannot be told from them; what is not claimed at the end."""
    answer, found, rest = judgement.answer, [], []
    with_others = judgement.state != "insufficient"
    for part, amounts, group in zip(answer.final.fit.parts, answer.final.fit.amounts, answer.groups):
        if with_others and group not in judgement.told:
            rest.append(part.name.replace("_", " "))
            continue
        effect = problem.effects[part.name]
        values = " and ".join(
            f"{p.name} {a:.3g} {'' if p.unit == '1' else p.unit}".rstrip()
            for p, a in zip(effect.parameters, amounts)
        )
        told = ", ".join(f"{key.replace('_', ' ')} {value}" for key, value in part.shape.items())
        own = part.name.replace("_", " ") + (
            f" ({told if part.switch else values})" if told or not part.switch else ""
        )
        others = [name.replace("_", " ") for name in group.members if name != part.name and with_others]
        found.append(
            own + (f", or {', '.join(others)}, which these readings cannot tell from it" if others else "")
        )
    little = f", beside something that these readings cannot name ({' and '.join(rest)} fits)" if rest else ""
    return " together with ".join(found) + little


def plain(finding: Finding) -> str:
    """Return a pattern of the scan in words that follow "most clearly"."""
    name, _, kind = finding.name.rpartition(", ")  # the last comma: places hold one of their own
    before = {"depth": "", "position": "", "axis": "", "wave": "as a ", "phase": "as "}.get(finding.kind, "")
    if finding.kind == "depth" and name[0] == "d":
        before = "at "
    how = {"share of the force": " in proportion to the force"}.get(kind, f" as a {kind}" if kind else "")
    return f"{before}{name}{how}"


def experiments_in_words(problem: Problem, judgement: Judgement) -> list[form.Experiment]:
    """Return the experiments that the effects' own files name for what cannot be told apart."""
    if judgement.answer is None:
        return []
    return [
        form.Experiment(words=group.decided_by, separates=group.members)
        for group in groups_told(problem, judgement.answer.groups)
        if group.decided_by
    ]


def left_over(judgement: Judgement) -> list[str]:
    """Return what an answer that is told leaves, where that is too little to doubt the answer and too much to pass over."""
    if not judgement.told or judgement.state == "open" or judgement.answer.adequacy.p > form.ADEQUATE_P:
        return []
    left = judgement.answer.adequacy
    return [
        f"something small may be there beside the answer, most clearly {plain(left.scan.best)}: as much is left by chance"
        f" with p = {left.p:.2g}; below {form.LEFT_P:g} nothing would have been named"
    ]


def unfinished(answer: Answer | None) -> list[str]:
    """Return which refits were cut short: their amounts would still change by more than their intervals show.

    Not those that were broken off far behind the best.
    """
    fits = [] if answer is None else [fit for fit in answer.refits if fit.end is End.MOVING]
    names = [fit.name.replace("_", " ") for fit in fits]
    if not names:
        return []
    text = (
        f"{', '.join(names)}: the fit was still moving after its last step, or the solver could not"
        " follow it; amounts and intervals are not final"
    )
    return [text + ("" if answer.fit.converged else ", and the answer rests on one of them: it is not named")]


def uncomputed(problem: Problem) -> list[str]:
    """Return which effects could not be tried, or not everywhere, by reason."""
    tried, by_reason = {one.name for one in problem.candidates}, {}
    for name, reason in problem.failed.items():
        effect = name.split("@")[0].split(".")[0]
        where = " (at some of its places or times)" if effect in tried else ""
        by_reason.setdefault(reason, {})[f"{effect}{where}"] = None
    return [f"{', '.join(names)} could not be tried: {reason}" for reason, names in by_reason.items()]
