"""The catalogue as docs/effects.md: `python docs/effects_table.py` writes it anew."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

from gelforge.files import write_text
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.model.effect import FAMILIES, Effect, Parameter

PAGE = Path(__file__).parent / "effects.md"
HEAD = """\
# Effects that a verdict may name

Written by `python docs/effects_table.py` from `gelforge/mismatch/effects/`, one file for each effect;
they also hold the source of every number. A parameter is `name [unit] width, from .. to`: the
standard deviation of its prior, that is a plausible value, and the physical range. 0 is the effect's absence; a range that
begins at 0 leaves one sign only. [mismatch-method.md](mismatch-method.md) says how a verdict is reached.

| effect | family | parameters | signature | distinguished by |
|---|---|---|---|---|
"""


def page(catalogue: Mapping[str, Effect]) -> str:
    """Return the whole of docs/effects.md: a row per effect, families in their order, and who does not act on forces."""
    ranked = sorted(catalogue.values(), key=lambda effect: (FAMILIES.index(effect.family), effect.name))
    unforced = [effect.name for effect in ranked if effect.to_forces is None]
    foot = f"\nNot tried on forces, as they change images only: {', '.join(unforced)}.\n" if unforced else ""
    return HEAD + "".join(map(row, ranked)) + foot


def row(one: Effect) -> str:
    """Return the effect's line of the table."""
    amounts = "on or off" if one.binary else parameters(one.parameters)
    cells = (one.name, one.family, amounts, one.signature, one.separated_by)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def parameters(found: Sequence[Parameter]) -> str:
    """Return parameters in words, neighbours that differ by name only in one."""
    said = []
    for (unit, width, (low, high)), group in groupby(found, key=lambda p: (p.unit, p.width, p.bounds)):
        names = ", ".join(p.name for p in group)
        said.append(f"{names} [{'-' if unit == '1' else unit}] {width:g}, {low:g} .. {high:g}")
    return "; ".join(said)


if __name__ == "__main__":
    write_text(PAGE, page(CATALOGUE))
