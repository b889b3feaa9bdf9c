"""What was found, in words."""

from __future__ import annotations

from gelforge.mismatch.evidence.gaussian import NOTHING
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.inference.judge import Answer, Judgement
from gelforge.mismatch.result import verdict as form
from gelforge.mismatch.thresholds import ADEQUATE_P, ALARM_P, LEFT_P


def sentence_of(problem: Problem, judgement: Judgement) -> str:
    """Return the headline, 25 words at most: causes with their values, or by name where these do not fit.

    All values and alternatives stand in the answer.
    """
    in_full = _headline(problem, judgement, brief=False)
    return in_full if len(in_full.split()) <= 25 else _headline(problem, judgement, brief=True)


def _headline(problem: Problem, judgement: Judgement, brief: bool) -> str:
    state, answer = judgement.state, judgement.answer
    if state == "consistent":
        p, nothing = judgement.mismatch.p, judgement.posterior.probability[NOTHING]
        if p < ALARM_P:
            return (
                f"One test differs (p = {p:.2g}), but that nothing is missing stays probable ({nothing:.2f});"
                " more indentations would decide."
            )
        return f"Simulation and readings agree within their errors (p = {p:.2g})."
    if answer is None and state == "inconclusive":
        return "Simulation and readings agree, but these readings could not show plausible values of most effects."
    if state == "identified":
        return _capital(_identified(problem, judgement, brief))
    if state == "unexplained":
        return f"Readings differ, and no known cause explains it: {_why_unexplained(judgement)}."
    assert answer is not None  # of the two states that are left
    leading = max(answer.groups, key=lambda group: group.chance)
    count, clause = len(leading.names), _clause(problem, answer, leading, brief)
    if state == "inconclusive":
        return f"Simulation and readings differ; these readings leave {count} causes, most probably {clause}."
    possible = "one cause is possible" if count == 1 else f"{count} causes are possible"
    share = 100 * leading.shares[leading.members[0]]
    return f"Simulation and readings differ; {possible}, most probably {clause} (share {share:.0f} %)."


def _identified(problem: Problem, judgement: Judgement, brief: bool) -> str:
    """Return what is missing, the surest first, with the smallest probability among these."""
    claims = []
    if judgement.model is not None and judgement.model.sure:
        module = judgement.model.module
        assert module is not None  # of a cause
        claims.append((_plain_name(module.name) if brief else module.says, judgement.model.probability))
    if judgement.answer is not None and (judgement.model is None or judgement.model.with_effects):
        claims += [
            (_clause(problem, judgement.answer, group, brief), group.probability)
            for group in sorted(judgement.answer.sure, key=lambda group: -group.probability)
        ]
    said = ", and ".join(clause for clause, _ in claims[:2])
    more = f", and {len(claims) - 2} more" if len(claims) > 2 else ""
    left_out = "the simulation leaves out: " if brief else ""
    return f"{left_out}{said}{more} (probability {min(chance for _, chance in claims):.2f})."


def _clause(problem: Problem, answer: Answer, group: form.Group, brief: bool) -> str:
    """Return what an effect of the answer means at its value, or its name, and whether its line has others."""
    k = [part.name for part in answer.fit.parts].index(group.members[0])
    part, theta = answer.fit.parts[k], answer.fit.theta[k]
    if brief:
        return _plain_name(part.name) + (" or another of its line" if len(group.members) > 1 else "")
    said = problem.effects[part.name].in_words(part.hyperparameters, tuple(theta))
    if part.binary and "coefficient" not in part.hyperparameters:
        said += "".join(f" ({value})" for value in part.hyperparameters.values())
    return said + (" or an indistinguishable cause" if len(group.members) > 1 else "")


def _plain_name(name: str) -> str:
    return name.replace("_", " ")


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def _why_unexplained(judgement: Judgement) -> str:
    """Return why the best answer is none."""
    if judgement.model is not None:
        return f"a change of {judgement.model.kernel.words} predicts held-out readings"
    if judgement.answer is None:
        return "no effect is probable enough, or none could be fitted"
    if judgement.out_of_range:
        return "the best one needs a value that is not physical"
    if judgement.answer.adequacy.p <= LEFT_P:
        return "the best one leaves a residual"
    return f"a change of {judgement.posterior.discrepancy_words} is more probable"


def shortcomings(problem: Problem, judgement: Judgement) -> list[str]:
    """Return what an answer leaves, which fits are not final, and which effects could not be tried."""
    return [*_left_over(judgement), *_unfinished(judgement.answer), *uncomputed(problem)]


def _left_over(judgement: Judgement) -> list[str]:
    """Return what an answer that is given leaves, where that is too little to doubt it and too much to pass over."""
    if judgement.answer is None or judgement.state == "unexplained":
        return []
    left = judgement.answer.adequacy
    if left.p > ADEQUATE_P:
        return []
    if left.p <= LEFT_P:  # then a cause is modelled, next to the answer or in its place
        if judgement.model is None or not judgement.model.with_effects:
            return []
        return [
            f"the answer leaves more than noise (p = {left.p:.2g}), most clearly {left.scan.best.name}: a change of"
            f" {judgement.model.kernel.words} is modelled next to it"
        ]
    return [
        f"something small may be there in addition to the answer, most clearly {left.scan.best.name}: as much is left by"
        f" chance with p = {left.p:.2g}; below {LEFT_P:g} nothing would have been identified"
    ]


def _unfinished(answer: Answer | None) -> list[str]:
    """Return which fits were cut short: their values would still change by more than their intervals show."""
    fits = [] if answer is None else [*answer.refits.values(), answer.fit]
    names = dict.fromkeys(fit.name.replace("_", " ") for fit in fits if not fit.converged)
    if not names:
        return []
    return [
        f"{', '.join(names)}: the fit was still moving after its last step, or the solver could not"
        " follow it; values and intervals are not final"
    ]


def uncomputed(problem: Problem) -> list[str]:
    """Return which effects could not be tried, or not everywhere, by reason.

    Parameters
    ----------
    problem : Problem
        Its candidates, and what failed.

    Returns
    -------
    list of str
        A line for each reason.
    """
    tried = {one.name for one in problem.candidates}
    by_reason: dict[str, dict[str, None]] = {}
    for name, reason in problem.failed.items():
        effect = name.split("@")[0].split(".")[0]
        where = " (at some of its places or times)" if effect in tried else ""
        by_reason.setdefault(reason, {})[f"{effect}{where}"] = None
    return [f"{', '.join(names)} could not be tried: {reason}" for reason, names in by_reason.items()]
