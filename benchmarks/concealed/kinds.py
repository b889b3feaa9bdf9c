"""The hidden effects, each in a form of its own that is not the analysis's; and some that no catalogue has.

A kind draws a direction and what stays fixed (a place, a time) and is put into a world by an amplitude: 1 is a plausible
amount, `most` the largest that is drawn. `amounts` says what a verdict may be held to: the parameter in the catalogue's
unit, where both forms have the same parameter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg import expm

from .presses import commanded_depth
from .solves import DEFECT_PLACES
from .world import LENGTH, World

Drawn = dict


@dataclass(frozen=True)
class Kind:
    """One kind of hidden physics."""

    form: str  # the name of this form
    name: str  # in the catalogue of names; "" where no catalogue has it
    family: str
    draw: Callable[[np.random.Generator], Drawn]
    put: Callable[[World, float, Drawn], None]
    amounts: Callable[[float, Drawn], dict[str, float]] = lambda size, drawn: {}
    most: float = 2.0
    zero_by: str | None = None  # what the recording must be for it to be seen
    tared: bool | None = None
    sessions: int = 1
    base: str = "concealed"  # the study that it is judged against


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


# --- the body: ratios of forces that FElupe found -----------------------------------------------------------------------


def gel_change(world: World, factor: float):
    """Return log ratio and horizontal change for gel moduli times a factor: quadratic in its logarithm."""
    up, down = world.library.changes["gel stiffer"], world.library.changes["gel softer"]
    return _through(up, np.log(1.25), down, np.log(0.8), np.log(factor))


def _through(one, at_one, other, at_other, at):
    """Return the change at `at` on the parabola through 0 and two solved amounts."""
    a = at * (at - at_other) / (at_one * (at_one - at_other))
    b = at * (at - at_one) / (at_other * (at_other - at_one))

    def change(xy, depth):
        (r1, h1), (r2, h2) = one.at(xy, depth), other.at(xy, depth)
        return a * r1 + b * r2, a * h1 + b * h2

    return change


def _scaled(change, share):
    def scaled(xy, depth):
        ratio, flat = change.at(xy, depth)
        return share * ratio, share * flat

    return scaled


def _gel(world, size, drawn):
    world.changes.append(gel_change(world, 1 + 0.2 * size * drawn["sign"]))


def _skin(world, size, drawn):
    factor = (
        1 + 0.2 * size * drawn["sign"]
    )  # F(gel, skin) = s F(gel / s, 1): forces are of first degree in all moduli
    relative = gel_change(world, 1 / factor)

    def change(xy, depth):
        ratio, flat = relative(xy, depth)
        return ratio + np.log(factor), flat

    world.changes.append(change)


def _thickness(world, size, drawn):
    library, t = world.library, 4.0 + 0.5 * size * drawn["sign"]
    world.changes.append(
        _through(
            library.changes["thicker"], np.log(1.1), library.changes["thinner"], np.log(0.9), np.log(t / 4)
        )
    )


def _solved(name: str, share: Callable[[float, Drawn], float]):
    """Return the function that puts a solved change into a world, scaled by a share of what was solved."""

    def put(world, size, drawn):
        world.changes.append(_scaled(world.library.changes[name], share(size, drawn)))

    return put


def _defect(name: str):
    def put(world, size, drawn):
        change = world.library.defects[name, drawn["place"]]

        def local(xy, depth):
            ratio, flat = change.at(xy, depth, drawn["turns"])
            return size * ratio, size * flat

        world.changes.append(local)

    return put


def _defect_place(rng) -> Drawn:
    return {"sign": 1.0, "place": str(rng.choice(list(DEFECT_PLACES))), "turns": int(rng.integers(4))}


# --- history: forms without Prony's series or Ogden and Roxburgh's function -----------------------------------------------


def _power_law(world, size, drawn):
    """Relaxation by a power of time: the gel's share of every increment decays as (1 + t / t0)^-n above the law at rest."""

    def remember(world, rows, xy, depth, force):
        share = _gel_share(world, xy, np.maximum(depth, 0.05))
        at, deepest = rows["at_s"].to_numpy(), rows["deepest_mm"].to_numpy()
        offset = depth - rows["depth_mm"].to_numpy()
        u = (np.arange(60) + 0.5) / 60
        times = u[None] * at[:, None]
        d0 = commanded_depth(at[:, None] * np.arange(61) / 60, deepest[:, None])
        d0 = np.where(d0 > 0, d0 + offset[:, None], 0.0)
        flat = np.repeat(xy, d0.shape[1], axis=0)
        z = world.elastic(flat, d0.ravel())[:, 2].reshape(d0.shape)
        decay = (1 + (at[:, None] - times) / drawn["t0"]) ** -drawn["n"]
        extra = (decay * np.diff(z, axis=1)).sum(axis=1)
        safe = np.where(force[:, 2] == 0, 1.0, force[:, 2])
        grown = 1 + 0.2 * size * share * extra / safe
        return force * np.where(force[:, 2] == 0, 1.0, grown)[:, None]

    world.history.append(remember)


