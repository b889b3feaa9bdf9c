"""How far to trust a verdict: the figures of docs/mismatch.md, from the archived verdicts of today's judge. SYNTHETIC.

They stand in the page between BEGIN and END; `python -m validation trust` writes them there.
"""

from __future__ import annotations

from pathlib import Path

from .archive import ARCHIVES
from .pooled import TODAY, archived, scores
from .score import CONFIDENT, STRONG
from .truths import read_truths

PAGE = Path(__file__).parents[1] / "docs" / "mismatch.md"
BEGIN, END = "<!-- from here on by python -m validation trust -->\n\n", "\n<!-- until here -->\n"
ROWS = {  # words of the page: the score of `pooled`
    f"of the names of probability {CONFIDENT:g} and more, right": f"claims of probability {CONFIDENT:g} and more: right",
    f"one effect with an SNR of {STRONG:g} and more: identified": f"single, SNR >= {STRONG:g}: identified",
    "the same: identified, or among the effects of an `ambiguous` answer": f"single, SNR >= {STRONG:g}: identified, or in"
    " an ambiguous answer",
    "two effects at once: both identified": "pair: both identified",
    "nothing is missing: a mismatch is reported": "nulls: a mismatch is reported",
    "the catalogue lacks the effect: no name is given": "outside the catalogue, all: not named",
}


def figures(archives: Path = ARCHIVES) -> str:
    """Return the table as Markdown: each rate with its 95 % interval over the sets of today's judge."""
    truths = read_truths()
    cases = [case for name in TODAY for case in archived(archives / f"{name}.tar.xz", truths[name])]
    found = scores(cases)
    rows = "".join(f"| {words} | {found[score]} |\n" for words, score in ROWS.items())
    return f"| {len(cases)} concealed recordings (SYNTHETIC) | rate (95 % interval) |\n|:--|:--|\n{rows}"


def with_figures(page: str, table: str) -> str:
    """Return the page with the table between BEGIN and END; raises ValueError where it lacks one of them."""
    before, _, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not end:
        raise ValueError(
            f"no {BEGIN.strip()!r} followed by {END.strip()!r}; put both lines where the table is to stand"
        )
    return f"{before}{BEGIN}{table}{END}{after}"
