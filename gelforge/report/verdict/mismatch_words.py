"""Numbers, values and states of a verdict as its page says them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from gelforge.mismatch.result.verdict import Amount, NamedEffect, Unknown, Verdict
from gelforge.report.verdict.mismatch_maps import chance_text, pretty

UNITS = ("_mm", "_s", "_deg")  # that end the keys of a shape
STATES = {
    "consistent": "simulation and readings agree",
    "identified": "a known cause explains the difference",
    "ambiguous": "several causes are possible",
    "inconclusive": "these readings cannot decide",
    "unexplained": "no known cause explains the difference",
}
STATE_MEANS = {
    "consistent": "Simulation and readings differ by no more than the errors that were allowed for.",
    "identified": "A known cause, or causes with the same sensitivities, has a probability of 0.9 or more.",
    "ambiguous": "The mismatch is real. At most eight causes hold 95 % of the probability, and none has 0.9.",
    "inconclusive": "Plausible missing physics would not show in these readings, or too many causes are left.",
    "unexplained": "The mismatch is real, and no known cause explains all of it.",
}


def answer_text(verdict: Verdict) -> str:
    """Return each group of the answer with its probability and the value of its first effect, one to a line."""
    effects = {effect.name: effect for effect in verdict.effects}
    lines = []
    for group in verdict.answer:
        values = [
            f"{pretty(group.members[0])} {_amount_text(amount)}, 90 % interval"
            for amount in effects[group.members[0]].amounts
        ]
        chance = chance_text(group.set_probability or group.probability)
        lines.append("; ".join([f"{' or '.join(map(pretty, group.names))}: {chance}", *values]))
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
