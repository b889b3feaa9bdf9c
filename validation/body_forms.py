"""Hidden effects of the body, in time too, and of the contact: shares of what FElupe found, each in a form of its own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .world import World

TEMPERATURE_POWER, ROOM_K = 3.0, 296.15
MODULI = 0.2  # by how much the moduli of a layer grow at an amplitude of 1
SMALL_DEEPEST = 1.6  # mm; of the presses for which the damage's depths were chosen

# --- the body: ratios of forces that FElupe found -----------------------------------------------------------------------


def gel_change(world: World, factor: float):
    """Return log ratio and horizontal change for gel moduli times a factor: quadratic in its logarithm."""
    up, down = world.library.changes["gel stiffer"], world.library.changes["gel softer"]
    return _through(up, np.log(1.25), down, np.log(0.8), np.log(factor))


def _through(one, at_one, other, at_other, at):
    """Return the change at `at` on the parabola through 0 and two solved values."""
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


def gel(world, size, drawn):
    world.changes.append(gel_change(world, 1 + MODULI * size * drawn["sign"]))


def skin(world, size, drawn):
    factor = (
        1 + MODULI * size * drawn["sign"]
    )  # F(gel, skin) = s F(gel / s, 1): forces are of first degree in all moduli
    relative = gel_change(world, 1 / factor)

    def change(xy, depth):
        ratio, flat = relative(xy, depth)
        return ratio + np.log(factor), flat

    world.changes.append(change)


def thickness(world, size, drawn):
    library, plain = world.library, world.library.sensor.plain.gel_mm
    t = plain + 0.5 * size * drawn["sign"]
    world.changes.append(
        _through(
            library.changes["thicker"],
            np.log(1.1),
            library.changes["thinner"],
            np.log(0.9),
            np.log(t / plain),
        )
    )


def other_ball(world, size, drawn):
    change = 0.25 * size * drawn["sign"]  # mm
    share = np.log1p(change / world.library.sensor.plain.radius_mm) / np.log(1.05)
    world.changes.append(_scaled(world.library.changes["larger ball"], share))


def solved(name: str, share: Callable[[float, dict], float]):
    """Return the function that puts a solved change into a world, scaled by a share of what was solved."""

    def put(world, size, drawn):
        world.changes.append(_scaled(world.library.changes[name], share(size, drawn)))

    return put


def defect(name: str):
    def put(world, size, drawn):
        change = world.library.defects[name, drawn["place"]]

        def local(xy, depth):
            ratio, flat = change.at(xy, depth, drawn["turns"])
            return size * ratio, size * flat

        world.changes.append(local)

    return put


# --- history: forms without Prony's series or Ogden and Roxburgh's function -----------------------------------------------


def power_law(world, size, drawn):
    """Relaxation by a power of time: the gel's share of every increment decays as (1 + t / t0)^-n above the law at rest."""
    _relaxing(world, 0.2 * size, lambda t: (1 + t / drawn["t0"]) ** -drawn["n"])


def stretched_exponential(world, size, drawn):
    """Relaxation by exp(-(t / t0)^n) (Kohlrausch 1854): many processes that end, where a power of time never does."""
    _relaxing(world, 0.2 * size, lambda t: np.exp(-((t / drawn["t0"]) ** drawn["n"])))


def _relaxing(world, strength: float, decay: Callable[[np.ndarray], np.ndarray]):
    """Put a gel into a world of whose increments of force a part, `strength`, decays with the time since."""

    def remember(world, rows, xy, depth, force):
        share = _gel_share(world, xy, np.maximum(depth, 0.05))
        at, deepest = rows["at_s"].to_numpy(), rows["deepest_mm"].to_numpy()
        offset = depth - rows["depth_mm"].to_numpy()
        u = (np.arange(60) + 0.5) / 60
        times = u[None] * at[:, None]
        d0 = world.plan.commanded_depth(at[:, None] * np.arange(61) / 60, deepest[:, None])
        d0 = np.where(d0 > 0, d0 + offset[:, None], 0.0)
        flat = np.repeat(xy, d0.shape[1], axis=0)
        z = world.elastic(flat, d0.ravel())[:, 2].reshape(d0.shape)
        extra = (decay(at[:, None] - times) * np.diff(z, axis=1)).sum(axis=1)
        safe = np.where(force[:, 2] == 0, 1.0, force[:, 2])
        grown = 1 + strength * share * extra / safe
        return force * np.where(force[:, 2] == 0, 1.0, grown)[:, None]

    world.history.append(remember)


def _gel_share(world, xy, depth) -> np.ndarray:
    """Return d log Fz / d log(gel moduli) (R,)."""
    return gel_change(world, 1.02)(xy, depth)[0] / np.log(1.02)


def damage(world, size, drawn):
    """Scalar damage: stress times 1 - D(most depth so far), virgin presses as the law says; the damage spreads sideways."""
    w0 = drawn["w0"] * world.plan.depths[-1] / SMALL_DEEPEST
    _softening(world, drawn["spread"], lambda w: 0.3 * size * (1 - np.exp(-((w / w0) ** 2))))


