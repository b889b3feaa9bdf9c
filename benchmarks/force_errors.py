"""Errors of predicted force distributions, as the benchmarks of the network print them."""

from __future__ import annotations

import numpy as np

from gelforge.learning.models.reliability import centre_of_pressure


def force_errors(said: np.ndarray, label: np.ndarray, untouched: np.ndarray, grid: tuple) -> dict[str, float]:
    """Return rms errors [mN] of bins that carry force and of totals, and distances [mm] of the centre of pressure.

    said, label (n, B, 3) [N]; untouched (n,) bool; grid: bins nx, ny, widths [mm]. A centre that is not known is far off.
    """
    error, carries = said - label, label != 0
    total = error.sum(axis=1)
    of_axis = [np.sqrt((error[..., i][carries[..., i]] ** 2).mean()) for i in range(3)]
    row = {f"RMSES {axis} [mN]": 1e3 * value for axis, value in zip("xyz", of_axis)}
    row["total Fz [mN]"] = 1e3 * np.sqrt((total[:, 2] ** 2).mean())
    row["total Fxy [mN]"] = 1e3 * np.sqrt((total[:, :2] ** 2).sum(axis=1).mean())
    away = np.hypot(*(centre_of_pressure(said, *grid) - centre_of_pressure(label, *grid)).T)[~untouched]
    away = np.nan_to_num(away, nan=np.inf)
    return row | {"CoP median [mm]": float(np.median(away)), "CoP p95 [mm]": float(np.quantile(away, 0.95))}
