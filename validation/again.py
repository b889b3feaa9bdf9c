"""Sets that are opened, judged once more by today's judge, next to the former judge's verdicts on the very same cases.

A set NAME is made again as NAME_again (at its own commit), so that the verdicts of its first judging stay in
judged/NAME.tar.xz; those of today go to judged/NAME_again.tar.xz. Strong single effects come first, then cases in which
nothing is hidden, then the others. The truths choose this order, and parts of the sets have served to develop the judge:
what comes out is a hypothesis and no proof. SYNTHETIC.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from .archive import ARCHIVES
from .pooled import Scored, archived, table
from .score import CONFIDENT, STRONG, Judged, Rate
from .truths import read_truths

AGAIN = "_again"  # after the name of a set that was made again
BASES = ("concealed", "wide")  # of cases that are judged again
SURE, IN_ANSWER, MISSED = f"identified with {CONFIDENT:g} and more", "in the answer otherwise", "missed"


@dataclass(frozen=True)
class Both:
    """A case that both judges have judged."""

    truth: dict
    now: Scored
    former: Scored

    @property
    def strong(self) -> bool:
        """Return whether it hides one strong effect."""
        return self.now.judged.content == "single" and self.now.judged.snr >= STRONG


def in_order(names: list[str]) -> Iterator[tuple[str, str]]:
    """Yield set and case: strong single effects of all sets, then nulls, then the others."""
    ranked = []
    for name in names:
        for number, (case, truth) in enumerate(sorted(read_truths()[name].items())):
            if truth["base"] in BASES:
                ranked.append((_turn(truth), number, name, case))
    yield from ((name, case) for *_, name, case in sorted(ranked))


def _turn(truth: dict) -> int:
    if truth["content"] == "single" and truth["snr"] >= STRONG:
        return 0
    return 1 if truth["content"] == "null" else 2


def judge_again(sets: Path, names: list[str], limit: int | None, say: Callable[[str], None] = print) -> None:
    """Judge the cases in order, as far as they are not judged, at most `limit`; sets: folder of the sets made again."""
    from .sets import COMMAND, judge  # here: it needs FElupe

    left = limit
    for name, case in in_order(names):
        if left == 0:
            return
        judged = judge(
            sets / f"{name}{AGAIN}", COMMAND, say=lambda text, of=name: say(f"{of} {text}"), names=[case]
        )
        left = left if left is None else left - judged


def both_of(names: list[str], archives: Path = ARCHIVES) -> list[Both]:
    """Return the cases that both judges have judged, by the archived verdicts. Raises SealBroken."""
    found = []
    for name in names:
        truths = read_truths()[name]
        former = {one.case: one for one in archived(archives / f"{name}.tar.xz", truths)}
        found += [
            Both(truths[one.case], one, former[one.case])
            for one in archived(archives / f"{name}{AGAIN}.tar.xz", truths)
            if one.case in former
        ]
    return found


def reached(judged: Judged) -> str:
    """Return how far a single effect was told: identified and sure, in the answer of whatever state, or missed."""
    held = [p for members, p in judged.claims if set(members) & set(judged.true)]
    if max(held, default=0.0) >= CONFIDENT:
        return SURE
    return IN_ANSWER if any(set(members) & set(judged.true) for members, _ in judged.answer) else MISSED


def strong_table(cases: list[Both]) -> pd.DataFrame:
    """Return how far strong single effects were told by either judge, with Wilson's intervals."""
    reach = {
        "today": [reached(one.now.judged) for one in cases],
        "former judge": [reached(one.former.judged) for one in cases],
    }
    rows = [
        {"one strong effect": words}
        | {by: Rate(all_.count(words), len(all_)).words for by, all_ in reach.items()}
        for words in (SURE, IN_ANSWER, MISSED)
    ]
    return pd.DataFrame(rows)


def forms_table(cases: list[Both]) -> pd.DataFrame:
    """Return by hidden effect and form how many strong ones there are, and how far they were told."""
    rows = pd.DataFrame(
        [
            {
                "effect": one.truth["effects"][0]["name"],
                "form": one.truth["effects"][0]["form"],
                "cases": 1,
                SURE: int(reached(one.now.judged) == SURE),
                IN_ANSWER: int(reached(one.now.judged) == IN_ANSWER),
                MISSED: int(reached(one.now.judged) == MISSED),
                f"former judge: {SURE}": int(reached(one.former.judged) == SURE),
            }
            for one in cases
        ]
    )
    return rows.groupby(["effect", "form"], as_index=False).sum() if len(rows) else rows


def lost_table(cases: list[Both]) -> pd.DataFrame:
    """Return the strong single effects that today's judge was not sure of, and what it says wrongly and surely."""
    rows = [
        {
            "case": f"{one.now.set.removesuffix(AGAIN)} {one.now.case}",
            "hidden": "; ".join(_hidden(effect) for effect in one.truth["effects"]) or "nothing",
            "today": _said(one.now.judged),
            "former judge": _said(one.former.judged),
        }
        for one in cases
        if one.now.judged.wrong_and_confident or (one.strong and reached(one.now.judged) != SURE)
    ]
    return pd.DataFrame(rows)


def _hidden(effect: dict) -> str:
    return f"{effect['name'] or 'outside'} ({effect['form']}, SNR {effect['snr']:.1f})"


def _said(judged: Judged) -> str:
    groups = "; ".join(f"{' or '.join(members)} {p:.2f}" for members, p in judged.answer)
    return f"{judged.state}: {groups}" if groups else judged.state


def report(cases: list[Both]) -> str:
    """Return all of it as Markdown."""
    strong = [one for one in cases if one.strong]
    parts = [
        f"{len(cases)} cases of opened sets that both judges have judged (SYNTHETIC).",
        strong_table(strong).to_markdown(index=False),
        forms_table(strong).to_markdown(index=False),
        table({"today": [one.now for one in cases], "former judge": [one.former for one in cases]}),
        lost_table(cases).to_markdown(index=False),
    ]
    return "\n\n".join(parts)
