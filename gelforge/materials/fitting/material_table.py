"""The table of the fitted parameters with their intervals."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.stats import t as student

from gelforge.materials.fitting.law_file import MaterialLaw


def material_table(materials: list[MaterialLaw]) -> pd.DataFrame:
    """Return the rows of tables/material: each quantity with its 95 % interval where samples were fitted.

    Intervals follow from the covariance with Student's t; those of parameters whose sign is fixed and of Young's
    modulus E are intervals of their logarithm, so that they keep the sign.

    Parameters
    ----------
    materials : list of MaterialLaw
        Fitted or given.

    Returns
    -------
    pandas.DataFrame
        material, quantity, unit, value, low_95 and high_95; the ends are NaN for given laws.
    """
    rows = []
    for m in materials:
        names, values = m.parameters, m.values
        C = np.full((len(values),) * 2, np.nan) if m.covariance is None else m.covariance
        freedom = m.freedom or max(1, sum((m.samples or {}).values()) - len(values))
        t = student.ppf(0.975, freedom)
        sigmas = np.sqrt(np.maximum(np.diag(C), 0))
        for name, value, sigma, fixed in zip(names, values, sigmas, m.family.logarithmic):
            low, high = _logarithmic(value, t * sigma) if fixed else (value - t * sigma, value + t * sigma)
            rows.append((m.material, name.removesuffix("_kPa"), m.family.unit(name), value, low, high))
        E, gradient = m.law.youngs_modulus * 1e3, m.family.modulus_gradient(values)
        half = t * np.sqrt(np.maximum(gradient @ C @ gradient, 0))
        rows.append((m.material, "E", "kPa", E, *_logarithmic(E, half)))
        for test, r2 in (m.r2_nominal or {}).items():
            rows.append((m.material, f"R2 {test}", "1", r2, np.nan, np.nan))
    return pd.DataFrame(rows, columns=["material", "quantity", "unit", "value", "low_95", "high_95"])


def _logarithmic(value: float, half: float) -> tuple[float, float]:
    """Return the ends of the interval of ln |value| with a half-width of `half` in the value."""
    if not np.isfinite(half):
        return (np.nan, np.nan)
    factor = np.exp(min(half / abs(value), 200.0))
    low, high = sorted((value / factor, value * factor))
    return low, high
