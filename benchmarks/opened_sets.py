"""Concealed sets that are opened, judged once more by today's judge, beside the former judge's verdicts on the same cases.

usage: python -m benchmarks.opened_sets judge eighteenth nineteenth [--limit 20]
       python -m benchmarks.opened_sets score eighteenth nineteenth

A set NAME is made again as NAME_again (at its own commit, docs/concealed-sets.md), so that the verdicts of its first judging
stay in benchmarks/concealed/judged/NAME.tar.xz; a case whose seals are not those of the archive is refused. Of the cases on
the plain base that the former judge has judged the strong single effects come first, then those in which nothing is hidden,
then the others. Truths choose the order, and parts of these sets have served to develop the judge: what comes out is a
hypothesis and no proof. SYNTHETIC.
"""

from __future__ import annotations

import argparse
import io
import json
import sys
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.concealed import sealing
from benchmarks.concealed.archive import ARCHIVES
from benchmarks.concealed.score import (
    CONFIDENT,
    STRONG,
    Judged,
    Rate,
    judged_from,
    scores,
    table_of,
)
from benchmarks.concealed.sets import COMMAND, base_config, judge, opened

SETS = Path("results/concealed/sets")
PLAIN = "concealed"  # the base
SURE, IN_ANSWER, MISSED = f"claimed with {CONFIDENT:g}", "in the answer", "missed"


@dataclass(frozen=True)
class Case:
    """A case that both judges have judged."""

    name: str  # set and case
    truth: dict
    now: Judged
    former: Judged
    seconds: float  # of today's verdict


def folder_of(name: str) -> Path:
    """Return the folder of a set that was made again."""
    return SETS / f"{name}_again"


def first_judged(name: str) -> dict[str, tuple[dict | None, pd.DataFrame | None]]:
    """Return what the former judge said of each case of a set: verdict and readings, None where it failed.

    Raises SealBroken where one of these cases is another one in the set that was made again.
    """
    found = {}
    with tarfile.open(ARCHIVES / f"{name}.tar.xz") as packed:
        files = {entry.name: packed.extractfile(entry).read() for entry in packed if entry.isfile()}
    published, again = json.loads(files["set/sealed.json"]), sealing.read(folder_of(name) / "sealed.json")
    for case in json.loads(files["set/judged.json"]):
        if published["cases"][case] != again["cases"].get(case):
            raise sealing.SealBroken(
                f"{folder_of(name)}, {case}: not the case judged in {name}.tar.xz; make the set again at commit"
                f" {published['commit']}"
            )
        verdict = files.get(f"set/verdicts/{case}/verdict.json")
        readings = files.get(f"set/verdicts/{case}/readings.csv")
        found[case] = (
            None if verdict is None else json.loads(verdict),
            None if readings is None else pd.read_csv(io.BytesIO(readings)),
        )
    return found


def in_order(names: list[str]) -> Iterator[tuple[str, str]]:
    """Yield set and case: strong single effects of all sets in turn, then nulls, then the others; on the plain base."""
    ranked = []
    for name in names:
        folder = folder_of(name)
        published = sealing.read(folder / "sealed.json")["cases"]
        for number, case in enumerate(sorted(first_judged(name))):
            if base_config(folder, case).stem != PLAIN:
                continue
            truth = sealing.opened(folder / "truth" / f"{case}.json", published[case]["truth"])
            ranked.append((_turn(truth), number, name, case))
    yield from ((name, case) for *_, name, case in sorted(ranked))


def _turn(truth: dict) -> int:
    if truth["content"] == "single" and truth["snr"] >= STRONG:
        return 0
    return 1 if truth["content"] == "null" else 2


def judge_again(names: list[str], limit: int | None) -> None:
    """Judge the cases in order, as far as they are not judged, at most `limit`."""
    left = limit
    for name, case in in_order(names):
        if left == 0:
            return
        judged = judge(
            folder_of(name), COMMAND, say=lambda text, of=name: print(of, text, flush=True), names=[case]
        )
        left = left if left is None else left - judged


