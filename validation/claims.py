"""How sure the claims of judged sets were, and how sure they should have been: the tempering exponent. SYNTHETIC.

Of every group that was claimed the log odds log(p / (1 - p)) are multiplied by an exponent, and the mean log score of the
claims is printed, next to how many stay at 0.9 or above and how many of these are right. Where the largest score is at an
exponent below 1, the probabilities were too sure. `TEMPERING` in
gelforge/mismatch/evidence/gaussian.py was taken from the thirteenth and fourteenth sets by it.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd

from .pooled import Scored
from .score import CONFIDENT

EXPONENTS = (1.4, 1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.2)
LEAST = 1e-9  # from 0 and 1: what is reported as certain


def claims_of(cases: Iterable[Scored]) -> tuple[np.ndarray, np.ndarray]:
    """Return the probability (n,) of every claimed group, and whether it holds a hidden effect (n,) bool."""
    found = [(p, bool(set(m) & set(one.judged.true))) for one in cases for m, p in one.judged.claims]
    p, right = zip(*found) if found else ((), ())
    return np.array(p, dtype=float), np.array(right, dtype=bool)


def by_exponent(p: np.ndarray, right: np.ndarray, exponents=EXPONENTS) -> pd.DataFrame:
    """Return a row per exponent of the odds: mean log score, claims of CONFIDENT and more, how many of them are right."""
    p = np.clip(p, LEAST, 1 - LEAST)
    rows = []
    for exponent in exponents:
        q = 1 / (1 + ((1 - p) / p) ** exponent)
        sure = q >= CONFIDENT
        score = np.mean(np.log(np.where(right, q, 1 - q)))
        rows.append((exponent, score, int(sure.sum()), int((right & sure).sum())))
    return pd.DataFrame(rows, columns=["exponent", "log score", f"claims >= {CONFIDENT:g}", "right"])
