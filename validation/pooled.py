"""Every pooled rate of verdicts on sealed sets, from the archived verdicts (judged/SET.tar.xz) and truths (truths.jsonl).

Nothing is generated, solved or judged for it, and FElupe is not needed. Of every archive the verdicts' seals are checked,
and that each truth is the one that was sealed. A set whose archive or truths are not there is left out and named. SYNTHETIC.

Rates of cases have Wilson's 95 % interval. Where a case gives several items (claims, values) cases are drawn again with
replacement, 4000 times, and the 2.5 and 97.5 % quantiles of the rate are printed: items of one case are not independent.
Where all items are right or all are wrong the draws cannot differ, so Wilson's interval of the cases is printed instead.
"""

from __future__ import annotations

import json
import tarfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from . import sealing
from .archive import ARCHIVES, with_current_keys
from .score import CONFIDENT, LEVEL, NAMES, NO_NAME, SEPARABLE, SNR_BANDS, STRONG, Judged, Rate, judged_from
from .sealing import JUDGED, REGISTER, SEALED
from .truths import read_truths

ORDER = (
    "twelfth",
    "thirteenth",
    "fourteenth",
    "fifteenth",
    "sixteenth",
    "seventeenth",
    "eighteenth",
    "nineteenth",
)
# By one linear pass over all effects and pairs: with errors of form by effect, with one prior for all, and (today) with
# credible sets of 0.95 and five states.
BY_EFFECT = ("twentieth", "twentyfirst")
ONE_PRIOR = ("twentysecond", "twentythird")
TODAY = ("twentyfourth", "twentyfifth")
LINEAR = (*BY_EFFECT, *ONE_PRIOR, *TODAY)
# What is added up: judges of one kind. From the fifteenth set on known effects share odds by a tempering exponent of 0.4;
# from the sixteenth on values follow all readings.
POOLS = {"12 to 19": ORDER, "15 to 19": ORDER[3:], "16 to 19": ORDER[4:]}
DRAWS, SEED = 4000, 39


@dataclass(frozen=True)
class Scored:
    """A judged case: what it says next to the truth, and the seconds that it took."""

    set: str
    case: str
    judged: Judged
    seconds: float


def archived(archive: Path, truths: dict[str, dict]) -> list[Scored]:
    """Return the judged cases of an archive, scored; gains on held-out readings, which need whole truths, are NaN.

    Raises SealBroken where a verdict is not the one that was sealed, or a truth that of another set.
    """
    name = archive.name.partition(".")[0]
    with tarfile.open(archive) as packed:
        files = {}
        for entry in packed:  # in the archive's order: its compression has no index
            if entry.name.startswith("set/"):
                files[entry.name.removeprefix("set/")] = packed.extractfile(entry).read()
    published, register = json.loads(files[SEALED]), json.loads(files[REGISTER])
    found = []
    for case, seal in sorted(register.items()):
        parts = [files.get(f"verdicts/{case}/{file}", b"") for file in JUDGED]
        if sealing.digest(*parts) != seal["sha256"]:
            raise sealing.SealBroken(
                f"{archive}: the verdict of {case} is not the one that was sealed; unpack it anew"
            )
        truth = truths.get(case)
        if truth is None or truth["sealed"] != published["cases"][case]["truth"]:
            raise sealing.SealBroken(
                f"{archive}: truths.jsonl has no truth of {name} {case} with the published seal; "
                f"generate the set and run python -m validation truths {name}"
            )
        verdict = with_current_keys(json.loads(parts[0])) if parts[0] else None
        found.append(Scored(name, case, judged_from(truth, verdict, None), float(seal["seconds"])))
    return found


def clustered(items: Iterable[list[bool]]) -> tuple[Rate, tuple[float, float]]:
    """Return the rate of true items, one list per case, and its 95 % interval by drawing cases again with replacement."""
    cases = [case for case in items if case]
    right, number = (np.array([count(case) for case in cases], dtype=float) for count in (sum, len))
    rate = Rate(int(right.sum()), int(number.sum()))
    if not cases:
        return rate, (0.0, 1.0)
    if rate.k in (0, rate.n):
        return rate, Rate(len(cases) * (rate.k > 0), len(cases)).interval()
    drawn = np.random.default_rng(SEED).integers(len(cases), size=(DRAWS, len(cases)))
    low, high = np.quantile(right[drawn].sum(axis=1) / number[drawn].sum(axis=1), (0.025, 0.975))
    return rate, (float(low), float(high))


