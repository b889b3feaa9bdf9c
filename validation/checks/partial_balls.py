"""What a ball in the gel changes: by element size and rule of mixing, by distance, and next to FElupe's mesh bent to it.

usage: python -m validation.checks.partial_balls [--depth 0.8] [--sizes 1.2 0.6 0.4]          (one thread; some minutes)

The base study of the concealed sets, a ball of 1.3 mm in the middle of the gel, empty (a thousandth of the gel's stiffness)
and hard (20 times), pressed 1.4 mm aside. Far from the contact elements have the sizes that are asked for, under it half
of that. Prints the change of Fz [mN] with the rule of the elements (fields.mixed_factor and bulk_factor_of) and with
the mean of the moduli: as sizes shrink both go to the same change, and the better rule is nearer to it on large elements.
Then, on elements of the second size, the change [% of Fz] by the distance of the press from the ball; and FElupe's, of the
concealed sets, where no element is cut (validation/pressed.py).
"""

from __future__ import annotations

import argparse
import sys
from contextlib import nullcontext
from unittest import mock

import numpy as np
import pandas as pd

from gelforge.config import Study, load_study, study_from
from gelforge.config.basis.variants import merged
from gelforge.indentation.effects import fields
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving import model, simulate
from gelforge.indentation.solving.sensitivities import unmirrored
from gelforge.laws_of_study import laws_and_doubts, material_laws_of
from validation.library import load_library
from validation.sensors import SMALL
from validation.sets import CONFIG

BALL = (13.0, 11.0, -3.0)
PRESSED = [
    (14.0, 12.0),
    (10.0, 10.0),
    (12.0, 6.0),
    (16.0, 16.0),
    (16.0, 4.0),
    (4.0, 10.0),
]  # ever farther from it
KINDS = {"empty": 1e-3, "hard": 20.0}
FELUPES = {"empty": "void", "hard": "inclusion"}  # the solutions of the concealed sets


def study_with(base: Study, size: float, factor: float | None) -> Study:
    """Return the study on elements of a size [mm], with a ball of some factor or with none."""
    ball = {"centre_mm": BALL, "radius_mm": 1.3, "factor": factor}
    mesh = {"near_mm": size / 2, "far_mm": size}
    mechanics = {"mesh": mesh, "effects": {"geometry": {"inclusions": [ball] if factor else []}}}
    return study_from(merged(unmirrored(base).model_dump(mode="json"), {"mechanics": mechanics}))


def pressing(study: Study, laws: dict, depth: float, place: tuple[float, float] = PRESSED[0]) -> float:
    """Return Fz [mN]; nan where there is no equilibrium."""
    cell = simulate.simulate_cell(study, laws, PlannedCell("", *place, (depth,)))
    return 1e3 * float(cell.arrays["total_force_N"][-1, 2]) if cell.converged else np.nan


def mean_of_moduli():
    """Return the context in which an element's stiffness is the mean of its parts'."""
    return mock.patch.object(model, "element_stiffness", _by_means)


def _by_means(mesh, sensor, mechanics):
    factor, effects = np.ones(len(mesh.elements)), mechanics.effects
    for ball in effects.geometry.inclusions:
        factor *= 1 + (ball.factor - 1) * fields._share_within(mesh, np.array(ball.centre_mm), ball.radius_mm)
    return (factor, factor) if effects.geometry.inclusions else (None, None)


def by_distance(base: Study, laws: dict, size: float, depth: float) -> pd.DataFrame:
    """Return the changes [% of Fz] by a ball, ours and FElupe's, by the distance [mm] of the press from its middle."""
    rows, library = [], load_library()
    plain = study_with(base, size, None)
    for place in PRESSED:
        x, y = np.array(place) - SMALL.middle
        row = {"distance [mm]": float(np.hypot(*(np.array(place) - BALL[:2])))}
        without = pressing(plain, laws, depth, place)
        for kind, factor in KINDS.items():
            row[kind] = 100 * (pressing(study_with(base, size, factor), laws, depth, place) / without - 1)
            change = library.defects[FELUPES[kind], "inner"].at(np.array([[x, y]]), np.array([depth]), 0)
            row[f"{kind}, FElupe"] = 100 * float(np.expm1(change[0][0])) or np.nan
        rows.append(row)
        print(row, file=sys.stderr, flush=True)
    return pd.DataFrame(rows)


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
    found = by_distance(base, laws, asked.sizes[min(1, len(asked.sizes) - 1)], asked.depth)
    print()
    print(found.to_markdown(index=False, floatfmt=".2f"))


if __name__ == "__main__":
    main()
