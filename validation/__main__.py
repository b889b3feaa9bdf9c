"""Concealed sets, step by step; every step goes on where it was left.

usage: python -m validation pooled                                   every pooled rate of sealed sets
       python -m validation solve                                    solutions by FElupe that solutions.jsonl lacks
       python -m validation generate SET [--seed 7 | --commit HASH]  recordings, and truths under seal
       python -m validation judge SET [--limit 10] [--command "..."] gelforge mismatch on each
       python -m validation score SET                                opens the seals, writes scores.md
       python -m validation left-out SET [--limit 10]                strong single effects again, left out of the catalogue
       python -m validation claims SET [SET ...]                     how sure claims should have been: tempering exponent
       python -m validation pack SET [--finished]                    verdicts into validation/judged
       python -m validation unpack SET                               and from there into a set generated again
       python -m validation judge-again SET [SET ...] [--limit 10]   opened sets (SET_again), strong effects first
       python -m validation again SET [SET ...]                      today's judge next to the former one on those cases
       python -m validation trust                                    scores of the sealed sets, into docs/results/verdicts.md
       python -m validation truths SET                               what was hidden in a judged set, into truths.jsonl

Run from the repository's root. SET is a name; sets lie in results/concealed/sets.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

SETS = Path("results/concealed/sets")


def main() -> None:
    asked = parser().parse_args()
    STEPS[asked.step](asked)


def parser() -> argparse.ArgumentParser:
    """Return the parser of all steps."""
    whole = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    steps = whole.add_subparsers(dest="step", required=True)
    one = steps.add_parser("pooled", help="print every pooled number from the archived verdicts")
    one.add_argument("--archives", type=Path, help="folder of SET.tar.xz; default: validation/judged")
    steps.add_parser("trust", help="write the scores of the sealed sets into docs/results/verdicts.md")
    one = steps.add_parser("solve", help="solve what all cases share")
    one.add_argument("--workers", type=int, default=1, help="solutions side by side")
    steps.add_parser("check", help="print how far the base is from the fine mesh, and from solutions between")
    one = steps.add_parser("generate", help="draw, write and seal a set")
    one.add_argument("set")
    which = one.add_mutually_exclusive_group(required=True)
    which.add_argument("--seed", type=int, help="a development set: below 1000")
    which.add_argument("--commit", help="the commit that froze the analysis: the reporting set")
    for name, number in (("nulls", 200), ("singles", 45), ("pairs", 20), ("outside", 24)):
        one.add_argument(f"--{name}", type=int, default=number)
    one.add_argument("--bases", nargs="+", default=["concealed"], help="studies of config, in turn")
    one.add_argument(
        "--least", type=float, default=2.0, help="smallest signal-to-noise ratio of what is hidden"
    )
    one = steps.add_parser("judge", help="judge what has not been judged")
    one.add_argument("set")
    one.add_argument("--limit", type=int)
    one.add_argument("--workers", type=int, default=1, help="cases side by side")
    one.add_argument("--base", help="only cases on that base: concealed, neo_hooke or rough")
    one.add_argument("--command", help="in place of gelforge mismatch; {recording} {config} {out} {kept}")
    one = steps.add_parser("left-out", help="judge strong singles without their effect in the catalogue")
    one.add_argument("set")
    one.add_argument("--limit", type=int)
    one.add_argument("--workers", type=int, default=1, help="cases side by side")
    one = steps.add_parser("judge-again", help="judge cases of opened sets once more, strong effects first")
    one.add_argument("sets", nargs="+")
    one.add_argument("--limit", type=int)
    one = steps.add_parser("again", help="score today's judge next to the former one on opened sets")
    one.add_argument("sets", nargs="+")
    one = steps.add_parser("claims", help="score archived claims by tempering exponent")
    one.add_argument("sets", nargs="+")
    one = steps.add_parser("pack", help="keep the verdicts in the repository")
    one.add_argument("set")
    one.add_argument("--finished", action="store_true", help="without solutions, for judging on")
    for name, what in (
        ("unpack", "take verdicts from there"),
        ("truths", "keep what was hidden in judged cases"),
    ):
        steps.add_parser(name, help=what).add_argument("set")
    one = steps.add_parser("score", help="open the seals and score")
    one.add_argument("set")
    one.add_argument("--no-baselines", action="store_true")
    one.add_argument(
        "--classifier", type=int, default=0, metavar="N", help="and one trained on N single effects"
    )
    return whole


def _pooled(asked: argparse.Namespace) -> None:
    from .archive import ARCHIVES
    from .pooled import report

    print(report(asked.archives or ARCHIVES))


def _solve(asked: argparse.Namespace) -> None:
    from .solves import solve_all

    solve_all(say=partial(print, flush=True), workers=asked.workers)


def _check(asked: argparse.Namespace) -> None:
    from .library import between, convergence

    for row in convergence():
        print("{place} {depth_mm:g} mm: {base_N:.4f} N, fine {fine_N:.4f} N: {ratio:.4f}".format(**row))
    for row in between():
        given, solved = (" ".join(f"{f:.4f}" for f in row[name]) for name in ("given_N", "solved_N"))
        print(
            f"{row['place']} {row['depth_mm']:g} mm: Fx Fy Fz {given} N between solutions, {solved} N solved there"
        )


def _generate(asked: argparse.Namespace) -> None:
    from .draw import BASES, CONTENTS, DEVELOPMENT, seed_of_commit
    from .library import load_libraries
    from .sets import generate

    if asked.seed is not None and asked.seed >= DEVELOPMENT:
        raise SystemExit(
            f"--seed {asked.seed}: development seeds are below {DEVELOPMENT}; others come from a --commit"
        )
    seed = asked.seed if asked.seed is not None else seed_of_commit(asked.commit, asked.bases)
    numbers = dict(zip(CONTENTS, (asked.nulls, asked.singles, asked.pairs, asked.outside)))
    libraries = load_libraries({BASES[base].sensor for base in asked.bases})
    published = generate(
        libraries, SETS / asked.set, seed, numbers, asked.commit or "", asked.bases, asked.least
    )
    print(
        f"{len(published['cases'])} cases of seed {seed} in {SETS / asked.set}; publish sealed.json before judging"
    )


def _judge(asked: argparse.Namespace) -> None:
    from .sets import COMMAND, judge

    judge(
        SETS / asked.set,
        asked.command or COMMAND,
        asked.limit,
        say=partial(print, flush=True),
        workers=asked.workers,
        base=asked.base,
    )


def _left_out(asked: argparse.Namespace) -> None:
    from .left_out import judge_left_out, table_of_left_out

    judge_left_out(SETS / asked.set, limit=asked.limit, workers=asked.workers)
    print(table_of_left_out(SETS / asked.set))


def _judge_again(asked: argparse.Namespace) -> None:
    from .again import judge_again

    judge_again(SETS, asked.sets, asked.limit, partial(print, flush=True))


def _again(asked: argparse.Namespace) -> None:
    from .again import both_of, report

    print(report(both_of(asked.sets)))


def _claims(asked: argparse.Namespace) -> None:
    from .archive import ARCHIVES
    from .claims import by_exponent, claims_of
    from .pooled import archived
    from .truths import read_truths

    truths = read_truths()
    cases = [
        one for name in asked.sets for one in archived(ARCHIVES / f"{name}.tar.xz", truths.get(name, {}))
    ]
    p, right = claims_of(cases)
    print(f"{len(p)} claims, {int(right.sum())} right (SYNTHETIC)\n")
    print(by_exponent(p, right).to_markdown(index=False, floatfmt=".3g"))


def _trust(asked: argparse.Namespace) -> None:
    from .trust import PAGE, page

    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)


def _pack(asked: argparse.Namespace) -> None:
    from .archive import ARCHIVES, pack

    archive = ARCHIVES / f"{asked.set}.tar.xz"
    print(f"{pack(SETS / asked.set, archive, asked.finished)} verdicts in {archive}")


def _unpack(asked: argparse.Namespace) -> None:
    from .archive import ARCHIVES, unpack

    folder = SETS / asked.set
    print(f"{unpack(ARCHIVES / f'{asked.set}.tar.xz', folder)} verdicts in {folder}")


def _truths(asked: argparse.Namespace) -> None:
    from . import sealing
    from .truths import TRUTHS, keep_truths

    folder = SETS / asked.set
    print(f"{keep_truths(folder, sealing.read(folder / sealing.SEALED))} truths of {asked.set} in {TRUTHS}")


def _score(asked: argparse.Namespace) -> None:
    import pandas as pd

    from . import sealing
    from .score import judged_from, scores, table_of, wrong_cases
    from .sets import opened

    folder = SETS / asked.set
    found = opened(folder)
    tool = []
    for case in found:
        path = case["folder"] / "readings.csv"
        tool.append(
            (
                case["name"],
                case["truth"],
                judged_from(case["truth"], case["verdict"], pd.read_csv(path) if path.is_file() else None),
            )
        )
    methods = {"gelforge": scores([j for *_, j in tool])}
    if not asked.no_baselines:
        each = _said_by_baselines(found, asked.classifier)
        for name in each[0] if each else ():
            methods[name] = scores([one[name] for one in each])
    table, wrong = table_of(methods), wrong_cases(tool)
    published = sealing.read(folder / sealing.SEALED)
    table.to_csv(folder / "scores.csv", index=False)
    head = (
        f"# Scores of set {folder.name}\n\nSeed {published['seed']} ({published['for']}), "
        f"{len(found)} of {len(published['cases'])} cases judged. SYNTHETIC: recordings made by FElupe.\n\n"
    )
    text = (
        head
        + table.to_markdown(index=False)
        + f"\n\nSeconds a case, others running next to it:\n\n{_seconds(found)}"
        + "\n\n## Cases got wrong\n\n"
        + wrong.to_markdown(index=False)
        + "\n"
    )
    (folder / "scores.md").write_text(text, encoding="utf-8")
    print(text)


def _said_by_baselines(found: list[dict], singles: int) -> list[dict]:
    """Return what each baseline says of each opened case, by its name; singles: on which the classifier is trained."""
    from .baselines import judged_by_baselines
    from .classifier import trained
    from .draw import BASES
    from .library import load_libraries

    bases = {case["truth"]["base"] for case in found}
    libraries = load_libraries({BASES[base].sensor for base in bases})
    learned = {base: trained(libraries, base, singles) for base in bases} if singles else {}
    each = []
    for case in found:
        truth = case["truth"]
        said = judged_by_baselines(libraries[BASES[truth["base"]].sensor], case["case"], truth)
        if learned:
            said["gradient boosting"] = learned[truth["base"]].judge(case["case"], truth)
        each.append(said)
    return each


def _seconds(found: list[dict]) -> str:
    """Return median, largest and total seconds of judging by what was hidden, as Markdown."""
    import pandas as pd

    rows = pd.DataFrame([{"content": c["truth"]["content"], "seconds": c["seconds"]} for c in found])
    return rows.groupby("content")["seconds"].agg(["median", "max", "sum"]).to_markdown(floatfmt=".1f")


STEPS = {
    "pooled": _pooled,
    "solve": _solve,
    "check": _check,
    "generate": _generate,
    "judge": _judge,
    "left-out": _left_out,
    "judge-again": _judge_again,
    "again": _again,
    "claims": _claims,
    "pack": _pack,
    "unpack": _unpack,
    "truths": _truths,
    "trust": _trust,
    "score": _score,
}

if __name__ == "__main__":
    main()
