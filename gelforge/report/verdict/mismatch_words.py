"""Numbers, values and states of a verdict as its page says them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from gelforge.mismatch.result.verdict import Amount, Group, NamedEffect, Unknown, Verdict
from gelforge.report.verdict.mismatch_maps import chance_text, pretty

UNITS = ("_mm", "_s", "_deg")  # that end the keys of a shape
STATES = {
    "consistent": "simulation and readings agree",
    "identified": "a known cause explains the difference",
    "form_free": "a known cause explains the difference, its form was fitted",
    "modelled": "the difference is modelled, its cause is unknown",
    "ambiguous": "several causes are possible, none is sure",
    "inconclusive": "these readings cannot decide",
    "unexplained": "no known cause explains the difference",
}
STATE_MEANS = {
    "consistent": "Simulation and readings differ by no more than the errors that were allowed for.",
    "identified": "One explanation is at least nine times as probable as all others together, and leaves nothing but noise."
    " Effects that change these readings in the same way count as one.",
    "form_free": "Which physics is missing is known; its dependence was fitted freely, as no known form of it suffices.",
    "modelled": "The mismatch is real and no known effect explains it. A model of the difference predicts held-out readings;"
    " it says nothing of the cause.",
    "ambiguous": "The mismatch is real and narrowed down, but no explanation is as probable as a claim has to be.",
    "inconclusive": "Plausible values of missing physics would not show in these readings, or not clearly enough.",
    "unexplained": "The mismatch is real. What the catalogue knows does not explain all of it, and no name is given to the"
    " rest.",
}


def group_text(group: Group) -> str:
    """Return the effects of a group: members, then those of another pattern."""
    names = " or ".join(pretty(name) for name in group.members)
    return names + "".join(f", or else {pretty(name)}" for name in group.or_else)


def answer_text(verdict: Verdict) -> str:
    """Return each group of the answer with its probability and the value of its first effect, one to a line."""
    effects = {effect.name: effect for effect in verdict.effects}
    lines = []
    for group in verdict.answer:
        values = [
            f"{pretty(group.members[0])} {_amount_text(amount)}, 90 % interval"
            for amount in effects[group.members[0]].amounts
        ]
        lines.append("; ".join([f"{group_text(group)}: {chance_text(group.probability)}", *values]))
    return "\n".join(lines)


def amounts_text(effect: NamedEffect) -> str:
    """Return an effect's values with unit and 90 % interval."""
    return "; ".join(_amount_text(amount) for amount in effect.amounts)


def _amount_text(amount: Amount) -> str:
    unit = "" if amount.unit in ("", "-", "1") else f" {amount.unit}"
    low, high = amount.interval_90
    return f"{pretty(amount.name)} {amount.value:+.2g}{unit} ({low:+.2g} to {high:+.2g})"


def unbroken(text: str, between: str = "; ") -> str:
    """Return a text whose parts stand on lines of their own in a table, and are broken before a bracket only."""
    return "\n".join(part.replace(" ", "\u00a0").replace("\u00a0(", " (") for part in text.split(between))


def p_text(p: float) -> str:
    """Return a probability of chance, never a bare zero."""
    return "p < 0.0001" if p < 1e-4 else f"p = {p:.2g}"


def number(value: float | None) -> float:
    return np.nan if value is None else float(value)


def span_text(span: tuple[float, float] | None) -> str | None:
    return None if span is None else f"{span[0]:.3g} to {span[1]:.3g}"


def shape_text(shape: Mapping[str, float | str]) -> str:
    """Return an effect's place, part or time, two to a line: "x 9.07 mm, y 13 mm; z -3 mm, radius 1.2 mm"."""
    found = []
    for key, value in shape.items():
        name, _, unit = key.rpartition("_") if key.endswith(UNITS) else (key, "", "")
        said = value if isinstance(value, str) else f"{value:.3g}"
        found.append(" ".join(filter(None, (pretty(name), said, unit))))
    return "; ".join(", ".join(found[k : k + 2]) for k in range(0, len(found), 2))


def odds_text(log_odds: float) -> str:
    return "> 1000" if log_odds > np.log(1000) else f"{np.exp(log_odds):.2g}"


def unknown_text(unknown: Unknown | None) -> str:
    """Return how probable a discrepancy is, and what it would change."""
    if unknown is None:
        return ""
    return (
        f", that something is missing that no known effect explains {chance_text(unknown.probability)}"
        f" (it would change {unknown.words})"
    )


def filled(rows: list[dict]) -> pd.DataFrame:
    """Return rows as a table without the columns that say nothing."""
    return pd.DataFrame(rows).dropna(axis="columns", how="all")
