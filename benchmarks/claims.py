"""How sure the claims of judged concealed sets were, and how sure they should have been. SYNTHETIC.

usage: python benchmarks/claims.py SET [SET ...]

Of every group that was claimed the log odds p / (1 - p) are taken by a share, and the mean log score of the claims is
printed, beside how many stay at 0.9 or above and how many of these are right: where the largest score is not at share 1,
the probabilities were too sure (below) or not sure enough (above). `WORTH` (mismatch/evidence/alternatives.py) was taken
from the thirteenth and fourteenth sets by it.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.concealed.score import judged_from
from benchmarks.concealed.sets import opened

SETS = Path("results/concealed/sets")
SHARES = (1.4, 1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.2)
SURE = 0.9
LEAST = 1e-9  # from 0 and 1: what is told as certain


def claims_of(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the probability (n,) of every claimed group of a judged set, and whether it is right (n,) bool."""
    judged = [judged_from(case["truth"], case["verdict"], None) for case in opened(folder)]
    found = [(p, bool(set(members) & set(one.true))) for one in judged for members, p in one.claims]
    p, right = zip(*found) if found else ((), ())
    return np.array(p, dtype=float), np.array(right, dtype=bool)


def by_share(p: np.ndarray, right: np.ndarray, shares=SHARES) -> pd.DataFrame:
    """Return one row per share of the log odds: mean log score, claims at SURE or above, and how many of them are right."""
    p = np.clip(p, LEAST, 1 - LEAST)
    rows = []
    for share in shares:
        q = 1 / (1 + ((1 - p) / p) ** share)
        sure = q >= SURE
        score = np.mean(np.log(np.where(right, q, 1 - q)))
        rows.append((share, score, int(sure.sum()), int((right & sure).sum())))
    return pd.DataFrame(rows, columns=["share", "log score", f"claims >= {SURE:g}", "right"])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sets", nargs="+")
    found = [claims_of(SETS / name) for name in parser.parse_args().sets]
    p, right = (np.concatenate(part) for part in zip(*found))
    print(f"{len(p)} claims, {int(right.sum())} right (SYNTHETIC)\n")
    print(by_share(p, right).to_markdown(index=False, floatfmt=".3g"))


if __name__ == "__main__":
    main()