def broken_chains(world, size, drawn):
    """Damage that begins with any depth and ends where all weak chains are broken, at a share of the deepest press."""
    end = drawn["most"] * world.plan.depths[-1]
    _softening(world, drawn["spread"], lambda w: 0.25 * size * np.minimum(w / end, 1.0))


def _softening(world, spread: float, lost_at: Callable[[np.ndarray], np.ndarray]):
    """Put a gel into a world that has lost a share of its stiffness by the most that a place has been pressed [mm]."""

    def remember(world, rows, xy, depth, force):
        share = _gel_share(world, xy, np.maximum(depth, 0.05))
        past = np.zeros(len(rows))
        order = (rows["session"] * 100000 + rows["order"]).to_numpy()
        starts = np.flatnonzero(np.diff(order, prepend=-1))
        deepest = np.maximum.reduceat(depth, starts)
        for k, start in enumerate(starts):
            end = starts[k + 1] if k + 1 < len(starts) else len(rows)
            most = 0.0
            if k:
                away = np.linalg.norm(xy[starts[:k]] - xy[start], axis=1)
                most = float((deepest[:k] * np.exp(-((away / spread) ** 2))).max())
            past[start:end] = np.maximum(most, np.maximum.accumulate(depth[start:end]))
        lost = (1 - lost_at(np.maximum(past, 0))) / (1 - lost_at(np.maximum(depth, 0)))
        return force * (1 + share * (lost - 1))[:, None]

    world.history.append(remember)


def ageing(world, size, drawn):
    """The gel stiffens with the logarithm of its age from the first session on, as slow curing does."""
    _circumstance(world, lambda rows: drawn["sign"] * 0.08 * size * np.log(rows["age"] / rows["age"].iloc[0]))


def drying(world, size, drawn):
    """The gel stiffens or softens as it dries: with the root of the time since the first session, as diffusion goes."""
    _circumstance(
        world, lambda rows: drawn["sign"] * 0.02 * size * np.sqrt(rows["age"] - rows["age"].iloc[0])
    )


def activated(world, size, drawn):
    """The gel's modulus follows Arrhenius's exponential of the inverse absolute temperature."""
    over_K = drawn["sign"] * 1000.0 * size
    _circumstance(world, lambda rows: over_K * (1 / ROOM_K - 1 / (rows["temperature"] + 273.15)))


def temperature(world, size, drawn):
    """The gel's modulus follows the absolute temperature to a power; rubber's to the first."""
    power = drawn["sign"] * TEMPERATURE_POWER * size
    _circumstance(world, lambda rows: power * np.log((rows["temperature"] + 273.15) / ROOM_K))


def _circumstance(world, log_growth):
    """Put a gel into a world whose moduli grow from session to session by the exponential of `log_growth`."""

    def remember(world, rows, xy, depth, force):
        growth, force = log_growth(rows).to_numpy(), force.copy()
        for g in np.unique(growth):
            at = (growth == g) & (force[:, 2] != 0)
            ratio, flat = gel_change(world, np.exp(g))(xy[at], np.maximum(depth[at], 0.05))
            z = force[at, 2]
            force[at, 2] = z * np.exp(ratio)
            force[at, :2] = (force[at, :2] / z[:, None] + flat) * force[at, 2:]
        return force

    world.history.append(remember)


# --- contact ------------------------------------------------------------------------------------------------------------


def adhesion(world, size, drawn):
    """Johnson, Kendall and Roberts with the solved force F and contact area A; work of separation w during unloading.

    The ball is pressed s deeper without adhesion and drawn back with its contact held, F(d) -> F(d + s) - s F'(d + s), where
    s^2 / 2 dF'/dA = w: Griffith's balance of the rim (Johnson, Kendall & Roberts 1971, doi:10.1098/rspa.1971.0141).
    """
    h = 0.02  # mm, of differences

    def remember(world, rows, xy, depth, force):
        up = (rows["phase"] == "unload").to_numpy() & (depth > 0)
        w = 1e-4 * size
        d = np.maximum(depth, 0.05)

        def pressing(depth):
            return -world.elastic(xy, depth)[:, 2]

        def area(depth):  # from that at the middle
            return np.vander(depth, len(world.library.area), increasing=True) @ world.library.area * depth

        deeper = np.zeros_like(d)
        for _ in range(8):  # it changes by less and less: s is a tenth of a millimetre at most
            D = d + deeper
            stiffening = (pressing(D + h) - 2 * pressing(D) + pressing(D - h)) / h**2
            growing = (area(D + h) - area(D - h)) / (2 * h)
            deeper = np.sqrt(2 * w * np.maximum(growing, 1e-3) / np.maximum(stiffening, 1e-3))
        D = d + deeper
        stiffness = (pressing(D + h) - pressing(D - h)) / (2 * h)
        pull = np.maximum(pressing(d) - pressing(D) + deeper * stiffness, 0.0)
        return force + np.where(up, pull, 0.0)[:, None] * np.array([0.0, 0.0, 1.0])

    world.history.append(remember)


def toe(world, size, drawn):
    """A film that gives way exponentially: its thickness h is used up over a force."""
    h, give = 0.04 * size, drawn["give_N"]
    world.yielding.append(lambda xy, z: h * (1 - np.exp(np.minimum(z, 0.0) / give)))
