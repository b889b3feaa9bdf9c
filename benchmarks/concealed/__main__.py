"""The proof on concealed effects, step by step; every step goes on where it was left.

usage: python -m benchmarks.concealed solve                                 presses by FElupe that solutions.jsonl lacks
       python -m benchmarks.concealed generate SET [--seed 7 | --commit HASH] recordings, and truths under seal
       python -m benchmarks.concealed judge SET [--limit 10] [--command "..."] gelforge mismatch on each
       python -m benchmarks.concealed score SET                            opens the seals, writes scores.md
       python -m benchmarks.concealed left-out SET [--limit 10]            strong singles again, their effect not known
       python -m benchmarks.concealed pack SET [--finished]                verdicts into benchmarks/concealed/judged
       python -m benchmarks.concealed unpack SET                           and from there into a set generated again

Run from the repository's root. SET is a name; sets lie in results/concealed/sets.
"""

from __future__ import annotations

import argparse
from pathlib import Path

SETS = Path("results/concealed/sets")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    steps = parser.add_subparsers(dest="step", required=True)
    one = steps.add_parser("solve", help="solve what all cases share")
    one.add_argument("--workers", type=int, default=1, help="presses side by side")
    steps.add_parser("check", help="print how far the base is from the fine mesh, and from solutions between")
    one = steps.add_parser("generate", help="draw, write and seal a set")
    one.add_argument("set")
    which = one.add_mutually_exclusive_group(required=True)
    which.add_argument("--seed", type=int, help="a development set: below 1000")
    which.add_argument("--commit", help="the commit that froze the analysis: the reporting set")
    for name, number in (("nulls", 200), ("singles", 45), ("pairs", 20), ("outside", 24)):
        one.add_argument(f"--{name}", type=int, default=number)
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
    for name, what in (("pack", "keep the verdicts in the repository"), ("unpack", "take them from there")):
        one = steps.add_parser(name, help=what)
        one.add_argument("set")
        if name == "pack":
            one.add_argument("--finished", action="store_true", help="without solutions, for judging on")
    one = steps.add_parser("score", help="open the seals and score")
    one.add_argument("set")
    one.add_argument("--no-baselines", action="store_true")
    run(parser.parse_args())


def run(asked: argparse.Namespace) -> None:
    if asked.step == "solve":
        from .solves import solve_all

        solve_all(say=lambda text: print(text, flush=True), workers=asked.workers)
    elif asked.step == "check":
        from .library import between, convergence

        for row in convergence():
            print("{place} {depth_mm:g} mm: {base_N:.4f} N, fine {fine_N:.4f} N: {ratio:.4f}".format(**row))
        for row in between():
            given, solved = (" ".join(f"{f:.4f}" for f in row[name]) for name in ("given_N", "solved_N"))
            print(
                f"{row['place']} {row['depth_mm']:g} mm: Fx Fy Fz {given} N between solutions, {solved} N solved there"
            )
    elif asked.step == "generate":
        _generate(asked)
    elif asked.step == "judge":
        from .sets import COMMAND, judge

        judge(
            SETS / asked.set,
            asked.command or COMMAND,
            asked.limit,
            say=lambda text: print(text, flush=True),
            workers=asked.workers,
            base=asked.base,
        )
    elif asked.step in ("pack", "unpack"):
        from .archive import ARCHIVES, pack, unpack

        folder, archive = SETS / asked.set, ARCHIVES / f"{asked.set}.tar.xz"
        number = pack(folder, archive, asked.finished) if asked.step == "pack" else unpack(archive, folder)
        print(f"{number} verdicts in {archive if asked.step == 'pack' else folder}")
    elif asked.step == "left-out":
        from .left_out import judge_left_out, table_of_left_out

        judge_left_out(SETS / asked.set, limit=asked.limit, workers=asked.workers)
        print(table_of_left_out(SETS / asked.set))
    else:
        _score(SETS / asked.set, not asked.no_baselines)


def _generate(asked: argparse.Namespace) -> None:
    from .draw import DEVELOPMENT, seed_of_commit
    from .library import load_library
    from .sets import generate

    if asked.seed is not None and asked.seed >= DEVELOPMENT:
        raise SystemExit(
            f"--seed {asked.seed}: development seeds are below {DEVELOPMENT}; others come from a --commit"
        )
    seed = asked.seed if asked.seed is not None else seed_of_commit(asked.commit)
    numbers = {name: getattr(asked, name) for name in ("nulls", "singles", "pairs", "outside")}
    published = generate(load_library(), SETS / asked.set, seed, numbers, asked.commit or "")
    print(
        f"{len(published['cases'])} cases of seed {seed} in {SETS / asked.set}; publish sealed.json before judging"
    )


def _score(folder: Path, baselines: bool) -> None:
    import pandas as pd

    from . import sealing
    from .score import judged_from, scores, table_of, wrong_cases
    from .sets import opened

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
    if baselines:
        from .baselines import judged_by_baselines
        from .library import load_library

        library = load_library()
        each = [judged_by_baselines(library, case["case"], case["truth"]) for case in found]
        for name in each[0] if each else ():
            methods[name] = scores([one[name] for one in each])
    table, wrong = table_of(methods), wrong_cases(tool)
    published = sealing.read(folder / "sealed.json")
    table.to_csv(folder / "scores.csv", index=False)
    head = (
        f"# Scores of set {folder.name}\n\nSeed {published['seed']} ({published['for']}), "
        f"{len(found)} of {len(published['cases'])} cases judged. SYNTHETIC: recordings made by FElupe.\n\n"
    )
    text = (
        head
        + table.to_markdown(index=False)
        + f"\n\nSeconds a case, others running beside it:\n\n{_seconds(found)}"
        + "\n\n## Cases got wrong\n\n"
        + wrong.to_markdown(index=False)
        + "\n"
    )
    (folder / "scores.md").write_text(text, encoding="utf-8")
    print(text)


def _seconds(found: list[dict]) -> str:
    """Return median, largest and total seconds of judging by what was hidden, as Markdown."""
    import pandas as pd

    rows = pd.DataFrame([{"content": c["truth"]["content"], "seconds": c["seconds"]} for c in found])
    return rows.groupby("content")["seconds"].agg(["median", "max", "sum"]).to_markdown(floatfmt=".1f")


if __name__ == "__main__":
    main()
