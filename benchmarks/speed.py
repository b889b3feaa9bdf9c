"""One table of what things cost: a site, all its sensitivities, three studies and memory, beside a state before.

usage: python benchmarks/speed.py [--before TAG] [--rounds 3] [--grid 9] [--presses 30] [--tolerance 1] [--cores 2]
       [--rows NAME ...]
       --grid 41 --presses 2000 is the article's study and the random plan of which the README speaks

The states' files (--before: a tag or commit; now: the present ones, edits too) are copied into temporary folders and run in
turn by the same interpreter, so that both see the same machine. Printed are medians of CPU seconds, all processes of a
command together; a site's are those of its solution alone. A dash stands where a state refuses what a row asks for.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from scipy.spatial import KDTree
from sensors import ARTICLE, DEPTHS_MM, WIDTHS_MM
from two_states import Cost, cost_of, state_before, state_now

from gelforge.progress import Progress, show

DEPTHS = DEPTHS_MM["the article's"]
WIDTH = WIDTHS_MM["the article's"][0]
MARGIN = 5.0  # mm, of every plan
APART = 0.02  # mm
CHECKED_S = 600.0  # at most for what only reads a study


@dataclass(frozen=True)
class Row:
    """One line of the table: what is measured in a state, [s] or [MB]; None where the state refuses it."""

    name: str
    unit: str
    measure: Callable[[Path], float | None]
    rounds: int


class Measured:
    """The commands behind the rows; a press is run once for all rows that ask for it in the same round."""

    def __init__(self, options: argparse.Namespace):
        self.options = options
        self.interpolation = {"interpolation": {"tolerance": options.tolerance}}
        self.presses: dict[tuple[Path, bool], list[dict]] = {}
        self.refused: list[str] = []  # why a dash stands in the table

    def rows(self) -> list[Row]:
        """Return the rows in the order of the table."""
        grid, count = self.options.grid, self.options.presses
        rounds = self.options.rounds
        of_site = [
            Row("site, 8 depths, error bars", "s", lambda state: self.press(state)["cpu_s"], rounds),
            Row("its process, memory", "MB", lambda state: self.last(state)["memory_MB"], rounds),
            Row("its process beyond the solution", "s", lambda state: self.last(state)["start_s"], rounds),
            Row("all sensitivities of the site", "s", self.sensitivities, 1),
        ]
        orbits = grid_plan(grid)
        return [
            *of_site,
            Row(
                f"study of {grid} x {grid} sites, each orbit solved", "s", lambda s: self.study(s, orbits), 1
            ),
            Row(
                f"study of {grid} x {grid} sites, interpolated",
                "s",
                lambda s: self.study(s, orbits | self.interpolation),
                1,
            ),
            Row(f"{count} random presses", "s", lambda s: self.random(s, count), 1),
        ]

    def press(self, state: Path, more: tuple[str, ...] = ()) -> dict:
        """Press at (27, 27) mm and return CPU seconds of the solution and beyond it, and MB."""
        write_study(state, ARTICLE | {"plan": grid_plan(2)})
        depths = ",".join(map(str, DEPTHS))
        where = ["--x", "27", "--y", "27", "--depths", depths, "--study", "speed.yaml", "--out", "press.h5"]
        cost = self.run(["gelforge", "press", *where, *more], state)
        if cost.status:
            return {"cpu_s": None, "start_s": None, "memory_MB": None, "all_s": None}
        solved = json.loads((state / "press.timings.json").read_text())["cpu_seconds"]
        found = {
            "cpu_s": solved,
            "start_s": cost.cpu_s - solved,
            "memory_MB": cost.memory_MB,
            "all_s": cost.cpu_s,
        }
        self.presses.setdefault((state, bool(more)), []).append(found)
        return found

    def last(self, state: Path) -> dict:
        """Return what the last plain press in a state cost."""
        return (self.presses.get((state, False)) or [self.press(state)])[-1]

    def sensitivities(self, state: Path) -> float | None:
        """Return the CPU seconds that all sensitivities add to a site."""
        with_all = self.press(state, ("--sensitivities", "all"))["all_s"]
        return None if with_all is None else with_all - self.last(state)["all_s"]

    def study(self, state: Path, plan: dict) -> float | None:
        """Return the CPU seconds of a study's sites, Snakemake's own among them."""
        write_study(state, ARTICLE | {"plan": plan})
        checked = cost_of(["gelforge", "check", "speed.yaml"], state, CHECKED_S)
        if checked.status:
            self.refused.append(f"{state.name}: {last_line(checked)}")
            return None
        command = ["snakemake", "cells", "--cores", str(self.options.cores), "--configfile", "speed.yaml"]
        cost = self.run([*command, "--forceall"], state)
        return None if cost.status else cost.cpu_s

    def random(self, state: Path, count: int) -> float | None:
        """Return the CPU seconds of a plan without symmetry, interpolated where the state knows that."""
        plan = random_plan(state, count)
        interpolated = self.study(state, plan | self.interpolation)
        return self.study(state, plan) if interpolated is None else interpolated

    def run(self, command: list[str], state: Path) -> Cost:
        cost = cost_of(command, state, self.options.limit)
        if cost.status:
            ended = "ended at the limit" if cost.status == 124 else last_line(cost)
            self.refused.append(f"{state.name}: {' '.join(command[:2])}: {ended}")
        return cost


def last_line(cost: Cost) -> str:
    """Return the last line that a command printed."""
    return next((line for line in reversed(cost.printed.splitlines()) if line.strip()), "no word")


def grid_plan(count: int) -> dict:
    """Return a square grid of count x count sites over the sensor."""
    return {
        "grid": {"spacing_mm": (WIDTH - 2 * MARGIN) / (count - 1), "margin_mm": MARGIN},
        "depths_mm": DEPTHS,
    }


def random_plan(state: Path, count: int) -> dict:
    """Write a plan of presses at random places to random depths, the same for every state, and return what names it."""
    rng = np.random.default_rng(37)
    places = apart(rng.uniform(MARGIN, WIDTH - MARGIN, (count + count // 10 + 1, 2)).round(3))[:count]
    depths = rng.uniform(DEPTHS[0], DEPTHS[-1], count).round(3)
    table = pd.DataFrame(
        {"cell": [f"p{k:04d}" for k in range(count)], "x_mm": places[:, 0], "y_mm": places[:, 1]}
    )
    table.assign(depth_mm=depths).to_csv(state / "plan.csv", index=False)
    return {"file": "plan.csv"}


def apart(places: np.ndarray) -> np.ndarray:
    """Return places (n, 2) [mm] without those that lie within APART of another: a plan takes them for one."""
    near = KDTree(places).query_pairs(APART, output_type="ndarray")
    return np.delete(places, np.unique(near[:, 1]), axis=0)


def write_study(state: Path, study: dict) -> None:
    (state / "speed.yaml").write_text(json.dumps(study))  # JSON is YAML


def table_of(rows: list[Row], states: dict[str, Path]) -> pd.DataFrame:
    """Return the table: per row the median of each state, and how many times the first is the last."""
    lines = []
    total = sum(row.rounds for row in rows) * len(states)
    with Progress("measurements", total) as progress:
        for row in rows:
            found: dict[str, list] = {name: [] for name in states}
            for _ in range(row.rounds):
                for name, state in states.items():  # in turn
                    found[name].append(row.measure(state))
                    progress.advance(note=row.name)
            lines.append({"": f"{row.name} [{row.unit}]"} | line_of(found))
    return pd.DataFrame(lines)


def line_of(found: dict[str, list[float | None]]) -> dict[str, str]:
    """Return the medians of a row in words, and their ratio where there are two."""
    middle = {name: None if None in values else median(values) for name, values in found.items()}
    words = {name: "-" if value is None else number(value) for name, value in middle.items()}
    if len(middle) == 2:
        before, now = middle.values()
        words["before / now"] = "-" if before is None or now is None or now <= 0 else f"{before / now:.1f}"
    return words


def number(value: float) -> str:
    """Return a number to three figures, in full from a hundred on."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--before", metavar="TAG", help="a tag or commit; none: the present state alone")
    parser.add_argument("--rounds", type=int, default=3, help="of a site; studies run once in each state")
    parser.add_argument("--grid", type=int, default=9, help="sites along an edge")
    parser.add_argument("--presses", type=int, default=30, help="of the random plan")
    parser.add_argument(
        "--tolerance", type=float, default=1.0, help="of interpolation, in standard deviations of a label"
    )
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument(
        "--limit", type=float, default=7200.0, help="seconds of a command; beyond it is a dash"
    )
    parser.add_argument("--rows", nargs="+", metavar="WORD", help="only rows whose name holds one of these")
    options = parser.parse_args()
    show()
    measured, words = Measured(options), options.rows or [""]
    rows = [row for row in measured.rows() if any(word in row.name for word in words)]
    with TemporaryDirectory(prefix="gelforge-speed-") as temporary:
        states = {"before": state_before(options.before, Path(temporary, "before"))} if options.before else {}
        states["now"] = state_now(Path(temporary, "now"))
        for state in states.values():  # compiles
            cost_of(["gelforge", "warm-up"], state, CHECKED_S)
        print(table_of(rows, states).to_markdown(index=False, disable_numparse=True, colalign=("left",)))
    for reason in dict.fromkeys(measured.refused):
        print(f"- {reason}")
    if options.before:
        print(
            f"\nbefore: {options.before}. CPU seconds, medians of {options.rounds} turns for a site, else of one."
        )


if __name__ == "__main__":
    main()