def _gel_share(world, xy, depth) -> np.ndarray:
    """Return d log Fz / d log(gel moduli) (R,)."""
    return gel_change(world, 1.02)(xy, depth)[0] / np.log(1.02)


def _damage(world, size, drawn):
    """Scalar damage: stress times 1 - D(most energy so far), virgin presses as the law says; the energy spreads sideways."""

    def remember(world, rows, xy, depth, force):
        share = _gel_share(world, xy, np.maximum(depth, 0.05))
        D = lambda w: 0.3 * size * (1 - np.exp(-((np.maximum(w, 0) / drawn["w0"]) ** 2)))  # noqa: E731
        past = np.zeros(len(rows))
        order = (rows["session"] * 100000 + rows["order"]).to_numpy()
        starts = np.flatnonzero(np.diff(order, prepend=-1))
        deepest = np.maximum.reduceat(depth, starts)
        for k, start in enumerate(starts):
            end = starts[k + 1] if k + 1 < len(starts) else len(rows)
            most = 0.0
            if k:
                away = np.linalg.norm(xy[starts[:k]] - xy[start], axis=1)
                most = float((deepest[:k] * np.exp(-((away / drawn["spread"]) ** 2))).max())
            past[start:end] = np.maximum(most, np.maximum.accumulate(depth[start:end]))
        lost = (1 - D(past)) / (1 - D(np.maximum(depth, 0)))
        return force * (1 + share * (lost - 1))[:, None]

    world.history.append(remember)


def _ageing(world, size, drawn):
    """The gel stiffens with the logarithm of its age from the first session on, as slow curing does."""
    _circumstance(world, lambda rows: drawn["sign"] * 0.08 * size * np.log(rows["age"] / rows["age"].iloc[0]))


def _temperature(world, size, drawn):
    """The gel's modulus follows the absolute temperature to a power."""
    _circumstance(
        world,
        lambda rows: drawn["sign"] * 6.0 * size * np.log((rows["temperature"] + 273.15) / (23.0 + 273.15)),
    )


def _circumstance(world, log_growth):
    def remember(world, rows, xy, depth, force):
        share = _gel_share(world, xy, np.maximum(depth, 0.05))
        return force * np.exp(share * log_growth(rows).to_numpy())[:, None]

    world.history.append(remember)


# --- contact ------------------------------------------------------------------------------------------------------------


def _adhesion(world, size, drawn):
    """Johnson, Kendall and Roberts with the solved stiffness S and contact radius a; work of separation on the way up."""

    def remember(world, rows, xy, depth, force):
        up = (rows["phase"] == "unload").to_numpy() & (depth > 0)
        w = 1e-4 * size
        d = np.maximum(depth, 0.05)
        S = (world.elastic(xy, d + 0.02)[:, 2] - world.elastic(xy, d - 0.02)[:, 2]) / -0.04
        # a from the contact area at the middle; S grows with a as with depth
        powers = np.vander(d, len(world.library.area), increasing=True)
        a = np.sqrt(np.maximum(powers @ world.library.area, 1e-6) * d / np.pi)
        S2 = (world.elastic(xy, d + 0.04)[:, 2] - world.elastic(xy, d)[:, 2]) / -0.04
        powers = np.vander(d + 0.02, len(world.library.area), increasing=True)
        a2 = np.sqrt(np.maximum(powers @ world.library.area, 1e-6) * (d + 0.02) / np.pi)
        slope = np.maximum((S2 - S) / np.maximum(a2 - a, 1e-6), 1e-4)
        pull = S * np.sqrt(4 * np.pi * a * w / slope)
        return force + np.where(up, pull, 0.0)[:, None] * np.array([0.0, 0.0, 1.0])

    world.history.append(remember)


