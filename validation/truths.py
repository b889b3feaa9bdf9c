"""What was hidden in every judged case of the archived sets, a line each, so that verdicts are scored without FElupe.

truths.jsonl    set, case, SHA-256 of the sealed truth, base, content, signal-to-noise ratio, and each effect with its name,
                form, signal-to-noise ratio, values and, of a defect, place; the readings of a truth are not in it

The whole truth follows from the set's commit and seed: `generate` makes it again, and its seal is that of the line.
"""

from __future__ import annotations

import json
from pathlib import Path

TRUTHS = Path(__file__).parent / "truths.jsonl"
EFFECT = ("name", "form", "snr", "parameters", "where")


def read_truths(path: Path = TRUTHS) -> dict[str, dict[str, dict]]:
    """Return the truths by set and case."""
    found: dict[str, dict[str, dict]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        truth = json.loads(line)
        found.setdefault(truth["set"], {})[truth["case"]] = truth
    return found


def keep_truths(folder: Path, published: dict, path: Path = TRUTHS) -> int:
    """Write the truths of a set's judged cases, opened with their seals checked, in place of those it had; return how many.

    published: the content of the set's sealed.json.
    """
    from .sets import opened  # here: it needs FElupe

    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    others = [line for line in lines if json.loads(line)["set"] != folder.name]
    cases = sorted(opened(folder), key=lambda case: case["name"])
    own = [json.dumps(_line(folder, case, published), sort_keys=True) for case in cases]
    path.write_text("\n".join([*others, *own]) + "\n", encoding="utf-8")
    return len(own)


def _line(folder: Path, case: dict, published: dict) -> dict:
    """Return what truths.jsonl keeps of an opened case."""
    truth = case["truth"]
    return {
        "set": folder.name,
        "case": case["name"],
        "sealed": published["cases"][case["name"]]["truth"],
        "base": (case["case"] / "base.txt").read_text(encoding="utf-8").strip(),
        "content": truth["content"],
        "snr": truth["snr"],
        "effects": [{key: effect[key] for key in EFFECT if key in effect} for effect in truth["effects"]],
        **{key: truth[key] for key in ("separation",) if key in truth},
    }
