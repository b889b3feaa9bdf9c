"""One table of what things cost: a site, all its sensitivities, three studies and memory, next to a state before.

usage: python benchmarks/speed.py [--before TAG] [--rounds 3] [--orbits 24] [--grid 9] [--presses 30] [--tolerance 1]
       [--cores 2] [--rows NAME ...]
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
DEPTH_LIST = ",".join(map(str, DEPTHS))
WIDTH = WIDTHS_MM["the article's"][0]
MARGIN = 5.0  # mm, of every plan
ARTICLE_GRID = 41  # positions along an edge in the article's study
APART = 0.02  # mm
CHECKED_S = 600.0  # at most for what only reads a study


@dataclass(frozen=True)
class Row:
    """One line of the table: what is measured in a state, [s] or [MB]; None where the state refuses it."""

    name: str
    unit: str
    measure: Callable[[Path], float | None]
    rounds: int


@dataclass(frozen=True)
class Press:
    """A study and the place, depths and path of one press in it, as `gelforge press` takes them."""

    study: str
    where: tuple[str, ...]


@dataclass(frozen=True)
class Pressed:
    """What a press cost: CPU seconds of its solution, of its process beyond that, and of both; MB. None: refused."""

    cpu_s: float | None = None
    start_s: float | None = None
    memory_MB: float | None = None
    all_s: float | None = None


class Measured:
    """The commands behind the rows; a press is run once for all rows that ask for it in the same round."""

    def __init__(self, options: argparse.Namespace):
        self.options = options
        self.interpolation = {"interpolation": {"tolerance": options.tolerance}}
        self.presses: dict[tuple[Path, Press], Pressed] = {}
        self.refused: list[str] = []  # why a dash stands in the table

    def rows(self) -> list[Row]:
        """Return the rows in the order of the table."""
        grid, count, orbits = self.options.grid, self.options.presses, self.options.orbits
        rounds = self.options.rounds
        corner = Press("speed.yaml", ("--x", "27", "--y", "27", "--depths", DEPTH_LIST))
        sheared = Press("speed.yaml", ("--x", "12", "--y", "16", "--depths", DEPTH_LIST, "--shear", "3", "0"))
        dome = Press("config/smoke/dome.yaml", ("--x", "12", "--y", "16", "--depths", "0.5,1,1.5"))
        tactip = Press("config/smoke/tactip.yaml", ("--x", "20", "--y", "20", "--depths", "0.5,1,1.5,2"))
        every = grid_plan(grid)
        return [
            Row("site, 8 depths, error bars", "s", lambda s: self.press(s, corner).cpu_s, rounds),
            Row("its process, memory", "MB", lambda s: self.last(s, corner).memory_MB, rounds),
            Row("its process beyond the solution", "s", lambda s: self.last(s, corner).start_s, rounds),
            Row("all sensitivities of the site", "s", lambda s: self.sensitivities(s, corner), 1),
            Row("8 steps down, 10 aside", "s", lambda s: self.press(s, sheared).cpu_s, rounds),
            Row("dome, tetrahedra", "s", lambda s: self.press(s, dome).cpu_s, 1),
            Row("TacTip-like, tetrahedra", "s", lambda s: self.press(s, tactip).cpu_s, 1),
            Row(f"median of {orbits} sites", "s", lambda s: self.sample(s, orbits), 1),
            Row(f"study of {grid} x {grid} sites, each orbit solved", "s", lambda s: self.study(s, every), 1),
            Row(
                f"study of {grid} x {grid} sites, interpolated",
                "s",
                lambda s: self.study(s, every | self.interpolation),
                1,
            ),
            Row(f"{count} random presses", "s", lambda s: self.random(s, count), 1),
        ]

    def press(self, state: Path, press: Press, more: tuple[str, ...] = ()) -> Pressed:
        """Run a press in a state and return what it cost."""
        write_study(state, ARTICLE | {"plan": grid_plan(2)})
        where = [*press.where, "--study", press.study, "--out", "press.h5"]
        cost = self.run(["gelforge", "press", *where, *more], state)
        found = Pressed()
        if not cost.status:
            solved = json.loads((state / "press.timings.json").read_text())["cpu_seconds"]
            found = Pressed(solved, cost.cpu_s - solved, cost.memory_MB, cost.cpu_s)
        if not more:
            self.presses[state, press] = found
        return found

    def last(self, state: Path, press: Press) -> Pressed:
        """Return what a press in a state cost the last time."""
        return self.presses.get((state, press)) or self.press(state, press)

    def sensitivities(self, state: Path, press: Press) -> float | None:
        """Return the CPU seconds that all sensitivities add to a site."""
        with_all, without = (
            self.press(state, press, ("--sensitivities", "all")).all_s,
            self.last(state, press).all_s,
        )
        return None if with_all is None or without is None else with_all - without

    def sample(self, state: Path, count: int) -> float | None:
        """Return the median CPU seconds of sites of the article's study, drawn from those that symmetry leaves."""
        table = pd.DataFrame(drawn_orbits(count), columns=["x_mm", "y_mm"])
        table.insert(0, "cell", [f"s{k:02d}" for k in range(len(table))])
        depths = pd.DataFrame({"depth_mm": DEPTHS})
        table.merge(depths, how="cross").to_csv(state / "plan.csv", index=False)
        for old in state.glob("results/cost/cells/*"):
            old.unlink()
        if self.study(state, {"file": "plan.csv"}) is None:
            return None
        timings = [json.loads(file.read_text()) for file in state.glob("results/cost/cells/*.timings.json")]
        return median(one["cpu_seconds"] for one in timings)

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


def drawn_orbits(count: int) -> np.ndarray:
    """Return places (count, 2) [mm] of the article's grid, drawn from one octant: symmetry gives the others."""
    along = np.linspace(MARGIN, WIDTH / 2, ARTICLE_GRID // 2 + 1)
    octant = [(x, y) for k, x in enumerate(along) for y in along[k:]]
    return np.array(octant)[np.random.default_rng(60).permutation(len(octant))[:count]]


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


def print_table(rows: list[Row], states: dict[str, Path]) -> None:
    """Print row by row the median of each state, and how many times the first is the last."""
    heads = ["", *states, *(["before / now"] if len(states) == 2 else [])]
    print(f"| {' | '.join(heads)} |\n|:--|{'--:|' * (len(heads) - 1)}", flush=True)
    total = sum(row.rounds for row in rows) * len(states)
    with Progress("measurements", total) as progress:
        for row in rows:
            found: dict[str, list] = {name: [] for name in states}
            for _ in range(row.rounds):
                for name, state in states.items():  # in turn
                    found[name].append(row.measure(state))
                    progress.advance(note=row.name)
            words = line_of(found)
            print(f"| {row.name} [{row.unit}] | {' | '.join(words.values())} |", flush=True)


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
        "--orbits", type=int, default=24, help="sites drawn from the 231 of the article's study"
    )
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
        print_table(rows, states)
    for reason in dict.fromkeys(measured.refused):
        print(f"- {reason}")
    if options.before:
        print(
            f"\nbefore: {options.before}. CPU seconds, medians of {options.rounds} turns for a site, else of one."
        )


if __name__ == "__main__":
    main()