def _rate(cases: list[Scored], test: Callable[[Judged], bool]) -> str:
    rate = Rate(sum(test(one.judged) for one in cases), len(cases))
    return words(rate, rate.interval())


def words(rate: Rate, interval: tuple[float, float]) -> str:
    """Return a rate as it stands in a table: right of all, per cent and interval."""
    if not rate.n:
        return ""
    low, high = interval
    return f"{rate.k}/{rate.n} = {100 * rate.value:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def _in_answer(judged: Judged) -> bool:
    """Return whether the answer of a verdict that names or is ambiguous holds what is hidden."""
    names = {name for members, _ in judged.answer for name in members}
    return judged.state in (*NAMES, "ambiguous") and set(judged.true) <= names


def _effects(cases: list[Scored]) -> list[tuple[str, ...]]:
    """Return what is hidden in some cases, each once."""
    return sorted({one.judged.true for one in cases})


def forms(cases: list[Scored], truths: dict[str, dict[str, dict]]) -> str:
    """Return by effect and form how many strong single ones were hidden, and how many of these identified, as Markdown."""
    rows = []
    for one in cases:
        if one.judged.content == "single" and one.judged.snr >= STRONG:
            (effect,) = truths[one.set][one.case]["effects"]
            found, answer = all(one.judged.found), _in_answer(one.judged)
            rows.append((effect["name"], effect["form"], 1, int(found), int(answer)))
    frame = pd.DataFrame(rows, columns=["effect", "form", "cases", "identified", "or in an ambiguous answer"])
    return frame.groupby(["effect", "form"], as_index=False).sum().to_markdown(index=False)


def scores(cases: list[Scored]) -> dict[str, str]:
    """Return all pooled scores of some cases by their names, in the order of the table; empty where there are none."""
    of = lambda *contents: [one for one in cases if one.judged.content in contents]  # noqa: E731
    nulls, singles, pairs, outside = of("null"), of("single"), of("pair"), of("outside")
    answered = [one for one in nulls if one.judged.state != "failed"]
    strong = [one for one in singles if one.judged.snr >= STRONG]
    table = {
        "cases": str(len(cases)),
        "no verdict": _rate(cases, lambda j: j.state == "failed"),
        "nulls: a mismatch is reported": _rate(answered, lambda j: j.alarm),
        f"nulls: a test below {LEVEL:g}": _rate(
            [one for one in answered if np.isfinite(one.judged.p)], lambda j: j.p < LEVEL
        ),
        f"wrong with {CONFIDENT:g} and more": _rate(cases, lambda j: j.wrong_and_confident),
        f"single, SNR >= {STRONG:g}: identified": _rate(strong, lambda j: all(j.found)),
        f"single, SNR >= {STRONG:g}: identified, first of its group": _rate(strong, lambda j: j.first),
        f"single, SNR >= {STRONG:g}: identified, or in an ambiguous answer": _rate(strong, _in_answer),
    }
    sizes = [
        len(names)
        for one in strong
        for names, _ in one.judged.answer
        if _in_answer(one.judged) and set(names) & set(one.judged.true)
    ]
    if sizes:
        table["effects in the set that holds it: median, 90th percentile"] = "{:g}, {:g}".format(
            *np.quantile(sizes, (0.5, 0.9), method="inverted_cdf")
        )
    separable = [one for one in strong if one.judged.separation >= SEPARABLE]
    if separable:
        table[f"single, {SEPARABLE:g} and more from every other effect: identified"] = _rate(
            separable, lambda j: all(j.found)
        )
    by_effect = [
        [all(one.judged.found) for one in strong if one.judged.true == true] for true in _effects(strong)
    ]
    table[f"single, SNR >= {STRONG:g}: identified, effects drawn again"] = words(*clustered(by_effect))
    for low, high in reversed(SNR_BANDS):
        band = [one for one in singles if low <= one.judged.snr < high]
        until = f"{low:g} to {high:g}" if np.isfinite(high) else f">= {low:g}"
        table[f"single, SNR {until}: identified"] = _rate(band, lambda j: all(j.found))
    table["pair: both identified"] = _rate(pairs, lambda j: all(j.found))
    table["pair: one at least identified"] = _rate(pairs, lambda j: any(j.found))
    table[f"outside the catalogue, SNR >= {STRONG:g}: not named"] = _rate(
        [one for one in outside if one.judged.snr >= STRONG], lambda j: j.state in NO_NAME
    )
    table["outside the catalogue, all: not named"] = _rate(outside, lambda j: j.state in NO_NAME)
    claims = (
        [bool(set(m) & set(one.judged.true)) for m, p in one.judged.claims if p >= CONFIDENT] for one in cases
    )
    table[f"claims of probability {CONFIDENT:g} and more: right"] = words(*clustered(claims))
    table["90 % intervals of identified effects: hold the truth"] = words(
        *clustered(list(one.judged.covered) for one in cases)
    )
    short = [s for one in cases for s in one.judged.short]
    table["values too small by, mean [standard deviations]"] = f"{np.mean(short):.2f}" if short else ""
    away = np.array([one.judged.distance_mm for one in cases if np.isfinite(one.judged.distance_mm)])
    table["defects: distance, median [mm]"] = f"{np.median(away):.2g}" if len(away) else ""
    within = Rate(int((away <= 3).sum()), len(away))
    table["defects: within 3 mm"] = words(within, within.interval())
    for content in ("null", "single", "pair", "outside"):
        seconds = [one.seconds for one in of(content)]
        table[f"seconds, {content}: median; largest"] = (
            f"{np.median(seconds):.0f}; {max(seconds):.0f}" if seconds else ""
        )
    return table


