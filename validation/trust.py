"""How reliable verdicts are: docs/results/verdicts.md, from the archived verdicts on sealed sets. SYNTHETIC.

`python -m validation trust` writes the page.
"""

from __future__ import annotations

from pathlib import Path

from .archive import ARCHIVES
from .pooled import BY_EFFECT, TODAY, archived, table
from .truths import read_truths

PAGE = Path(__file__).parents[1] / "docs" / "results" / "verdicts.md"
HEAD = """\
# Verdicts on sealed sets

Written by `python -m validation trust` from archived verdicts; [how reliable verdicts are](../validation.md) explains them.
All recordings are SYNTHETIC: another finite-element code made them, and their truths were sealed before they were judged.
The twentieth set has a small sensor without friction, the twenty-first a wide one with friction. Here every effect states
the error of its form. In the last column all effects share one prior of this error, and both sensors are in it.
Rates have 95 % intervals; SNR is the signal-to-noise ratio of what is hidden.

"""


def page(archives: Path = ARCHIVES) -> str:
    """Return the page as Markdown: the scores of each set, those of today's judge together."""
    truths = read_truths()
    judged = {name: archived(archives / f"{name}.tar.xz", truths[name]) for name in (*BY_EFFECT, *TODAY)}
    columns = {name: judged[name] for name in BY_EFFECT}
    columns[" and ".join(TODAY)] = [case for name in TODAY for case in judged[name]]
    return f"{HEAD}{table(columns)}\n"
