"""Random presses: sensors, laws, indenters, positions, paths and effects drawn by seed, small and coarse; does any break?

Every draw must converge, or fail or be refused with a reason that says what was found and (a refusal) what to do; nothing
that is not finite may be in any array, and forces must balance. Draw k of a seed is always the same press, whichever others
are run, so that one that fails can be had again alone.

usage: python benchmarks/random_presses.py [--draws 200] [--seed 1] [--first 0]      (one thread; about 2 s a draw)
"""

from __future__ import annotations

import argparse
import os
import re
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402  (threads are set before the libraries start theirs)

from gelforge.cli.by_hand.press import derivable_effects  # noqa: E402
from gelforge.config import ConfigError, Study, study_from  # noqa: E402
from gelforge.indentation.cells.cell_file import Cell  # noqa: E402
from gelforge.indentation.effects.catalogue import CATALOGUE, Effect, Place  # noqa: E402
from gelforge.indentation.paths.planned_cell import PlannedCell  # noqa: E402
from gelforge.indentation.planning.plan import check_inside, press_path  # noqa: E402
from gelforge.laws_of_study import laws_of  # noqa: E402

WEDGE = Path(__file__).parents[1] / "config" / "indenters" / "wedge.stl"
EDGE_MM = 2.0  # the nearest that a position lies to the sensor's edge
NEAR_MM = 0.8
BALANCE = (
    1e-5  # ten times the solver's tolerance of the unbalanced force, of which the balance is a sum over nodes
)
REMEDY = re.compile(
    r"\b(press|make|change|should|use|take|give|correct|leave|round|refine|choose|turn|move|close|name|fit)\b",
    re.I,
)
# Amounts below nothing have no meaning.
ONE_SIDED = {
    "compressibility", "elastic_base", "viscoelastic", "mullins", "friction_law", "adhesion", "toe_region", "wall_gap",
    "delamination", "void", "inclusion", "frame_compliance", "base_bending",
}  # fmt: skip


@dataclass(frozen=True)
class Draw:
    """A drawn press; refusal: why a part of it was not accepted, then there is no press."""

    number: int
    words: str
    study: Study | None
    planned: PlannedCell | None
    refusal: str = ""


@dataclass(frozen=True)
class Outcome:
    """What became of a draw."""

    draw: Draw
    status: str  # converged, failed, refused or error
    reason: str
    not_finite: tuple[str, ...]  # names of arrays and attributes
    balance: float  # the worst of forces and of moments [-]
    seconds: float

    @property
    def is_sound(self) -> bool:
        """Whether it converged in balance, or says clearly why not; nothing in it is not finite."""
        if self.not_finite or self.status == "error":
            return False
        if self.status == "converged":
            return self.balance <= BALANCE
        return is_clear(self.reason, self.status == "refused")


def is_clear(reason: str, with_remedy: bool) -> bool:
    """Return whether a reason holds a number or what was found, and a remedy where one is asked."""
    found = re.search(r"\d|found|\[", reason)
    return bool(found and (not with_remedy or REMEDY.search(reason)))


# ------------------------------------------------------------------------------------------ drawing
def drawn(seed: int, number: int) -> Draw:
    """Return draw `number` of a seed."""
    rng = np.random.default_rng([seed, number])
    sensor = sensor_of(rng)
    indenter = indenter_of(rng)
    laws = {"soft": law_of(rng, rng.uniform(3, 15)), "stiff": law_of(rng, rng.uniform(20, 150))}
    height = sum(layer["thickness_mm"] for layer in sensor["layers"])
    mechanics = mechanics_of(rng, sensor)
    names = effects_of(rng, sensor, indenter)
    amounts = {name: amount_of(rng, CATALOGUE[name]) for name in names}
    planned = path_of(rng, sensor, height)
    words = "; ".join(
        [
            sensor.get("shape", {}).get("kind", "block"),
            "/".join(law.get("law", "") + str(len(law.get("alpha", [])) or "") for law in laws.values()),
            indenter["kind"],
            f"({planned.x_mm:.2f}, {planned.y_mm:.2f}) of {sensor['width_x_mm']:.1f} x {sensor['width_y_mm']:.1f} mm",
            f"{planned.deepest_mm:.2f} of {height:.1f} mm "
            + "-".join(dict.fromkeys(planned.phases or ("load",))),
            ", ".join(f"{name} {amount:.3g}" for name, amount in amounts.items()),
        ]
    )
    content = {
        "study": "random",
        "materials": {name: {"parameters": law} for name, law in laws.items()},
        "sensor": sensor,
        "indenter": indenter,
        "plan": {"grid": {"spacing_mm": 2.0, "margin_mm": 4.0}, "depths_mm": [0.1]},
        "mechanics": mechanics,
    }
    radius = rng.uniform(0.15, 0.3) * height
    place = Place(planned.x_mm, planned.y_mm, -rng.uniform(0.4, 0.7) * height, radius)
    try:
        study = study_from(content, "draw")
        for name, amount in amounts.items():
            study = CATALOGUE[name](study, amount, place)
        check_inside({planned.name: planned}, study)
    except ConfigError as error:
        return Draw(number, words, None, None, str(error))
    return Draw(number, words, study, planned)