def _toe(world, size, drawn):
    """A film that gives way exponentially: its thickness h is used up over a force."""
    h, give = 0.04 * size, drawn["give_N"]
    world.yielding.append(lambda xy, z: h * (1 - np.exp(np.minimum(z, 0.0) / give)))


# --- kinematics -----------------------------------------------------------------------------------------------------------


def _zero(world, size, drawn):
    world.depths.append(lambda rows, xy: 0.1 * size * drawn["sign"] * np.ones(len(rows)))


def _tilt(world, size, drawn):
    """The sensor's body is turned; the ball comes down along the machine's axis and meets it elsewhere and at another depth.

    Forces are read in the tilted sensor's axes. Turns about x and y [deg]: drawn x, y.
    """
    angle = np.deg2rad(size) * np.array([drawn["x"], drawn["y"]])
    turn = expm(
        np.array([[0, 0, angle[1]], [0, 0, -angle[0]], [-angle[1], angle[0], 0]])
    )  # sensor to machine
    ball = 5.0  # its radius [mm]

    def centre(rows, xy):
        """Return the ball's centre (R, 3) in the sensor's axes; depth 0 is where it touches the middle."""
        down = np.maximum(rows["depth_mm"].to_numpy(), 0.0)
        return np.column_stack([xy, ball / turn[2, 2] - down]) @ turn

    world.places.append(lambda rows, xy: centre(rows, xy)[:, :2] - ball * turn[2, :2] / turn[2, 2])
    sent = lambda rows: rows[["x_mm", "y_mm"]].to_numpy()  # noqa: E731
    world.depths.append(
        lambda rows, xy: ball - centre(rows, sent(rows))[:, 2] - np.maximum(rows["depth_mm"], 0.0)
    )


def _wedge(world, size, drawn):
    """The gel grows thicker across the sensor: each place presses its own thickness, and its sloping top is nearer.

    To first order in the slope: the solved changes of an even layer, at the local thickness.
    """
    slope = 0.02 * size * np.array([drawn["x"], drawn["y"]])
    library = world.library

    def change(xy, depth):
        at = np.log1p(xy @ slope / 4.0)
        (r1, h1), (r2, h2) = (library.changes[n].at(xy, depth) for n in ("thicker", "thinner"))
        one, other = np.log(1.1), np.log(0.9)
        a = at * (at - other) / (one * (one - other))
        b = at * (at - one) / (other * (other - one))
        return a * r1 + b * r2, (
            a[:, None] * h1 + b[:, None] * h2
        ) - slope  # a frictionless ball pushes along the normal

    world.changes.append(change)
    world.depths.append(lambda rows, xy: xy @ slope)


def _shift(world, size, drawn):
    world.places.append(lambda rows, xy: xy + 0.5 * size * np.array([drawn["x"], drawn["y"]]))


def _yaw(world, size, drawn):
    c, s = np.cos(np.deg2rad(2 * size * drawn["sign"])), np.sin(np.deg2rad(2 * size * drawn["sign"]))
    world.places.append(lambda rows, xy: xy @ np.array([[c, s], [-s, c]]))


def _grid(world, size, drawn):
    world.places.append(lambda rows, xy: xy * (1 + 0.01 * size * drawn["sign"]))


def _frame(world, size, drawn):
    world.yielding.append(lambda xy, z: -0.05 * size * z)


