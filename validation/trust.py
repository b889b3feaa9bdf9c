"""How reliable verdicts are: docs/results/verdicts.md, from the archived verdicts on sealed sets. SYNTHETIC.

`python -m validation trust` writes the page.
"""

from __future__ import annotations

from pathlib import Path

from .archive import ARCHIVES
from .pooled import BY_EFFECT, ONE_PRIOR, TODAY, archived, table
from .truths import read_truths

PAGE = Path(__file__).parents[1] / "docs" / "results" / "verdicts.md"
HEAD = """\
# Verdicts on sealed sets

Written by `python -m validation trust` from archived verdicts; [how reliable verdicts are](../validation.md) explains them.
All recordings are SYNTHETIC: another finite-element code made them, and their truths were sealed before they were judged.
Today's judge answered the twenty-fourth set, of the small sensor without friction, and the twenty-fifth, of a wide one with
friction. The error bars of nominal forces have changed since. Earlier judges answered the others: the
twenty-second and twenty-third hold both sensors, the twentieth the small one, the twenty-first a wide one with friction.
Rates have 95 % intervals; SNR is the signal-to-noise ratio of what is hidden.

"""


def page(archives: Path = ARCHIVES) -> str:
    """Return the page as Markdown: the scores of each set, those of today's judge first."""
    truths = read_truths()
    judged = {
        name: archived(archives / f"{name}.tar.xz", truths[name]) for name in (*BY_EFFECT, *ONE_PRIOR, *TODAY)
    }
    lots = [(name,) for name in TODAY] + [ONE_PRIOR] + [(name,) for name in BY_EFFECT]
    columns = {" and ".join(names): [case for name in names for case in judged[name]] for names in lots}
    return f"{HEAD}{table(columns)}\n"