def sensor_of(rng: np.random.Generator) -> dict:
    """Return the keys of a block of one to three layers with or without wall and flange, or of a dome."""
    dome = rng.random() < 0.04  # ten times the cost of a block
    count = 2 if dome else rng.choice([1, 2, 3], p=[0.2, 0.6, 0.2])
    thick = rng.uniform(2.5, 4.5)
    layers = [("gel", thick, "soft"), ("skin", rng.uniform(0.6, 1.5), "stiff")][:count]
    if count == 3:
        layers = [("under", rng.uniform(0.6, 1.5), "stiff"), *layers]
    width = rng.uniform(12, 18, 2)
    keys = {
        "width_x_mm": round(float(width[0]), 3),
        "width_y_mm": round(float(width[0] if dome or rng.random() < 0.5 else width[1]), 3),
        "layers": [
            {
                "name": name,
                "thickness_mm": round(float(t), 3),
                "material": material,
                "particle_volume_fraction": 0.02 if name == "gel" else 0.0,
            }
            for name, t, material in layers
        ],
        "wall_mm": 0.0 if dome or rng.random() < 0.25 else round(float(rng.uniform(0.8, 2.0)), 3),
        "bins": {"nx": 8, "ny": 8},
    }
    if dome:
        return keys | {"shape": {"kind": "dome"}}
    if keys["wall_mm"] and rng.random() < 0.2:
        keys["flange"] = {"width_mm": 2.0, "height_mm": round(float(0.3 * thick), 3)}
    return keys


def law_of(rng: np.random.Generator, mu: float) -> dict:
    """Return the keys of a law of shear modulus mu [kPa]: its parameters are drawn in the ranges of silicone gels."""
    kind = rng.choice(["neo_hooke", "mooney_rivlin", "yeoh", "gent", "ogden", "ogden", "ogden"])
    if kind == "neo_hooke":
        return {"law": "neo_hooke", "mu_kPa": mu}
    if kind == "mooney_rivlin":
        share = rng.uniform(0, 0.4)
        return {"law": "mooney_rivlin", "C10_kPa": (1 - share) * mu / 2, "C01_kPa": share * mu / 2}
    if kind == "yeoh":
        growth = rng.uniform(-0.03, 0.1)
        return {
            "law": "yeoh",
            "C10_kPa": mu / 2,
            "C20_kPa": growth * mu / 2,
            "C30_kPa": rng.uniform(0, 0.02) * mu,
        }
    if kind == "gent":
        return {"law": "gent", "mu_kPa": mu, "Jm": rng.uniform(3, 60)}
    terms = int(rng.integers(1, 4))
    share = rng.dirichlet(np.ones(terms))
    alpha = np.array([rng.uniform(1.2, 4), -rng.uniform(1, 5), rng.uniform(4, 8)])[:terms]
    return {"law": "ogden", "mu_kPa": [float(m) for m in 2 * mu * share / alpha], "alpha": alpha.tolist()}