def _plate(world, size, drawn):
    """The base plate sags by the static shape of a clamped square, not by its first mode of sines."""
    shape = lambda xy: ((1 - (xy / LENGTH) ** 2) ** 2).prod(axis=1)  # noqa: E731
    world.yielding.append(lambda xy, z: -0.05 * size * shape(xy) ** 2 * z)


def _late(world, size, drawn):
    """Force is stamped late: the stage is read where it was before."""

    def read(rows):
        at = rows["at_s"].to_numpy()
        depth = commanded_depth(at - 0.05 * size * drawn["sign"], rows["deepest_mm"].to_numpy())
        return np.where(rows["phase"] == "zero", rows["depth_mm"], np.maximum(depth, 1e-6))

    world.clock.append(read)


# --- force sensor ---------------------------------------------------------------------------------------------------------


def _gain(world, size, drawn):
    gain = 1 + 0.05 * size * np.array([drawn["gx"], drawn["gy"], drawn["gz"]])
    world.sensor.append(lambda rows, force: force * gain)


def _offset(world, size, drawn):
    world.sensor.append(
        lambda rows, force: force + 0.02 * size * np.array([drawn["ox"], drawn["oy"], drawn["oz"]])
    )


def _drift(world, size, drawn):
    """The amplifier warms up: the zero goes to its new value exponentially."""
    by = 0.05 * size * np.array([drawn["ox"], drawn["oy"], drawn["oz"]])
    world.sensor.append(
        lambda rows, force: force + by * (1 - np.exp(-rows["time_s"].to_numpy() / drawn["warm_s"]))[:, None]
    )


def _cross(world, size, drawn):
    """The sensor sits turned on its plate: a rotation by angles, not small terms."""
    a = 0.03 * size * np.array([drawn["a"], drawn["b"], drawn["c"]])
    turn = expm(np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]]))
    world.sensor.append(lambda rows, force: force @ turn.T)


def _play(world, size, drawn):
    """Play: readings follow the force only outside a band about the last, a share of the largest force of the press."""

    def read(rows, force):
        shown, z = force.copy(), force[:, 2]
        press = rows.groupby(["session", "order"], sort=False).ngroup().to_numpy()
        largest = np.zeros(press.max() + 1)
        np.maximum.at(largest, press, np.abs(z))
        half = 0.02 * size * largest[press]
        for k in range(len(z)):
            last = 0.0 if k == 0 or press[k] != press[k - 1] else shown[k - 1, 2]
            shown[k, 2] = np.clip(last, z[k] - half[k], z[k] + half[k])
        return shown

    world.sensor.append(read)


# --- outside every catalogue ---------------------------------------------------------------------------------------------


def _screw(world, size, drawn):
    """The stage's lead screw: a depth error that repeats with its pitch."""
    wave = lambda z: np.sin(2 * np.pi * z / 0.7 + drawn["phase"])  # noqa: E731
    world.depths.append(lambda rows, xy: 0.05 * size * wave(rows["depth_mm"].to_numpy()))


def _alternate(world, size, drawn):
    """Two amplifiers take turns, press by press, with gains apart."""
    world.sensor.append(
        lambda rows, force: force * (1 + 0.04 * size * np.where(rows["order"] % 2, 1.0, -1.0))[:, None]
    )


def _backlash(world, size, drawn):
    """Lateral play of the stage: where a press lands depends on the side from which it came."""

    def move(rows, xy):
        press = rows.groupby(["session", "order"], sort=False).ngroup().to_numpy()
        at = np.array([xy[press == p][0] for p in range(press.max() + 1)])
        side = np.sign(np.diff(at, axis=0, prepend=at[:1]))
        for p in range(1, len(side)):
            side[p] = np.where(side[p] == 0, side[p - 1], side[p])
        return xy - 0.4 * size * side[press]

    world.places.append(move)


def _stripes(world, size, drawn):
    """Knit lines of the mould: stiffness waves across the sensor."""

    def wave(xy):
        return np.cos(2 * np.pi * (xy[:, 0] * drawn["x"] + xy[:, 1] * drawn["y"]) / 8.0 + drawn["phase"])

    world.changes.append(lambda xy, depth: (0.05 * size * wave(xy), np.zeros((len(xy), 2))))


