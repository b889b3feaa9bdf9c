"""What all derivatives of a site cost next to the site itself, and how well they agree with neighbouring presses.

The parameters are those that a verdict asks for at this site (effects of the catalogue with their places, boxes of the
body map) and can be had along one run; with --all-boxes, every box of the body map, felt or not. Those that need solutions
of their own (elastic base, switches) are listed, and timed with --subtracted.

usage: python benchmarks/sensitivity_cost.py [--x 27 --y 27] [--mesh own | coarser] [--all-boxes] [--neighbours 12]
       [--subtracted]

CPU seconds of one thread; the article's sensor, 8 depths; prints Markdown tables. --neighbours: of how many parameters a
press of its own is followed next to the site, spread over all of them; 0: all.
"""

# ruff: noqa: E402  (threads are set before the libraries start theirs)

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import numpy as np
import pandas as pd
from mismatch_cost import DEPTHS, planned, write
from neighbouring_presses import EXACT, Neighbour, follow_beside

from gelforge.api.studies import paper_study
from gelforge.indentation.cells.binning import bin_forces, bin_shares
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.sensitivities import (
    Variation,
    _along_it,
    _model,
    derivatives,
    subtracted,
    unmirrored,
)
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.laws_of_study import laws_of
from gelforge.mechanics.solving.equilibrium import Press
from gelforge.mismatch.effects import with_dependencies
from gelforge.mismatch.evidence.candidates import BOX, effects_of_forces
from gelforge.mismatch.fem.asked import asked_of, observed_by
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.model.effect import Context, Curves
from gelforge.mismatch.readings.sessions import observe


def asked(solver: Solver, site: PlannedCell, all_boxes: bool) -> dict[str, Variation]:
    """Return the variations that a verdict asks for at a site."""
    with tempfile.TemporaryDirectory() as folder:
        recording = write(Path(folder) / "plan", planned(solver.study, 2, False, 0))
        observations = observe([recording], solver.study.sensor, 1.0)
    sites = len(observations.sites)
    curves = Curves((DEPTHS,) * sites, (np.outer(DEPTHS, [0.0, 0.0, -1.0]),) * sites)
    context = Context(solver.study, observations, np.zeros_like(observations.force), curves, {}, {})
    effects = [*with_dependencies(effects_of_forces(solver.study).values()), BOX]
    every = list(asked_of(solver, effects, context))
    boxes = {one.key: one.variation for one in every if one.effect is BOX} if all_boxes else {}
    return observed_by(every, site) | boxes


def followed(study, laws, site: PlannedCell, variations: dict[str, Variation]) -> dict[str, tuple]:
    """Return d total / d amount (D, 3) and d bins / d amount (D, B, 3) by a neighbouring press for each variation."""
    base = _model(study, laws, site)
    press = Press(
        base.body, base.shape, replace(base.settings, **EXACT), study.mechanics.solver.linear_solver
    )
    varied = [_model(unmirrored(one.study), one.laws, site, base) for one in variations.values()]
    near = [
        Neighbour(press, m.body, m.shape, replace(m.settings, **EXACT), m.start, m.centres) for m in varied
    ]
    amounts = [one.amount for one in variations.values()]
    slopes = []
    for state, states in follow_beside(press, press.start_at(base.start), base.centres, near):
        own = state.normal_force + state.friction_force
        slopes.append([(one.normal_force + one.friction_force - own) / a for one, a in zip(states, amounts)])
    shares = bin_shares(base.mesh, study.sensor, study.mechanics.binning)
    along = np.moveaxis(np.array(slopes), 1, 0)
    return {name: (one.sum(axis=1), bin_forces(one, shares)) for name, one in zip(variations, along)}


def timed(work):
    began = time.process_time()
    found = work()
    return found, time.process_time() - began


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--x", type=float, default=27.0)
    parser.add_argument("--y", type=float, default=27.0)
    parser.add_argument("--mesh", choices=("own", "coarser"), default="own")
    parser.add_argument("--all-boxes", action="store_true")
    parser.add_argument("--neighbours", type=int, default=12)
    parser.add_argument("--subtracted", action="store_true")
    options = parser.parse_args()
    paper = paper_study()
    laws, site = laws_of(paper, []), PlannedCell("bench", options.x, options.y, tuple(DEPTHS))
    solver = Solver(paper, laws, {}, Path("unused"))
    variations = asked(solver, site, options.all_boxes)
    study = solver.coarse
    if options.mesh == "own":
        study = unmirrored(paper)
        sizes = {"mesh": paper.mechanics.mesh}

        def on_own_mesh(one):
            return one.model_copy(update={"mechanics": one.mechanics.model_copy(update=sizes)})

        variations = {
            name: Variation(
                on_own_mesh(v.study), v.laws, v.amount, v.alone, v.without and on_own_mesh(v.without)
            )
            for name, v in variations.items()
        }
    simulate_cell(study, laws, PlannedCell("warm", options.x, options.y, (0.1,)))  # loads kernels
    base = _model(study, laws, site)
    along = {
        name: one
        for name, one in variations.items()
        if not one.alone and _along_it(base, _model(unmirrored(one.study), one.laws, site, base))
    }
    cell, of_site = timed(lambda: simulate_cell(study, laws, site))
    (found, of_all) = timed(lambda: derivatives(study, laws, site, along)[1])
    of_run = timed(lambda: derivatives(study, laws, site, {}))[1]
    names = list(along)
    if options.neighbours:
        names = [names[int(k)] for k in np.linspace(0, len(names) - 1, min(options.neighbours, len(names)))]
    chosen = {name: along[name] for name in names}
    near, of_near = timed(lambda: followed(study, laws, site, chosen))
    unknowns, each = base.body.pattern.size, (of_near - of_run) / len(chosen)
    direct = of_all - of_run
    rows = [
        ("the site", 1, of_site),
        ("direct differentiation, beyond its run", len(along), direct),
        (f"neighbouring presses, from {len(chosen)} of them", len(along), each * len(along)),
    ]
    apart = [name for name in variations if name not in along]
    if options.subtracted:
        own = {name: timed(lambda n=name: subtracted(cell, laws, site, variations[n]))[1] for name in apart}
        rows.append(("two solutions subtracted: " + ", ".join(own), len(own), sum(own.values())))
    print(f"({options.x:g}, {options.y:g}) mm, {unknowns} unknowns, 8 depths\n")
    table = pd.DataFrame(rows, columns=["what", "parameters", "CPU [s]"])
    table["over the site"] = table["CPU [s]"] / of_site
    print(table.to_markdown(index=False, floatfmt=".2f"))
    print(f"\nsolved by themselves: {', '.join(apart)}\n")
    print(
        pd.DataFrame([agreement(name, near[name], found[name], chosen[name]) for name in names]).to_markdown(
            index=False
        )
    )


def agreement(name: str, near: tuple, own, variation: Variation) -> dict:
    """Return how far a derivative is from a neighbour's, over the largest; and how large a change it is."""
    total, bins = near
    size = np.linalg.norm(total, axis=1).max()
    return {
        "parameter": name,
        "step's change of force [mN]": f"{1e3 * size * abs(variation.amount):.2g}",
        "total [%]": f"{100 * np.abs(own.total - total).max() / size:.2g}",
        "bins [%]": f"{100 * np.abs(own.bins - bins).max() / np.abs(bins).max():.2g}",
    }


if __name__ == "__main__":
    main()