def indenter_of(rng: np.random.Generator) -> dict:
    """Return the keys of a ball, a flat or rounded cylinder, a box, several shapes, or the wedge's surface."""
    kind = rng.choice(
        ["sphere", "flat", "rounded", "box", "several", "mesh"], p=[0.4, 0.12, 0.12, 0.14, 0.12, 0.1]
    )
    slight = [float(rng.uniform(-4, 4)), float(rng.uniform(-4, 4)), float(rng.uniform(-90, 90))]
    turned = {"orientation_deg": slight} if rng.random() < 0.5 else {}
    if kind == "sphere":
        return {"kind": "sphere", "radius_mm": float(rng.uniform(2.5, 6))}
    if kind in ("flat", "rounded"):
        radius = float(rng.uniform(1.5, 3))
        edge = float(rng.uniform(0.2, 0.5)) if kind == "flat" else radius * float(rng.uniform(0.5, 1))
        return {"kind": "cylinder", "radius_mm": radius, "length_mm": 8.0, "edge_radius_mm": edge} | turned
    if kind == "box":
        size = [*map(float, rng.uniform(2, 5, 2)), 8.0]
        return {"kind": "box", "size_mm": size, "edge_radius_mm": float(rng.uniform(0.2, 0.8))} | turned
    if kind == "mesh":
        return {"kind": "mesh", "file": str(WEDGE), "mm_per_unit": 0.6, "edge_radius_mm": 0.6}
    apart = float(rng.uniform(1.5, 3))
    second = {"kind": "cylinder", "radius_mm": 1.5, "length_mm": 8.0, "edge_radius_mm": 0.5}
    second = second if rng.random() < 0.5 else {"kind": "sphere", "radius_mm": float(rng.uniform(2, 4))}
    first = {"kind": "sphere", "radius_mm": float(rng.uniform(2, 4)), "offset_mm": [-apart, 0.0, 0.0]}
    return {
        "kind": "several",
        "parts": [first, second | {"offset_mm": [apart, 0.0, float(rng.uniform(0, 0.3))]}],
        "orientation_deg": [0.0, 0.0, slight[2]],
    }


def mechanics_of(rng: np.random.Generator, sensor: dict) -> dict:
    """Return the keys of a coarse model; one in six stores a derivative."""
    near = 1.0 if "shape" in sensor else NEAR_MM
    keys = {
        "friction": float(rng.choice([0.0, 0.2, 0.45, 0.9])),
        "bulk_to_shear": float(rng.choice([100.0, 1000.0, 10000.0])),
        "mesh": {"near_mm": near, "near_radius_mm": 1.5, "growth": 0.5, "far_mm": 3.0},
        "effects": {"material": {"circumstances": {"age_days": 10.0, "temperature_C": 33.0}}},
    }
    if rng.random() < 1 / 6:
        keys["sensitivities"] = [str(rng.choice(derivable_effects()))]
    return keys


def effects_of(rng: np.random.Generator, sensor: dict, indenter: dict) -> list[str]:
    """Return one or two effects of the catalogue; now and then one that this sensor or indenter does not have."""
    foreign = set() if sensor["wall_mm"] else {"wall_stiffness", "wall_gap"}
    if indenter["kind"] != "sphere":
        foreign.add("indenter_radius")
    if "shape" in sensor:
        foreign |= {
            "elastic_base",
            "layer_thickness",
            "thickness_gradient",
            "wall_gap",
            "delamination",
            "prestretch",
        }
        foreign |= {"toe_region", "particle_settling"}
    fitting = [name for name in CATALOGUE if name not in foreign]
    names = list(
        rng.choice(fitting if rng.random() < 0.95 else list(CATALOGUE), rng.integers(1, 3), replace=False)
    )
    return [str(name) for name in names]


def amount_of(rng: np.random.Generator, effect: Effect) -> float:
    """Return an amount of an effect within its plausible width, to either side where both have a meaning."""
    if effect.binary:
        return 1.0
    return float(effect.width * rng.uniform(0 if effect.name in ONE_SIDED else -1, 1))