def _cycle(world, size, drawn):
    """The room's air conditioning: the load cell's gain swings with its period."""
    world.sensor.append(
        lambda rows, force: (
            force
            * (
                1
                + 0.04
                * size
                * np.sin(2 * np.pi * rows["time_s"].to_numpy() / drawn["period_s"] + drawn["phase"])
            )[:, None]
        )
    )


def _shaft(world, size, drawn):
    """The indenter's shaft meets a clamp beside the sensor: on one side, beyond a depth, a stop pushes back."""

    def remember(world, rows, xy, depth, force):
        side = xy @ np.array([drawn["x"], drawn["y"]]) > 5.0
        push = 0.4 * size * np.maximum(depth - 1.0, 0.0) * side
        return force - push[:, None] * np.array([0.3 * drawn["x"], 0.3 * drawn["y"], 1.0])

    world.history.append(remember)


def _unrecovered(world, size, drawn):
    """The surface comes back slowly: a place pressed a short while ago is still lower, and is met later."""

    def deeper(rows, xy):
        press = rows.groupby(["session", "order"], sort=False).ngroup().to_numpy()
        first = rows.groupby(press).first()
        time = first["session"].to_numpy() * 1e6 + first["time_s"].to_numpy()
        at, deepest = first[["x_mm", "y_mm"]].to_numpy(), first["deepest_mm"].to_numpy()
        left = np.zeros(len(first))
        for p in range(1, len(first)):
            away = np.linalg.norm(at[:p] - at[p], axis=1)
            left[p] = (
                deepest[:p] * np.exp(-((away / 4.0) ** 2)) * np.exp(-(time[p] - time[:p]) / 60.0)
            ).sum()
        return -0.05 * size * left[press]

    world.depths.append(deeper)


def _chatter(world, size, drawn):
    """Presses of one depth were driven by another programme that overshoots and comes back: only these are off."""
    world.depths.append(
        lambda rows, xy: 0.06 * size * np.isclose(rows["deepest_mm"], drawn["depth"]).astype(float)
    )