def both(names: list[str]) -> list[Case]:
    """Return the cases that both judges have judged, seals checked."""
    found = []
    for name in names:
        former = first_judged(name)
        for case in opened(folder_of(name)):
            if case["name"] not in former:
                continue
            path = case["folder"] / "readings.csv"
            readings = pd.read_csv(path) if path.is_file() else None
            found.append(
                Case(
                    f"{name} {case['name']}",
                    case["truth"],
                    judged_from(case["truth"], case["verdict"], readings),
                    judged_from(case["truth"], *former[case["name"]]),
                    case["seconds"],
                )
            )
    return found


def reached(judged: Judged) -> str:
    """Return how far a single effect was told: claimed and sure, in the answer of whatever state, or missed."""
    held = [p for members, p in judged.claims if set(members) & set(judged.true)]
    if max(held, default=0.0) >= CONFIDENT:
        return SURE
    return IN_ANSWER if any(set(members) & set(judged.true) for members, _ in judged.answer) else MISSED


def strong_table(cases: list[Case]) -> pd.DataFrame:
    """Return how far strong single effects were told by either judge, with Wilson's intervals."""
    rows = []
    for words in (SURE, IN_ANSWER, MISSED):
        row = {"strong single effects": words}
        for judge_name in ("now", "former"):
            reach = [reached(getattr(case, judge_name)) for case in cases]
            row[judge_name] = Rate(reach.count(words), len(reach)).words
        rows.append(row)
    return pd.DataFrame(rows)


def forms_table(cases: list[Case]) -> pd.DataFrame:
    """Return by hidden effect how many strong ones there are and how many either judge claimed, surely or not."""
    rows = pd.DataFrame(
        [
            {
                "effect": case.truth["effects"][0]["name"],
                "form": case.truth["effects"][0]["form"],
                "cases": 1,
                "claimed": int(all(case.now.found)),
                "and sure": int(reached(case.now) == SURE),
                "in the answer": int(reached(case.now) != MISSED),
                "former judge": int(all(case.former.found)),
            }
            for case in cases
        ]
    )
    return rows.groupby(["effect", "form"], as_index=False).sum() if len(rows) else rows


def lost_table(cases: list[Case]) -> pd.DataFrame:
    """Return the strong single effects that were not claimed and sure, and every claim that is wrong and confident."""
    rows = []
    for case in cases:
        strong = case.now.content == "single" and case.now.snr >= STRONG
        if not case.now.wrong_and_confident and not (strong and reached(case.now) != SURE):
            continue
        hidden = "; ".join(
            f"{e['name'] or 'outside'} ({e['form']}, SNR {e['snr']:.1f})" for e in case.truth["effects"]
        )
        rows.append(
            {
                "case": case.name,
                "hidden": hidden or "nothing",
                "state": case.now.state,
                "answer": _answer(case.now),
                "former judge": f"{case.former.state}: {_answer(case.former)}",
            }
        )
    return pd.DataFrame(rows)


def _answer(judged: Judged) -> str:
    return "; ".join(f"{' or '.join(members)} {p:.2f}" for members, p in judged.answer)


def report(cases: list[Case]) -> str:
    """Return all of it as Markdown."""
    strong = [c for c in cases if c.now.content == "single" and c.now.snr >= STRONG]
    pooled = table_of(
        {"now": scores([c.now for c in cases]), "former judge": scores([c.former for c in cases])}
    )
    seconds = np.array([c.seconds for c in cases]) if cases else np.zeros(1)
    parts = [
        f"{len(cases)} cases of opened sets that both judges have judged (SYNTHETIC, made by FElupe).",
        strong_table(strong).to_markdown(index=False),
        forms_table(strong).to_markdown(index=False),
        pooled.to_markdown(index=False),
        f"Seconds of a verdict, other work beside it: median {np.median(seconds):.0f}, largest {seconds.max():.0f}.",
        lost_table(cases).to_markdown(index=False),
    ]
    return "\n\n".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=("judge", "score"))
    parser.add_argument("sets", nargs="+")
    parser.add_argument("--limit", type=int, help="verdicts at most, of `judge`")
    asked = parser.parse_args()
    if asked.step == "judge":
        judge_again(asked.sets, asked.limit)
    else:
        print(report(both(asked.sets)))


if __name__ == "__main__":
    main()
