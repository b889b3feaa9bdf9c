"""The sensors that FElupe presses: their shape, the places and depths that are solved, and the effects of the body.

All are square blocks of a gel under a skin, within a wall of 1 mm, with the article's shear moduli. `SMALL` is the sensor of
the first nineteen sets. `THIN` has a thinner body, a larger ball, a softer skin and neo-Hookean models, and its ball
comes near the wall. `WIDE` is pressed so far from its wall that all places are alike, with friction.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .pressed import COARSE, FINE, MIDDLE, Setup, Sizes
from .presses import Place, Plan

FRICTION = 0.3


@dataclass(frozen=True)
class Sensor:
    """A body under a ball. Places are from its middle [mm]; a press to one stands for its mirror images."""

    name: str
    body: dict = field(hash=False)  # of Setup: what differs from its defaults
    nodes: tuple[
        float, ...
    ]  # |x|, |y| at which the base is solved, closer where the contact reaches the wall
    orbits: tuple[
        Place, ...
    ]  # four places at which effects are solved: the middle, on an axis, between, on a diagonal
    depths: tuple[float, ...]  # of the base [mm]
    effect_depths: tuple[float, ...]
    plan: Plan  # of its recordings
    alike: bool = False  # all places are as the middle: only that is solved
    base_sizes: Sizes = MIDDLE
    effect_sizes: Sizes = COARSE

    @property
    def plain(self) -> Setup:
        """Return the body, pressed at its middle, nothing changed."""
        return Setup(**self.body)

    @property
    def middle(self) -> np.ndarray:
        """Return the middle (2,) [mm] in the sensor's own coordinates, which begin at a corner."""
        return np.full(2, self.plain.width_mm / 2)

    @property
    def effects(self) -> dict[str, dict]:
        """Return by name what each effect changes of the body."""
        plain = self.plain
        found = {
            "gel stiffer": {"gel": 1.25},
            "gel softer": {"gel": 0.8},
            "thicker": {"gel_mm": round(1.1 * plain.gel_mm, 6)},
            "thinner": {"gel_mm": round(0.9 * plain.gel_mm, 6)},
            "larger ball": {"radius_mm": round(1.05 * plain.radius_mm, 6)},
            "stiffening": {"stiffening": 0.1},
            "late stiffening": {"stiffening": 0.1, "power": 3},
            "compressible": {"bulk_to_shear": 40.0},
            "slab": {"slab_MPa": 1.0},
        }
        if not self.alike:
            found |= {"stiffer wall": {"wall": 1.6}, "wall gap": {"gap": 0.05}}
        if not plain.neo_hooke:
            found["neo-Hooke"] = {"neo_hooke": True}
        if plain.friction:
            return found | {"smooth": {"friction": 0.0}}
        rubbing = {"friction": FRICTION}  # twice the slip before a node slides tells what none would be
        return found | {"friction": rubbing, "slipping": rubbing | {"tangential": plain.tangential / 2}}

    def solved(self, x: float, y: float) -> Place:
        """Return the place whose solution stands for a place."""
        return (0.0, 0.0) if self.alike else (float(x), float(y))

    @property
    def triangle(self) -> list[Place]:
        """Return the places (a, b), a >= b, of the base."""
        return [(a, b) for a in self.nodes for b in self.nodes if a >= b]


SMALL = Sensor(
    "small",
    {},
    nodes=(0.0, 2.0, 4.0, 5.5, 6.0, 6.4, 6.8),  # the last for presses that a turned grid takes beyond 6 mm
    orbits=((0.0, 0.0), (6.0, 0.0), (4.0, 2.0), (6.0, 6.0)),
    depths=(0.2, 0.4, 0.8, 1.2, 1.6, 1.85),
    effect_depths=(0.4, 0.8, 1.2, 1.6, 1.85),
    plan=Plan(((6.0, 0.0), (4.0, 2.0), (6.0, 6.0)), (0.4, 0.8, 1.2, 1.6), sentinel_every=9),
)
THIN = Sensor(
    "thin",
    {"gel_mm": 3.0, "skin_mm": 0.6, "radius_mm": 6.5, "skin": 0.6, "neo_hooke": True},
    nodes=(0.0, 2.5, 4.5, 5.5, 6.2),
    orbits=((0.0, 0.0), (5.0, 0.0), (3.5, 1.5), (5.0, 5.0)),
    depths=(0.15, 0.3, 0.6, 0.9, 1.2, 1.4),
    effect_depths=(0.3, 0.6, 0.9, 1.2, 1.4),
    plan=Plan(
        ((5.0, 0.0), (3.5, 1.5), (5.0, 5.0)),
        (0.3, 0.6, 0.9, 1.2),
        speed=0.5,
        dwell_s=(1.0, 6.0),
        press_s=20.0,
    ),
)
WIDE = Sensor(
    "wide",
    {"gel_mm": 3.0, "skin_mm": 0.5, "radius_mm": 4.0, "friction": FRICTION, "width_mm": 32.0},
    nodes=(0.0, 3.0, 6.0, 8.0),
    orbits=((0.0, 0.0), (6.0, 0.0), (5.0, 2.0), (6.0, 6.0)),
    depths=(0.15, 0.3, 0.6, 0.9, 1.2, 1.4),
    effect_depths=(0.3, 0.6, 0.9, 1.2, 1.4),
    plan=Plan(
        ((6.0, 0.0), (6.0, 6.0)),
        (0.3, 0.6, 0.9, 1.2),
        sentinel_every=10,
        random_order=False,
        speed=2.0,
        dwell_s=(0.5, 3.0, 9.0),
        press_s=15.0,
        unloading=False,  # with friction its forces are others, which are not solved
    ),
    alike=True,
    base_sizes=FINE,
    effect_sizes=MIDDLE,
)
SENSORS = {sensor.name: sensor for sensor in (SMALL, THIN, WIDE)}
