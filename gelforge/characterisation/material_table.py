"""The table of the fitted parameters with their intervals."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.stats import t as student

from gelforge.characterisation.law_file import MaterialLaw


def material_table(materials: list[MaterialLaw]) -> pd.DataFrame:
    """Return the rows of tables/material: each quantity with its 95 % interval where samples were fitted.

    Intervals follow from the covariance with Student's t for (samples - parameters) degrees of freedom; those
    of mu_k and of Young's modulus E are intervals of their logarithm, so that they keep the sign.
    """
    rows = []
    for m in materials:
        mu, alpha = np.array(m.law.mu) * 1e3, np.array(m.law.alpha)
        C = np.full((2 * len(mu),) * 2, np.nan) if m.covariance is None else m.covariance
        sigma = np.sqrt(np.diag(C))
        freedom = max(1, sum((m.samples or {}).values()) - len(sigma))
        t = student.ppf(0.975, freedom)
        for k in range(len(mu)):
            factor = np.exp(t * sigma[2 * k] / abs(mu[k]))
            interval = sorted((mu[k] / factor, mu[k] * factor)) if np.isfinite(factor) else (np.nan, np.nan)
            rows.append((m.material, f"mu_{k + 1}", "kPa", mu[k], *interval))
            half = t * sigma[2 * k + 1]
            rows.append((m.material, f"alpha_{k + 1}", "1", alpha[k], alpha[k] - half, alpha[k] + half))
        E = m.law.youngs_modulus * 1e3
        gradient = 1.5 * np.column_stack([alpha, mu]).ravel()  # dE / d(mu_1, alpha_1, ...)
        factor = np.exp(t * np.sqrt(gradient @ C @ gradient) / E)
        rows.append((m.material, "E", "kPa", E, E / factor, E * factor))
        for test, r2 in (m.r2_nominal or {}).items():
            rows.append((m.material, f"R2 {test}", "1", r2, np.nan, np.nan))
    return pd.DataFrame(rows, columns=["material", "quantity", "unit", "value", "low_95", "high_95"])