def table(columns: dict[str, list[Scored]]) -> str:
    """Return the scores of several lots of cases side by side, as Markdown; what none of them has is left out."""
    frame = pd.DataFrame({name: scores(cases) for name, cases in columns.items()})
    frame = frame.fillna("")
    frame = frame[(frame != "").any(axis=1)]
    return frame.rename_axis("SYNTHETIC").reset_index().to_markdown(index=False, disable_numparse=True)


def report(archives: Path = ARCHIVES, truths: dict[str, dict[str, dict]] | None = None) -> str:
    """Return the tables as Markdown: former judges' sets pooled, today's judge's sets, and each of the former ones."""
    truths = read_truths() if truths is None else truths
    there = [name for name in (*ORDER, *LINEAR) if name in truths and (archives / f"{name}.tar.xz").is_file()]
    by_set = {name: archived(archives / f"{name}.tar.xz", truths[name]) for name in there}
    pools = {words: _together(by_set, names) for words, names in POOLS.items()}
    former = {name: cases for name, cases in by_set.items() if name in ORDER}
    missing = [name for name in (*ORDER, *LINEAR) if name not in by_set]
    left_out = (
        f"Left out, as their archive or their truths are not there: {', '.join(missing)}.\n\n"
        if missing
        else ""
    )
    linear = {
        words: ({"both": _together(by_set, names)} if len(names) > 1 else {})
        | {name: by_set[name] for name in names if name in by_set}
        for words, names in (
            ("credible sets, today's", TODAY),
            ("one prior for all", ONE_PRIOR),
            ("errors of form by effect", BY_EFFECT),
        )
    }
    every = _together(by_set, LINEAR)
    return (
        f"{left_out}Former judges, sets pooled\n\n{table(pools)}\n\n"
        + "".join(f"Linear judge, {words}\n\n{table(lots)}\n\n" for words, lots in linear.items())
        + f"Linear judge, strong single effects of all its sets\n\n{forms(every, truths)}\n\n"
        f"Former judges, set by set\n\n{table(former)}\n"
    )


def _together(by_set: dict[str, list[Scored]], names: Iterable[str]) -> list[Scored]:
    return [one for name in names if name in by_set for one in by_set[name]]
