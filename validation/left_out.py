"""Strong single effects judged once more with their own effect deleted from the catalogue: nothing else must be named.

Of an effect that nothing else looks like the right answer then has no name; of one that has a twin in the catalogue (a force
gain next to a gel stiffness) the twin's group is as good. SET/left_out/<case>/ holds configuration and verdict. Truths are
opened for this: it comes after judging.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pandas as pd
import yaml

from . import sealing
from .score import CONFIDENT, NAMES, NO_NAME, SAYS_NOTHING, STRONG, Rate, answer_of, state_of
from .sets import COMMAND, base_config, opened, run_judge


def judge_left_out(
    folder: Path,
    command: str = COMMAND,
    limit: int | None = None,
    workers: int = 1,
    say: Callable[[str], None] = print,
    limit_s: int = 7200,
) -> None:
    """Judge, at most `limit`, the strong singles of a set that have not been judged so."""
    todo = [case for case in _strong_singles(folder) if not (_out(folder, case) / "verdict.json").is_file()]

    def judged(case: dict) -> None:
        out, effect = _out(folder, case), case["truth"]["effects"][0]["name"]
        out.mkdir(parents=True, exist_ok=True)
        study = yaml.safe_load(base_config(folder, case["name"]).read_text(encoding="utf-8"))
        study["mismatch"]["leave_out"] = [effect]
        (out / "study.yaml").write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
        code = run_judge(folder, case["name"], out / "study.yaml", out, command, limit_s)
        say(f"{case['name']} without {effect}: exit {code}")

    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(judged, todo[:limit]))


def table_of_left_out(folder: Path) -> str:
    """Return what was said of each, and the rates, as Markdown; written to left_out.md."""
    rows = []
    for case in _strong_singles(folder):
        path = _out(folder, case) / "verdict.json"
        if not path.is_file():
            continue
        verdict, effect = sealing.read(path), case["truth"]["effects"][0]
        state, groups = state_of(verdict), answer_of(verdict)
        answer = "; ".join(f"{' | '.join(names)} ({p:.2f})" for names, p in groups)
        sure = [names for names, p in groups if state in NAMES and p >= CONFIDENT]
        # a cause with a free form that generalises the deleted effect is the same physics
        free_form = any(effect["name"] in names for names in sure)
        wrong = any(effect["name"] not in names for names in sure)
        rows.append(
            (case["name"], effect["name"], effect["form"], effect["snr"], state, answer, free_form, wrong)
        )
    columns = ["case", "left out", "form", "SNR", "state", "answer", "free form", "wrong"]
    table = pd.DataFrame(rows, columns=columns)
    rates = {
        "no name": Rate(int(table["state"].isin(NO_NAME).sum()), len(table)),
        "nothing said": Rate(int(table["state"].isin(SAYS_NOTHING).sum()), len(table)),
        "identified as a free form of the deleted effect": Rate(int(table["free form"].sum()), len(table)),
        "another effect, sure of it": Rate(int(table["wrong"].sum()), len(table)),
    }
    text = "\n".join(f"- {name}: {rate.words}" for name, rate in rates.items())
    text = f"{table.drop(columns=['free form', 'wrong']).to_markdown(index=False)}\n\n{text}\n"
    (folder / "left_out.md").write_text(text, encoding="utf-8")
    return text


def _strong_singles(folder: Path) -> list[dict]:
    """Return the judged cases of one effect with a signal of at least STRONG, opened, in the order of the set."""
    cases = [c for c in opened(folder) if c["truth"]["content"] == "single" and c["truth"]["snr"] >= STRONG]
    return sorted(cases, key=lambda case: case["name"])


def _out(folder: Path, case: dict) -> Path:
    return folder / "left_out" / case["name"]
