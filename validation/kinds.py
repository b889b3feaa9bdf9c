"""The hidden effects, each in a form of its own that is not the analysis's; and some that no catalogue has.

A kind draws a direction and what stays fixed (a place, a time) and is put into a world by an amplitude: 1 is a plausible
value, `most` the largest that is drawn. `parameters` says what a verdict may be held to: the parameter in the catalogue's
unit, where both forms have the same parameter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from . import body_forms as body
from . import machine_forms as machine
from . import outside_forms as outside
from .solves import DEFECT_PLACES
from .world import World

Drawn = dict


@dataclass(frozen=True)
class Kind:
    """One kind of hidden physics."""

    form: str  # the name of this form
    name: str  # in the catalogue of names; "" where no catalogue has it
    family: str
    draw: Callable[[np.random.Generator], Drawn]
    put: Callable[[World, float, Drawn], None]
    parameters: Callable[[float, Drawn], dict[str, float]] = lambda size, drawn: {}
    most: float = 2.0
    zero_by: str | None = None  # what the recording must be for it to be seen
    tared: bool | None = None
    sessions: int = 1
    base: str = ""  # the only study that it is judged against, where it is one


def _sign(rng) -> Drawn:
    return {"sign": float(rng.choice([-1.0, 1.0]))}


def _positive(rng) -> Drawn:
    return {"sign": 1.0}


def _direction(rng) -> Drawn:
    angle = rng.uniform(0, 2 * np.pi)
    return {"x": float(np.cos(angle)), "y": float(np.sin(angle))}


def _one(parameter: str, width: float):
    return lambda size, drawn: {parameter: size * drawn["sign"] * width}


def _pair(width: float, names=("x", "y")):
    return lambda size, drawn: {names[0]: size * drawn["x"] * width, names[1]: size * drawn["y"] * width}


def _defect_place(rng) -> Drawn:
    return {"sign": 1.0, "place": str(rng.choice(list(DEFECT_PLACES))), "turns": int(rng.integers(4))}


def _phase(rng) -> Drawn:
    return {"phase": float(rng.uniform(0, 2 * np.pi))}


def _both_axes(rng) -> Drawn:
    return {"x": float(rng.uniform(0.2, 1.0)), "y": float(rng.uniform(0.2, 1.0))}


def _three(names, rng) -> Drawn:
    v = rng.normal(size=3)
    return dict(zip(names, (v / np.linalg.norm(v)).tolist()))


def _gains(rng) -> Drawn:
    return {
        "gx": float(rng.uniform(-1, 1)),
        "gy": float(rng.uniform(-1, 1)),
        "gz": float(rng.choice([-1.0, 1.0])),
    }


KINDS: dict[str, Kind] = {
    kind.form: kind
    for kind in [
        Kind("gel moduli", "gel_stiffness", "material", _sign, body.gel, _one("growth", 0.2)),
        Kind("skin moduli", "skin_stiffness", "material", _sign, body.skin, _one("growth", 0.2)),
        Kind("yeoh stiffening", "law_exponent", "material", _positive, body.solved("stiffening", lambda s, d: s)),
        Kind("third-order stiffening", "law_exponent", "material", _positive,
             body.solved("late stiffening", lambda s, d: s), most=3.0),
        # no values: a share of what a slab of 1 MPa changes is not what a slab does of which the 1/E is that share of
        # 1/MPa, and as little is a share of what a bulk modulus changes
        Kind("softer volume", "compressibility", "material", _positive, body.solved("compressible", lambda s, d: s)),
        Kind("slab", "elastic_base", "material", _positive, body.solved("slab", lambda s, d: s), most=1.5),
        Kind("power law", "viscoelastic", "history",
             lambda rng: {"sign": 1.0, "t0": float(10 ** rng.uniform(-1, 0.5)), "n": float(rng.uniform(0.3, 0.9))},
             body.power_law),
        Kind("stretched exponential", "viscoelastic", "history",
             lambda rng: {"sign": 1.0, "t0": float(10 ** rng.uniform(-0.5, 0.7)), "n": float(rng.uniform(0.4, 0.8))},
             body.stretched_exponential),
        Kind("scalar damage", "mullins", "history",
             lambda rng: {"sign": 1.0, "w0": float(rng.uniform(0.8, 1.6)), "spread": float(rng.uniform(1.5, 3.0))},
             body.damage),
        Kind("broken chains", "mullins", "history",
             lambda rng: {"sign": 1.0, "most": float(rng.uniform(0.4, 0.9)), "spread": float(rng.uniform(1.0, 2.5))},
             body.broken_chains),
        Kind("drying", "ageing", "history", _sign, body.drying, sessions=2),
        Kind("activated", "temperature", "history", _sign, body.activated, sessions=2),
        Kind("slow curing", "ageing", "history", _sign, body.ageing, sessions=2),
        Kind("absolute temperature", "temperature", "history", _sign, body.temperature,
             _one("rate", body.TEMPERATURE_POWER / body.ROOM_K), sessions=2),
        Kind("coulomb penalty", "frictionless", "contact", _positive, body.solved("friction", lambda s, d: s), most=1.0),
        Kind("jkr", "adhesion", "contact", _positive, body.adhesion, most=4.0),
        Kind("giving film", "toe_region", "contact",
             lambda rng: {"sign": 1.0, "give_N": float(rng.uniform(0.02, 0.08))}, body.toe),
        Kind("thicker mesh", "layer_thickness", "geometry", _sign, body.thickness, _one("change", 0.5), most=1.2),
        Kind("wedge", "thickness_gradient", "geometry", _direction, machine.wedge, _pair(0.02), zero_by="session"),
        Kind("other wall", "wall_stiffness", "geometry", _sign,
             body.solved("stiffer wall", lambda s, d: np.log1p(0.5 * s * d["sign"]) / np.log(1.6)),
             _one("growth", 0.5), most=1.4),
        Kind("weak strip", "wall_gap", "geometry", _positive, body.solved("wall gap", lambda s, d: s), most=1.0),
        Kind("film without shear", "delamination", "geometry", _defect_place, body.defect("delamination"), most=1.0),
        Kind("empty ball", "void", "geometry", _defect_place, body.defect("void"), most=1.0),
        Kind("hard ball", "inclusion", "geometry", _defect_place, body.defect("inclusion"), most=1.0),
        Kind("another ball", "indenter_radius", "geometry", _sign, body.other_ball, _one("change", 0.25)),
        Kind("zero error", "contact_zero", "kinematics", _sign, machine.zero, _one("deeper", 0.1), zero_by="press"),
        Kind("turned body", "tilt", "kinematics", _direction, machine.tilt, _pair(1.0, ("about_x", "about_y")),
             zero_by="session"),
        Kind("pressed elsewhere", "misregistration", "kinematics", _direction, machine.shift, _pair(0.5)),
        Kind("turned grid", "yaw", "kinematics", _sign, machine.yaw, _one("turn", 2.0)),
        Kind("stretched grid", "grid_scale", "kinematics", _sign, machine.grid, _one("growth", 0.01)),
        Kind("backlash", "lateral_play", "kinematics", _both_axes, machine.backlash, _pair(0.4), most=1.5),
        Kind("series spring", "frame_compliance", "kinematics", _positive, machine.frame, _one("compliance", 0.05)),
        Kind("clamped plate", "base_bending", "kinematics", _positive, machine.plate),
        Kind("late stamp", "clock_offset", "kinematics", _sign, machine.late, _one("lag", 0.05)),
        Kind("amplifier gains", "force_gain", "force sensor", _gains, machine.gain,
             lambda s, d: {k[1]: 0.05 * s * d[k] for k in ("gx", "gy", "gz")}),
        Kind("zero left", "force_offset", "force sensor", partial(_three, ("ox", "oy", "oz")), machine.offset,
             lambda s, d: {k[1]: 0.02 * s * d[k] for k in ("ox", "oy", "oz")}, tared=True),
        Kind("warming up", "force_drift", "force sensor",
             lambda rng: {**_three(("ox", "oy", "oz"), rng), "warm_s": float(rng.uniform(150, 500))}, machine.drift,
             tared=True),
        Kind("slowing creep of the zero", "force_drift", "force sensor",
             partial(_three, ("ox", "oy", "oz")), machine.slowing_drift, tared=True),
        Kind("turned sensor", "cross_talk", "force sensor", partial(_three, ("a", "b", "c")), machine.cross),
        Kind("play", "force_hysteresis", "force sensor", _positive, machine.play),
        Kind("fitted laws", "linear_elasticity", "simplification", _positive,
             body.solved("neo-Hooke", lambda s, d: -s), most=1.0,
             base="neo_hooke"),
        Kind("smooth ball", "frictionless", "simplification", _positive, body.solved("friction", lambda s, d: -s), most=1.0,
             base="rough"),
        Kind("no friction", "frictionless", "simplification", _positive, body.solved("smooth", lambda s, d: s), most=1.0,
             base="wide"),
    ]
}  # fmt: skip

OUTSIDE: dict[str, Kind] = {
    kind.form: kind
    for kind in [
        Kind("lead screw", "", "outside", _phase, outside.screw),
        Kind("alternating amplifiers", "", "outside", _positive, outside.alternate),
        Kind("knit lines", "", "outside", lambda rng: {**_phase(rng), **_direction(rng)}, outside.stripes),
        Kind("air conditioning", "", "outside",
             lambda rng: {**_phase(rng), "period_s": float(rng.uniform(60, 200))}, outside.cycle),
        Kind("shaft meets clamp", "", "outside", lambda rng: {"x": float(rng.choice([-1, 1])), "y": 0.0}, outside.shaft),
        Kind("unrecovered surface", "", "outside", _positive, outside.unrecovered),
        Kind("one depth's programme", "", "outside", lambda rng: {"depth": int(rng.choice([1, 2]))}, outside.chatter),
    ]
}  # fmt: skip