def path_of(rng: np.random.Generator, sensor: dict, height: float) -> PlannedCell:
    """Return a press at a position up to EDGE_MM from the edge: depths, some with shear, tilt or unloading."""
    width = np.array([sensor["width_x_mm"], sensor["width_y_mm"]])
    place = rng.uniform(EDGE_MM, width - EDGE_MM)
    if rng.random() < 0.25:  # as near as it goes
        place[rng.integers(2)] = EDGE_MM
    if "shape" in sensor:  # a dome has nothing to press in the corners of its rectangle
        angle, out = rng.uniform(0, 2 * np.pi), rng.uniform(0, 0.6)
        place = width / 2 * (1 + out * np.array([np.cos(angle), np.sin(angle)]))
    deepest = rng.uniform(0.12, 0.35) * height
    depths = [float(d) for d in deepest * np.linspace(0, 1, int(rng.integers(2, 4)) + 1)[1:]]
    x, y = (round(float(v), 3) for v in place)
    kind = rng.choice(["load", "unload", "shear", "shear and unload", "tilt"], p=[0.4, 0.2, 0.15, 0.15, 0.1])
    shear = rng.uniform(-0.3, 0.3, 2).tolist() if "shear" in kind else None
    planned = press_path("random", x, y, depths, shear, "unload" in kind)
    if kind != "tilt":
        return planned
    tilts = [(0.0, 0.0)] * len(depths) + [tuple(k * t for t in rng.uniform(-3, 3, 2)) for k in (0.5, 1.0)]
    phases = ("load",) * len(depths) + ("tilt",) * 2
    path = (*depths, depths[-1], depths[-1])
    return PlannedCell("random", x, y, path, phases=phases, tilts_deg=tuple(tilts))


# ------------------------------------------------------------------------------------------ pressing
def outcome(draw: Draw) -> Outcome:
    """Return what becomes of a draw. An exception that is no refusal is an error of ours."""
    from gelforge.indentation.solving.companion import simulate_label

    if draw.study is None:
        return Outcome(draw, "refused", draw.refusal, (), np.nan, 0.0)
    clock = time.process_time()
    try:
        tested = dict.fromkeys(draw.study.materials, _beyond_tests)
        cell = simulate_label(draw.study, laws_of(draw.study, []), {}, draw.planned, tested)
    except ConfigError as error:
        return Outcome(draw, "refused", str(error), (), np.nan, time.process_time() - clock)
    except Exception as error:  # whatever it is, it is to be listed, and the other draws go on
        return Outcome(
            draw, "error", f"{type(error).__name__}: {error}", (), np.nan, time.process_time() - clock
        )
    a = cell.attributes
    balance = max([0.0, *a["force_balance"], *a["moment_balance"]])
    spent = time.process_time() - clock
    return Outcome(draw, a["status"], a["reason"], tuple(not_finite(cell)), balance, spent)


def _beyond_tests(stretches: np.ndarray) -> np.ndarray:
    """Return which elements (E,) leave the stretches (E, 3) of tests as they could be: without a range the share is NaN."""
    return (stretches < 0.6).any(axis=1) | (stretches > 2.0).any(axis=1)


def not_finite(cell: Cell) -> Iterator[str]:
    """Yield the names of arrays and attributes of a cell that hold anything not finite."""
    for name, values in (cell.arrays | cell.attributes).items():
        numbers = np.asarray(values)
        if numbers.dtype.kind == "f" and not np.isfinite(numbers).all():
            yield name


def kind_of(outcome: Outcome) -> str:
    """Return status and reason without their numbers, so that alike ones count together."""
    reason = re.sub(r"\[[^a-z]*\]|[-+]?\d[\d.e+-]*", "#", outcome.reason.partition(";")[0])
    return outcome.status + (f": {reason[:90]}" if reason else "")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="the number of the first draw")
    arguments = parser.parse_args()
    import pandas as pd

    outcomes = []
    for number in range(arguments.first, arguments.first + arguments.draws):
        outcomes.append(outcome(drawn(arguments.seed, number)))
        o = outcomes[-1]
        if o.status != "converged" or not o.is_sound:
            print(
                f"{number}: {o.draw.words}\n    {o.status}: {o.reason} {' '.join(o.not_finite)}", flush=True
            )
    counts = Counter(kind_of(o) for o in outcomes)
    print(pd.DataFrame(counts.most_common(), columns=["outcome", "draws"]).to_markdown(index=False), "\n")
    converged = [o for o in outcomes if o.status == "converged"]
    seconds = [o.seconds for o in outcomes]
    print(f"worst balance of forces and moments: {max((o.balance for o in converged), default=np.nan):.1e}")
    print(f"draws with anything not finite: {sum(bool(o.not_finite) for o in outcomes)}")
    print(f"draws not sound: {[o.draw.number for o in outcomes if not o.is_sound]}")
    print(
        f"CPU seconds: {sum(seconds):.0f} in all, {np.median(seconds):.1f} median, {max(seconds):.1f} longest"
    )


if __name__ == "__main__":
    main()
