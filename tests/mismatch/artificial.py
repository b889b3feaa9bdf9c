"""An artificial base and its readings: forces from formulas, no finite elements, so that any effect is known exactly.

SYNTHETIC, for tests only. The sensor is a square of 20 mm; forces grow as depth^1.5 and towards the walls, where there is
a lateral force too. Derivatives of the solver's effects are formulas of the right sign, unit and rough size.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import specimens

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.model import places
from gelforge.mismatch.model.effect import Context, Curves
from gelforge.mismatch.readings.observations import COLUMNS, Observations, last_moves

WIDTH, RADIUS = 20.0, 5.0  # mm
DEPTHS = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0)  # of the curves, mm
SPEED = 2.0  # mm/s
PRESS_S = 30.0  # from press to press
DWELL_S = (0.5, 1.0, 2.0, 4.0, 8.0)
UNLOAD = (0.75, 0.5, 0.25)  # of the deepest depth
NOISE_N = (0.01, 0.01, 0.02)
ZERO_ROWS = 5


def study(**mechanics):
    """Return the study of the artificial sensor."""
    sensor = {
        "width_x_mm": WIDTH,
        "width_y_mm": WIDTH,
        "layers": [
            {"name": "gel", "thickness_mm": 4.5, "material": "soft", "particle_volume_fraction": 0.02},
            {"name": "skin", "thickness_mm": 1.5, "material": "stiff"},
        ],
    }
    return specimens.study(sensor=sensor, **mechanics)


def force(x, y, depth):
    """Return the force (..., 3) [N] on the sensor pressed at (x, y) to a depth [mm]."""
    u, v, d = np.broadcast_arrays(2 * x / WIDTH - 1, 2 * y / WIDTH - 1, np.maximum(depth, 0.0))
    pressing = 0.6 * d**1.5 * (1 + 0.2 * d) * (1 + 0.4 * (u**4 + v**4))
    return np.stack([-0.15 * u**3 * pressing, -0.15 * v**3 * pressing, -pressing], axis=-1)


def _along(x, y, depth, dx=0.0, dy=0.0, step=1e-4):
    """Return the derivative (..., 3) of the force as the place moves by (dx, dy)."""
    dx, dy = step * np.asarray(dx), step * np.asarray(dy)
    return (force(x + dx, y + dy, depth) - force(x - dx, y - dy, depth)) / (2 * step)


def _bump(place, x, y):
    away = (x - place["x_mm"]) ** 2 + (y - place["y_mm"]) ** 2
    radius = place["radius_mm"]
    return (radius / 2) ** 3 * np.exp(-away / (2 * (1.6 + 0.7 * radius) ** 2))[..., None]


def derivatives(x, y, d):
    """Return d force / d theta (..., 3) of what the solver knows, by key, at (x, y) and depths d [mm]."""
    F, c = force(x, y, d), WIDTH / 2
    depth = np.asarray(d, dtype=float)[..., None]
    u, v = (x - c) / c, (y - c) / c
    gel = 0.75 - 0.1 * depth / (1 + depth)
    wall = (u**8 + v**8) / (1 + u**8 + v**8)
    lateral, up = np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    across, along = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    slope = (force(x, y, d + 1e-4) - force(x, y, d - 1e-4)) / 2e-4
    pressing = -F[..., 2:]
    found = {
        "gel_stiffness": gel * F,
        "skin_stiffness": (1 - gel) * F,
        "law_exponent": 0.05 * depth**2 * F,
        "compressibility": -4.0 * depth**0.5 * (1 + wall) * F,
        "elastic_base": 0.05 * F[..., 2:] * slope,
        "linear_elasticity": -0.04 * depth**2 * F,
        "small_strain": -0.06 * depth**2 * (1 + 0.3 * wall) * F,
        "friction": 0.05 * F + 0.3 * lateral * F,
        "frictionless@0": -0.03 * F - 0.2 * lateral * F,
        "friction_law": -0.02 * depth * F - 0.1 * depth * lateral * F,
        **{f"toe_region@{k}": -(1 - np.exp(-depth / d)) * slope for k, d in enumerate((0.1, 0.2, 0.4))},
        "layer_thickness": -0.12 * (1 + 0.15 * depth) * F,
        "thickness_gradient.x": -0.12 * (x - c) * F - 0.3 * pressing * along,
        "thickness_gradient.y": -0.12 * (y - c) * F - 0.3 * pressing * across,
        "wall_stiffness": 0.3 * wall * F,
        "wall_gap": -0.25 * wall / (1 + 0.3 * depth) * F,
        **{
            f"wall_side@{k}": (-0.2 if k < 4 else -0.1)
            / (1 + 0.2 * (k < 4) * depth)
            * one_wall[..., None]
            * F
            for k, one_wall in enumerate(2 * [((1 + s * a) / 2) ** 8 for a in (u, v) for s in (-1, 1)])
        },
        "prestretch": -2.0 * np.maximum(depth, 0) * up,
        "indenter_radius": 0.09 * (1 - 0.05 * depth) * F,
        "particle_settling": 0.01 * (depth - 0.8) * F,
        "contact_zero": slope,
        "tilt.about_x": -0.017 * pressing * across,
        "tilt.about_y": 0.017 * pressing * along,
        "misregistration.x": _along(x, y, d, dx=1.0),
        "misregistration.y": _along(x, y, d, dy=1.0),
        "yaw": _along(x, y, d, dx=-np.radians(y - c), dy=np.radians(x - c)),
        "grid_scale": _along(x, y, d, dx=x - c, dy=y - c),
        "frame_compliance": F[..., 2:] * slope,
    }
    for name, sign in (("void", -0.2), ("inclusion", 0.02)):
        for k, place in enumerate(places.balls(study())):
            found[f"{name}@{k}"] = sign * _bump(place, x, y) * depth * F
    for k, place in enumerate(places.patches(study())):
        found[f"delamination@{k}"] = -0.1 * _bump(place, x, y) * F
    return found


def sites(per_side=5, margin=4.0):
    """Return the positions (S, 2) [mm] of an even grid."""
    line = np.linspace(margin, WIDTH - margin, per_side)
    return np.array([(x, y) for y in line for x in line])


def table(rng, places_mm, depths=(0.5, 1.0, 1.5, 2.0), session="s1", raster=False):
    """Return the rows of a session: every site to every depth, in random order; load, dwell and unload."""
    presses = [(site, depth) for site in range(len(places_mm)) for depth in depths]
    order = np.arange(len(presses)) if raster else rng.permutation(len(presses))
    rows = []
    for number, which in enumerate(order):
        site, depth = presses[which]
        arrival = depth / SPEED
        course = [("load", arrival, depth)] + [("dwell", arrival + t, depth) for t in DWELL_S]
        course += [
            ("unload", arrival + DWELL_S[-1] + (1 - share) * depth / SPEED, share * depth) for share in UNLOAD
        ]
        for phase, t, d in course:
            rows.append(
                (session, f"{session}/p{number}", number, site, phase, PRESS_S * number + t, t, d, depth)
            )
    columns = [
        "session",
        "press",
        "order",
        "site",
        "phase",
        "time_s",
        "press_time_s",
        "depth_mm",
        "deepest_mm",
    ]
    found = pd.DataFrame(rows, columns=columns)
    found[["x_mm", "y_mm"]] = places_mm[found["site"]]
    return found


def context(
    seed=0,
    per_side=5,
    depths=(0.5, 1.0, 1.5, 2.0),
    sessions=1,
    tared=False,
    raster=False,
    contact_point_mm=0.01,
    zero_by="press",
    noise_N=NOISE_N,
    **mechanics,
):
    """Return a context whose readings are the base with noise, zero and contact point drawn; sessions are 30 days apart."""
    rng = np.random.default_rng(seed)
    where = sites(per_side)
    parts = [
        table(rng, where, depths, f"s{k + 1}", raster).assign(age_days=30.0 * k, temperature_C=23.0 + 4.0 * k)
        for k in range(sessions)
    ]
    rows = pd.concat(parts, ignore_index=True)[COLUMNS]
    moves = np.concatenate([last_moves(part) for part in parts])
    base = force(rows["x_mm"].to_numpy(), rows["y_mm"].to_numpy(), rows["depth_mm"].to_numpy())
    noise = np.broadcast_to(np.array(noise_N, dtype=float), base.shape)
    zero = np.zeros_like(noise) if tared else noise / np.sqrt(ZERO_ROWS)
    depths = [np.full(len(rows), contact_point_mm * (zero_by == by)) for by in ("press", "session")]
    observations = Observations(rows, base, where, noise, zero, *depths, came_along=moves)
    curves, slopes = solved(per_side)
    found = Context(study(**mechanics), observations, base, curves, slopes)
    return read(found, base, rng)


@cache  # of the process: interpolated once
def solved(per_side: int) -> tuple[Curves, dict[str, Curves]]:
    """Return the forces of the base over depth at every site, and their derivatives."""
    where, knots = sites(per_side), np.array(DEPTHS)
    by_site = [derivatives(x, y, knots) for x, y in where]
    slopes = {key: Curves((knots,) * len(where), tuple(s[key] for s in by_site)) for key in by_site[0]}
    return Curves((knots,) * len(where), tuple(force(x, y, knots) for x, y in where)), slopes


def read(base: Context, forces, rng) -> Context:
    """Return the context with other readings: forces (R, 3) [N] with noise, zero and contact point drawn anew."""
    seen = base.observations
    press, session = seen.table["press"].factorize()[0], seen.table["session"].factorize()[0]
    zero = rng.standard_normal((press.max() + 1, 3))[press] * seen.zero_N
    deeper = np.zeros(len(press))
    for group, size in ((press, seen.press_depth_mm), (session, seen.session_depth_mm)):
        if size.any():
            deeper = deeper + rng.standard_normal(group.max() + 1)[group] * size
    drawn = forces + rng.standard_normal(forces.shape) * seen.noise_N + zero + deeper[:, None] * base.slope()
    return replace(base, observations=replace(seen, force=drawn))


def chosen(base: Context, rows) -> Context:
    """Return the context of some readings (R,) bool."""
    known = {name: values[rows] for name, values in base.at_readings.items()}
    part = base.observations.chosen(rows)
    return replace(base, observations=part, force=base.force[rows], at_readings=known)


def with_effect(base: Context, name, theta, rng, number=0) -> Context:
    """Return the context whose readings hold a value of an effect, by the effect's own first order."""
    effect = CATALOGUE[name]
    changed = effect.to_forces(base, effect.grid(base)[number], base.force, np.array(theta, dtype=float))
    return read(base, changed, rng)
