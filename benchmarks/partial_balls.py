"""What a ball in the gel changes, by element size and by how elements that it fills in part are mixed.

usage: python benchmarks/partial_balls.py [--depth 0.8] [--sizes 1.2 0.6 0.4]          (one thread; some minutes)

The base study of the concealed sets, a ball of 1.3 mm in the middle of the gel, empty (a thousandth of the gel's stiffness)
and hard (20 times), pressed 1.4 mm beside it. Far from the contact elements have the sizes that are asked for, under it half
of that. Prints the change of Fz [mN] with the rule of the elements (fields.mixed_factor and the bulk's compliances) and with
the mean of the moduli: as sizes shrink both go to the same change, and the better rule is nearer to it on large elements.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import nullcontext
from pathlib import Path
from unittest import mock

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.concealed.library import load_library
from benchmarks.concealed.presses import MIDDLE
from benchmarks.concealed.sets import CONFIG
from benchmarks.concealed.world import World
from gelforge.cli.bench import material_laws_of
from gelforge.cli.factory import laws_and_doubts
from gelforge.config import Study, load_study, study_from
from gelforge.config.variants import merged
from gelforge.indentation import simulate
from gelforge.indentation.effects import fields
from gelforge.indentation.plan import PlannedCell
from gelforge.indentation.sensitivities import unmirrored

BALL, PRESSED = (11.0, 7.0, -3.0), (12.0, 6.0)
TURNS = 3  # quarter turns that carry the solved ball, at (3, 1) mm from the middle, to this one
KINDS = {"empty": 1e-3, "hard": 20.0}


def study_with(base: Study, size: float, factor: float | None) -> Study:
    """Return the study on elements of a size [mm], with a ball of some factor or with none."""
    ball = {"centre_mm": BALL, "radius_mm": 1.3, "factor": factor}
    mesh = {"near_mm": size / 2, "far_mm": size}
    mechanics = {"mesh": mesh, "effects": {"geometry": {"inclusions": [ball] if factor else []}}}
    return study_from(merged(unmirrored(base).model_dump(mode="json"), {"mechanics": mechanics}))


def pressing(study: Study, laws: dict, depth: float) -> float:
    """Return Fz [mN]; nan where there is no equilibrium."""
    cell = simulate.simulate_cell(study, laws, PlannedCell("", *PRESSED, (depth,)))
    return 1e3 * float(cell.arrays["total_force_N"][-1, 2]) if cell.converged else np.nan


def mean_of_moduli():
    """Return the context in which an element's stiffness is the mean of its parts'."""
    return mock.patch.object(simulate, "element_stiffness", _by_means)


def _by_means(mesh, sensor, effects):
    factor = np.ones(len(mesh.elements))
    for ball in effects.geometry.inclusions:
        factor *= 1 + (ball.factor - 1) * fields._ball_share(mesh, ball)
    return (factor, factor) if effects.geometry.inclusions else (None, None)


def by_felupe(name: str, depth: float) -> float:
    """Return the change of Fz [mN] by which recordings of the concealed sets hide the ball."""
    library = load_library()
    world, plain = World(library), World(library)
    world.changes.append(lambda xy, d: library.defects[name, "inner"].at(xy, d, TURNS))
    place = np.array([PRESSED]) - MIDDLE
    with_it, without = (one.elastic(place, np.array([depth]))[0, 2] for one in (world, plain))
    return 1e3 * float(with_it - without)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--depth", type=float, default=0.8)
    parser.add_argument("--sizes", type=float, nargs="*", default=[1.2, 0.6, 0.4])
    asked = parser.parse_args()
    base = load_study(CONFIG / "concealed.yaml")
    laws, _ = laws_and_doubts(material_laws_of(base, []))
    rows = []
    for size in asked.sizes:
        row = {"elements [mm]": size, "no ball": pressing(study_with(base, size, None), laws, asked.depth)}
        for kind, factor in KINDS.items():
            for words, rule in (("", nullcontext()), (", mean of moduli", mean_of_moduli())):
                with rule:
                    there = pressing(study_with(base, size, factor), laws, asked.depth)
                row[f"{kind}{words}"] = there - row["no ball"]
        rows.append(row)
        print(row, file=sys.stderr, flush=True)
    print(pd.DataFrame(rows).to_markdown(index=False, floatfmt=".1f"))
    for kind, name in (("empty", "void"), ("hard", "inclusion")):
        print(f"{kind}, in the concealed sets (FElupe): {by_felupe(name, asked.depth):.1f}")


if __name__ == "__main__":
    main()