def _phase(rng) -> Drawn:
    return {"phase": float(rng.uniform(0, 2 * np.pi))}


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
        Kind("gel moduli", "gel_stiffness", "material", _sign, _gel, _one("growth", 0.2)),
        Kind("skin moduli", "skin_stiffness", "material", _sign, _skin, _one("growth", 0.2)),
        Kind("yeoh stiffening", "law_exponent", "material", _positive, _solved("stiffening", lambda s, d: s)),
        Kind("softer volume", "compressibility", "material", _positive, _solved("compressible", lambda s, d: s),
             lambda s, d: {"excess": s * (1 / 40 - 1 / 1000)}),
        # no amount: a share of what a slab of 1 MPa changes is not what a slab does of which the 1/E is that share of 1/MPa
        Kind("slab", "elastic_base", "material", _positive, _solved("slab", lambda s, d: s), most=1.5),
        Kind("power law", "viscoelastic", "history",
             lambda rng: {"sign": 1.0, "t0": float(10 ** rng.uniform(-1, 0.5)), "n": float(rng.uniform(0.3, 0.9))},
             _power_law),
        Kind("scalar damage", "mullins", "history",
             lambda rng: {"sign": 1.0, "w0": float(rng.uniform(0.8, 1.6)), "spread": float(rng.uniform(1.5, 3.0))}, _damage),
        Kind("slow curing", "ageing", "history", _sign, _ageing, sessions=2),
        Kind("absolute temperature", "temperature", "history", _sign, _temperature, sessions=2),
        Kind("coulomb penalty", "frictionless", "contact", _positive, _solved("friction", lambda s, d: s), most=1.0),
        Kind("jkr", "adhesion", "contact", _positive, _adhesion, most=4.0),
        Kind("giving film", "toe_region", "contact",
             lambda rng: {"sign": 1.0, "give_N": float(rng.uniform(0.02, 0.08))}, _toe),
        Kind("thicker mesh", "layer_thickness", "geometry", _sign, _thickness, _one("change", 0.5), most=1.2),
        Kind("wedge", "thickness_gradient", "geometry", _direction, _wedge, _pair(0.02), zero_by="session"),
        Kind("other wall", "wall_stiffness", "geometry", _sign,
             _solved("stiffer wall", lambda s, d: np.log1p(0.5 * s * d["sign"]) / np.log(1.6)),
             _one("growth", 0.5), most=1.4),
        Kind("weak strip", "wall_gap", "geometry", _positive, _solved("wall gap", lambda s, d: s), most=1.0),
        Kind("film without shear", "delamination", "geometry", _defect_place, _defect("delamination"), most=1.0),
        Kind("empty ball", "void", "geometry", _defect_place, _defect("void"), most=1.0),
        Kind("hard ball", "inclusion", "geometry", _defect_place, _defect("inclusion"), most=1.0),
        Kind("another ball", "indenter_radius", "geometry", _sign,
             _solved("larger ball", lambda s, d: np.log1p(0.05 * s * d["sign"]) / np.log(1.05)), _one("change", 0.25)),
        Kind("zero error", "contact_zero", "kinematics", _sign, _zero, _one("deeper", 0.1), zero_by="press"),
        Kind("turned body", "tilt", "kinematics", _direction, _tilt, _pair(1.0, ("about_x", "about_y")), zero_by="session"),
        Kind("pressed elsewhere", "misregistration", "kinematics", _direction, _shift, _pair(0.5)),
        Kind("turned grid", "yaw", "kinematics", _sign, _yaw, _one("turn", 2.0)),
        Kind("stretched grid", "grid_scale", "kinematics", _sign, _grid, _one("growth", 0.01)),
        Kind("series spring", "frame_compliance", "kinematics", _positive, _frame, _one("compliance", 0.05)),
        Kind("clamped plate", "base_bending", "kinematics", _positive, _plate),
        Kind("late stamp", "clock_offset", "kinematics", _sign, _late, _one("lag", 0.05)),
        Kind("amplifier gains", "force_gain", "force sensor", _gains, _gain,
             lambda s, d: {k[1]: 0.05 * s * d[k] for k in ("gx", "gy", "gz")}),
        Kind("zero left", "force_offset", "force sensor", partial(_three, ("ox", "oy", "oz")), _offset,
             lambda s, d: {k[1]: 0.02 * s * d[k] for k in ("ox", "oy", "oz")}, tared=True),
        Kind("warming up", "force_drift", "force sensor",
             lambda rng: {**_three(("ox", "oy", "oz"), rng), "warm_s": float(rng.uniform(150, 500))}, _drift, tared=True),
        Kind("turned sensor", "cross_talk", "force sensor", partial(_three, ("a", "b", "c")), _cross),
        Kind("play", "force_hysteresis", "force sensor", _positive, _play),
        Kind("fitted laws", "linear_elasticity", "simplification", _positive,
             _solved("neo-Hooke", lambda s, d: -s), most=1.0,
             base="neo_hooke"),
        Kind("smooth ball", "frictionless", "simplification", _positive, _solved("friction", lambda s, d: -s), most=1.0,
             base="rough"),
    ]
}  # fmt: skip

OUTSIDE: dict[str, Kind] = {
    kind.form: kind
    for kind in [
        Kind("lead screw", "", "outside", _phase, _screw),
        Kind("alternating amplifiers", "", "outside", _positive, _alternate),
        Kind("lateral backlash", "", "outside", _positive, _backlash),
        Kind("knit lines", "", "outside", lambda rng: {**_phase(rng), **_direction(rng)}, _stripes),
        Kind("air conditioning", "", "outside",
             lambda rng: {**_phase(rng), "period_s": float(rng.uniform(60, 200))}, _cycle),
        Kind("shaft meets clamp", "", "outside", lambda rng: {"x": float(rng.choice([-1, 1])), "y": 0.0}, _shaft),
        Kind("unrecovered surface", "", "outside", _positive, _unrecovered),
        Kind("one depth's programme", "", "outside", lambda rng: {"depth": float(rng.choice([0.8, 1.2]))}, _chatter),
    ]
}  # fmt: skip
