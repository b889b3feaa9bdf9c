"""Numbers, values and states of a verdict as its page says them."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from gelforge.mismatch.result.verdict import NamedEffect, ParameterEstimate, Verdict

UNITS = ("_mm", "_s", "_deg")  # that end the keys of hyperparameters
NO_SHARE = ("exponent", "index_less_1")  # parameters without unit that are no share of anything
SWITCH = "on"  # parameter of an effect that is there or not
STATES = {
    "consistent": "simulation and readings agree",
    "identified": "a known cause explains the difference",
    "ambiguous": "several causes are possible",
    "inconclusive": "these readings cannot decide",
    "unexplained": "no known cause explains the difference",
}


def pretty(name: str) -> str:
    """Return an effect's name as people write it."""
    return name.replace("_", " ")


def chance_text(chance: float) -> str:
    """Return a probability as people read it: never a bare 0 or 1."""
    if chance < 0.01:
        return "< 1 %" if chance < 0.005 else "1 %"
    return "> 99 %" if chance > 0.995 else f"{100 * chance:.0f} %"


MOST_NAMES = 8  # of a credible set in a table or a cell (no result depends on it)


def answer_text(verdict: Verdict) -> str:
    """Return each set of the answer with its probability, shares and the value of its first effect, one to a line."""
    effects = {effect.name: effect for effect in verdict.effects}
    lines = []
    for group in verdict.answer:
        several = len(group.names) > 1
        names = [
            f"{pretty(name)} ({chance_text(group.shares[name])})"
            if several and name in group.shares
            else pretty(name)
            for name in group.names
        ]
        value = values_text(effects[group.members[0]])
        more = f" or {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
        said = f"{' or '.join(names[:MOST_NAMES])}{more}: {chance_text(group.chance)}"
        lines.append(f"{said}; {pretty(group.members[0])} {value}, 90 % interval" if value else said)
    return "\n".join(lines)


def values_text(effect: NamedEffect) -> str:
    """Return an effect's values with unit and 90 % interval."""
    return "; ".join(_estimate_text(one) for one in effect.parameters if one.name != SWITCH)


def _estimate_text(one: ParameterEstimate) -> str:
    scale, unit = _scale(one.name, one.unit)
    value, low, high = (two_digits(scale * x, "+") for x in (one.value, *one.interval_90))
    return f"{pretty(one.name)} {value}{unit} ({low} to {high})"


def in_unit(value: float | None, parameter: str, unit: str) -> str:
    """Return a parameter's value with two digits and its unit; shares in per cent."""
    scale, unit = _scale(parameter, unit)
    return "none" if value is None else f"{two_digits(scale * value)}{unit}"


def _scale(parameter: str, unit: str) -> tuple[float, str]:
    if unit not in ("", "1", "-"):
        return 1.0, f" {unit}"
    return (1.0, "") if parameter in NO_SHARE else (100.0, " %")


def two_digits(value: float, sign: str = "") -> str:
    """Return a number with two significant digits, 120 and not 1.2e+02."""
    return f"{float(f'{value:.2g}'):{sign}g}"


def unbroken(text: str) -> str:
    """Return a text with a line for each part ("; " separates them); lines break before a bracket only."""
    return "\n".join(part.replace(" ", "\u00a0").replace("\u00a0(", " (") for part in text.split("; "))


def p_text(p: float) -> str:
    """Return a probability of chance, never a bare zero."""
    return "p < 0.0001" if p < 1e-4 else f"p = {p:.2g}"


def span_text(span: tuple[float, float] | None) -> str | None:
    return None if span is None else f"{span[0]:.3g} to {span[1]:.3g}"


def hyperparameters_text(hyperparameters: Mapping[str, float | str]) -> str:
    """Return an effect's place, part or time, two to a line: "x 9.07 mm, y 13 mm; z -3 mm, radius 1.2 mm"."""
    texts = []
    for key, value in hyperparameters.items():
        name, _, unit = key.rpartition("_") if key.endswith(UNITS) else (key, "", "")
        said = value if isinstance(value, str) else f"{value:.3g}"
        texts.append(" ".join(filter(None, (pretty(name), said, unit))))
    return "; ".join(", ".join(texts[k : k + 2]) for k in range(0, len(texts), 2))


def value_text(effect: NamedEffect) -> str:
    """Return an effect's values with 90 % interval, and its place, part or time, each on a line."""
    return unbroken(
        "; ".join(filter(None, (values_text(effect), hyperparameters_text(effect.hyperparameters))))
    )


def filled(rows: list[dict]) -> pd.DataFrame:
    """Return rows as a table without the columns that say nothing."""
    return pd.DataFrame(rows).dropna(axis="columns", how="all")
