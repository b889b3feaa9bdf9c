"""Parameter values with their intervals, in the form of verdict.json."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import norm

from gelforge.mismatch.model.effect import Parameter
from gelforge.mismatch.result.verdict import Amount

NINETY = float(norm.ppf(0.95))


def interval(parameter: Parameter, a: float, sd: float) -> tuple[float, float]:
    """Return the 90 % interval of a value, within its physical range."""
    low, high = parameter.bounds
    low, high = (
        (max(low, 0.0) if parameter.sign > 0 else low),
        (min(high, 0.0) if parameter.sign < 0 else high),
    )
    return tuple(np.clip([a - NINETY * sd, a + NINETY * sd], low, high).tolist())


def value_entries(parameters: Sequence[Parameter], amounts: np.ndarray, spread: np.ndarray) -> list[Amount]:
    """Return amounts (p,) of covariance (p, p) with their 90 % intervals."""
    sd = np.sqrt(np.maximum(np.diag(spread), 0.0))
    return [
        Amount(
            name=p.name,
            unit=p.unit,
            value=float(a),
            interval_90=interval(p, float(a), float(s)),
            bounds=p.bounds if np.isfinite(p.bounds).all() else None,
        )
        for p, a, s in zip(parameters, amounts, sd)
    ]
