"""What a verdict left in its folder, read for its page; nothing is recomputed but means and residuals."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.mismatch.result.verdict import VERDICT, Verdict, VerdictError, read_verdict
from gelforge.mismatch.result.verdict_tables import BODY_MAP, FLOW, READINGS, REMEDY, read_table
from gelforge.report.figures.neighbours import CURVE_SITES, nearest, one_depth_each, pooled_means

AXES = ("x", "y", "z")
LOADING = ("load", "dwell")
SIGMA = "_sigma"  # ends the columns that are in standard deviations
LEFT = ["before", "after", f"before{SIGMA}", f"after{SIGMA}"]


class JudgedReadings:
    """The table readings.csv of a verdict or a calibration."""

    def __init__(self, table: pd.DataFrame):
        self._given = table

    def _table(self) -> pd.DataFrame:
        return self._given

    @cached_property
    def readings(self) -> pd.DataFrame:
        """Readings with `before` and `after`, measured minus simulated [N], and the same over the errors allowed for.

        after is nan where nothing was put in.
        """
        table = self._table()
        before, after = (table["measured_N"] - table[name] for name in ("base_N", "after_N"))
        sigma = table["sigma_N"]
        return table.assign(**dict(zip(LEFT, (before, after, before / sigma, after / sigma))))

    @property
    def has_after(self) -> bool:
        """Return whether anything was put into the base."""
        return bool(self.readings["after"].notna().any())

    @property
    def axes(self) -> list[str]:
        """Return the axes that were read."""
        return [axis for axis in AXES if (self.readings["axis"] == axis).any()]

    @cached_property
    def strongest_axis(self) -> str:
        """Return the axis whose residual before is largest relative to its noise."""
        size = self.readings[f"before{SIGMA}"] ** 2
        return str(size.groupby(self.readings["axis"]).sum().idxmax())

    def size(self, axis: str, column: str) -> float:
        """Return the root mean square of a column over an axis's readings."""
        values = self.readings.loc[self.readings["axis"] == axis, column]
        return float(np.sqrt(np.nanmean(np.square(values))))

    @cached_property
    def site_means(self) -> pd.DataFrame:
        """Return what is left before and after, mean over the loading at each site and axis, and whether it was held out.

        Where sites have one depth each, these are means over neighbouring sites.
        """
        table = self.readings
        loading = table["phase"].isin(LOADING)
        table = table[loading] if loading.any() else table
        means = table.groupby(["site", "axis"], sort=False)[["x_mm", "y_mm", *LEFT]].mean()
        aside = table["held_out"].eq("positions").groupby([table["site"], table["axis"]], sort=False).any()
        means = means.assign(held_out=aside).reset_index()
        if self.has_one_depth_each:
            for _, rows in means.groupby("axis"):
                at = rows[["x_mm", "y_mm"]].to_numpy(float)
                means.loc[rows.index, LEFT] = pooled_means(at, rows[LEFT].to_numpy(float))
        return means

    @cached_property
    def has_one_depth_each(self) -> bool:
        return one_depth_each(self.readings["site"], self.readings["depth_mm"])

    def sites_about(self, site: str) -> tuple[list[str], float]:
        """Return the sites whose readings make a curve over depth at a site, and how far they reach [mm]: itself.

        Where sites have one depth each: the nearest CURVE_SITES.
        """
        if not self.has_one_depth_each:
            return [site], 0.0
        places = self.readings.groupby("site", sort=False)[["x_mm", "y_mm"]].mean()
        chosen, distance = nearest(places.to_numpy(), places.loc[site].to_numpy(), CURVE_SITES)
        return list(places.index[chosen]), distance

    def shown_sites(self) -> list[tuple[str, str]]:
        """Return up to three (site, why it is shown): largest residual, nearest to the centre, one that was held out."""
        sites = self.site_means[self.site_means["axis"] == self.strongest_axis].set_index("site")
        size = sites["before"].abs()
        middle = np.array([sites["x_mm"].mean(), sites["y_mm"].mean()])
        distance = pd.Series(np.hypot(sites["x_mm"] - middle[0], sites["y_mm"] - middle[1]), sites.index)
        chosen = {size.idxmax(): "largest mismatch"}
        chosen.setdefault(distance.idxmin(), "nearest to the centre")
        aside = size[sites["held_out"] & ~sites.index.isin(chosen)]
        if len(aside):
            chosen[aside.idxmax()] = "held out for the proof"
        elif len(chosen) < min(3, len(sites)):
            chosen[size.drop(list(chosen)).idxmin()] = "smallest mismatch"
        return list(chosen.items())[:3]


class MismatchResults(JudgedReadings):
    """verdict.json, readings.csv, body_map.csv and flow.csv of one folder."""

    def __init__(self, folder: Path):
        self.folder = folder

    def _table(self) -> pd.DataFrame:
        table = read_table(self.folder, READINGS)
        if table is None:
            raise VerdictError(f"{self.folder / VERDICT}: tables has no SHA-256 of {READINGS}; {REMEDY}")
        return table

    @cached_property
    def verdict(self) -> Verdict:
        return read_verdict(self.folder)

    @cached_property
    def body_map(self) -> pd.DataFrame | None:
        return read_table(self.folder, BODY_MAP)

    @cached_property
    def flow(self) -> pd.DataFrame | None:
        """The flow of each site's deepest indentation with images, one row per region; None where no images were judged."""
        table = read_table(self.folder, FLOW)
        if table is None:
            return None
        deepest = table.groupby(["x_mm", "y_mm"])["depth_mm"].transform("max")
        table = table[table["depth_mm"] == deepest]
        first = table.groupby(["x_mm", "y_mm"])["press"].transform("first")
        return table[table["press"] == first].reset_index(drop=True)

    @cached_property
    def strongest_axis(self) -> str:
        """Return the axis whose residual before is largest relative to its noise; z where nothing was found on any."""
        return "z" if self.verdict.state == "consistent" and "z" in self.axes else super().strongest_axis
