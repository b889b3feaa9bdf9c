"""Cost against the number of unknowns and of presses, measured, on log-log axes, of two sensors: a PNG and the slopes.

Left: CPU seconds and peak memory of one site (8 depths, error bars included, near a corner) on meshes of several sizes.
Right: CPU seconds of a plan of random sites with 8 depths each, Snakemake's own among them, over the number of presses.
The sensors are the article's and a block like a GelSight Mini's gel with friction 0.8 (benchmarks/sensors.py).

usage: python benchmarks/cost_plot.py [--near 0.6 0.45 0.3 0.2] [--sites 1 2 4 8] [--out results/speed/cost.png]
       (plans are solved site by site: `plan.interpolation: none`)
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from matplotlib.ticker import NullFormatter
from sensors import DEPTHS_MM, SENSORS, WIDTHS_MM
from speed import MARGIN, write_study
from two_states import cost_of, state_now

from gelforge.indentation.cells.cell_file import read_cell, read_timings
from gelforge.progress import show, tracked
from gelforge.report.figures.style import FAINT, MEASURED, SIMULATED, new_figure, styled

LIMIT_S = 7200.0  # of a command


def of_mesh(state: Path, sensor: str, near: float) -> dict:
    """Return what a site 5 mm from two walls costs on a mesh with this element size [mm] under the ball, far four times."""
    mechanics = SENSORS[sensor].get("mechanics", {}) | {"mesh": {"near_mm": near, "far_mm": 4 * near}}
    write_study(state, SENSORS[sensor] | {"mechanics": mechanics, "plan": one_site(sensor)})
    x, y = (width - MARGIN for width in WIDTHS_MM[sensor])
    depths = ",".join(map(str, DEPTHS_MM[sensor]))
    where = ["--x", str(x), "--y", str(y), "--depths", depths, "--study", "speed.yaml", "--out", "press.h5"]
    cost = cost_of(["gelforge", "press", *where], state, LIMIT_S)
    if cost.status:
        raise SystemExit(cost.printed)
    return {
        "sensor": sensor,
        "near [mm]": near,
        "unknowns": int(read_cell(state / "press.h5", []).attributes["degrees_of_freedom"]),
        "CPU [s]": read_timings(state / "press.h5")["cpu_seconds"],
        "peak [GB]": cost.memory_MB / 1e3,
    }


def one_site(sensor: str) -> dict:
    """Return the plan of a study that is only pressed by hand."""
    return {"grid": {"spacing_mm": 100.0, "margin_mm": MARGIN}, "depths_mm": DEPTHS_MM[sensor]}


def of_plan(state: Path, sensor: str, sites: int) -> dict:
    """Return what a plan of random sites costs, all its jobs and Snakemake's own share."""
    rng = np.random.default_rng(sites)
    places = rng.uniform(MARGIN, np.array(WIDTHS_MM[sensor]) - MARGIN, (sites, 2)).round(3)
    depths = DEPTHS_MM[sensor]
    rows = [(f"p{k:04d}", x, y, depth) for k, (x, y) in enumerate(places) for depth in depths]
    pd.DataFrame(rows, columns=["cell", "x_mm", "y_mm", "depth_mm"]).to_csv(state / "plan.csv", index=False)
    write_study(state, SENSORS[sensor] | {"plan": {"file": "plan.csv"}})
    command = ["snakemake", "cells", "--cores", "2", "--configfile", "speed.yaml", "--forceall"]
    cost = cost_of(command, state, LIMIT_S)
    if cost.status:
        raise SystemExit(cost.printed)
    return {"sensor": sensor, "presses": sites * len(depths), "CPU [s]": cost.cpu_s, "wall [s]": cost.wall_s}


def slope(x: pd.Series, y: pd.Series) -> float:
    """Return the exponent of the power law through the points."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


@styled
def cost_figure(meshes: pd.DataFrame, plans: pd.DataFrame):
    """Return the two panels."""
    figure, axes = new_figure(8.6, 3.4, ncols=2)
    left, right = axes[0]
    for (name, mesh), colour in zip(meshes.groupby("sensor", sort=False), (SIMULATED, MEASURED)):
        for column, style, what in (("CPU [s]", "o-", "s"), ("peak [GB]", "s--", "GB")):
            label = f"{name}, {what}, slope {slope(mesh['unknowns'], mesh[column]):.2f}"
            left.loglog(mesh["unknowns"], mesh[column], style, color=colour, label=label)
        plan = plans[plans["sensor"] == name]
        label = f"{name}, slope {slope(plan['presses'], plan['CPU [s]']):.2f}"
        right.loglog(plan["presses"], plan["CPU [s]"], "o-", color=colour, label=label)
        first = plan["CPU [s]"].iloc[0] * plan["presses"] / plan["presses"].iloc[0]
        right.loglog(plan["presses"], first, ":", color=FAINT)
    left.set_xlabel("unknowns of the site")
    left.set_title("One site, 8 depths, error bars: CPU seconds, peak memory", fontsize=9)
    right.set_xlabel("presses of a random plan")
    right.set_title("CPU seconds of the plan (dotted: each as dear as the first)", fontsize=9)
    for ax in (left, right):
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.grid(True, which="both")
        ax.legend(loc="upper left", fontsize=7)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--near", type=float, nargs="+", default=[0.6, 0.45, 0.3, 0.2])
    parser.add_argument("--sites", type=int, nargs="+", default=[1, 2, 4, 8])
    parser.add_argument("--out", type=Path, default=Path("results/speed/cost.png"))
    options = parser.parse_args()
    show()
    with TemporaryDirectory(prefix="gelforge-cost-") as temporary:
        state = state_now(Path(temporary))
        cost_of(["gelforge", "warm-up"], state, LIMIT_S)
        sizes = [(sensor, near) for sensor in SENSORS for near in options.near]
        meshes = pd.DataFrame([of_mesh(state, *one) for one in tracked(sizes, "meshes")])
        counts = [(sensor, sites) for sensor in SENSORS for sites in options.sites]
        plans = pd.DataFrame([of_plan(state, *one) for one in tracked(counts, "plans")])
    print(meshes.round(3).to_markdown(index=False), "\n")
    print(plans.round(1).to_markdown(index=False), "\n")
    for table, x, columns in (
        (meshes, "unknowns", ("CPU [s]", "peak [GB]")),
        (plans, "presses", ("CPU [s]", "wall [s]")),
    ):
        for name, part in table.groupby("sensor", sort=False):
            slopes = ", ".join(f"{column} {slope(part[x], part[column]):.2f}" for column in columns)
            print(f"slopes over {x}, sensor {name}: {slopes}")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    cost_figure(meshes, plans).savefig(options.out, dpi=110, metadata={"Software": None})
    print(f"written to {options.out}")


if __name__ == "__main__":
    main()
