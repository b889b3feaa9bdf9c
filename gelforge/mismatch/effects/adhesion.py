"""Surfaces that have touched hold together: the indenter is pulled during unloading."""

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.model.effect import Context, Hyperparameters
from gelforge.mismatch.model.solver_effects import has, pressed_by_balls, solved

LAWS = ("constant", "JKR")


def to_forces(
    context: Context, hyperparameters: Hyperparameters, force: np.ndarray, theta: Sequence[float]
) -> np.ndarray:
    """Return the forces with adhesion: during unloading, while there is contact, the sensor is pulled up (R, 3) [N]."""
    (w,) = theta
    table = context.observations.table
    up = ((table["phase"] == "unload") & (table["depth_mm"] > 0)).to_numpy()
    if not w or not up.any():
        return force
    pulls = {"constant": constant_pull, "JKR": jkr_pull}[str(hyperparameters.get("law", "constant"))]
    return force + np.outer(up * pulls(context, float(w)), [0.0, 0.0, 1.0])


def constant_pull(context: Context, w: float) -> np.ndarray:
    """Return w dA/dd (R,) [N]: to first order in the work w, at a held depth d, the energy of the surfaces that stick.

    The contact area A grows by pi R d on a half space and by 2 pi R d on a layer that is thin next to it; between them 1.5
    is taken.
    """
    growth = sum(1.5 * np.pi * part.radius_mm for part in context.study.indenter.shapes)
    return np.full(len(context.observations.table), w * growth)


def jkr_pull(context: Context, w: float) -> np.ndarray:
    """Return by how much (R,) [N] the push of Johnson, Kendall and Roberts falls behind that without adhesion.

    Each reading at its depth on the way back from its indentation's deepest point (doi 10.1098/rspa.1971.0141), with the
    solved force of its site.
    """
    table, parts = context.observations.table, context.study.indenter.shapes
    depth = np.maximum(table["depth_mm"].to_numpy(float), 1e-6)  # its logarithm is taken
    deepest = np.maximum(table["deepest_mm"].to_numpy(float), depth)
    pull = np.zeros(len(table))
    for site, rows in table.groupby("site").indices.items():
        if not (context.curves.values[site][:, 2] < 0).any():
            continue
        push = push_of(context.curves.depths[site], -context.curves.values[site][:, 2] / len(parts))
        for part in parts:
            layer = Contact(part.radius_mm, context.study.sensor.height_mm, push)
            pull[rows] += layer.pull(w, depth[rows], deepest[rows])
    return pull


def push_of(depths: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Return the polynomial in the root of the depth of the logarithm of a push over depth^1.5: Hertz's where it is even."""
    known = forces > 0
    over_hertz = np.log(forces[known] / depths[known] ** 1.5)
    return np.polyfit(np.sqrt(depths[known]), over_hertz, min(2, known.sum() - 1))


class Contact:
    """A ball on a layer of some thickness [mm] whose push without adhesion is known (push_of).

    Its contact radius a is that of a half space, a^2 = R d, as long as it is small next to the layer; where it is as large
    as the layer is thick the area grows twice as fast, as on a thin incompressible layer: dA/dd = pi R (1 + a / thickness).
    FElupe's areas grow so within 8 % from 0.4 mm on (4 mm of gel, 1 mm of skin, ball of 5 mm); below, where a stiff skin
    bends under a small contact, by two thirds of it.
    """

    def __init__(self, radius: float, thickness: float, push: np.ndarray):
        self.radius, self.thickness, self.over_hertz = radius, thickness, push

    def push(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the push without adhesion [N], its slope and its curvature over the depth."""
        root = np.sqrt(d)
        first, second = (np.polyval(np.polyder(self.over_hertz, k), root) for k in (1, 2))
        # d ln F / d ln d, and its slope there
        n, bend = 1.5 + root * first / 2, root * (first + root * second) / 4
        force = d**1.5 * np.exp(np.polyval(self.over_hertz, root))
        return force, force * n / d, force * (n * (n - 1) + bend) / d**2

    def retreat(self, w: float, d: np.ndarray) -> np.ndarray:
        """Return how far [mm] the ball is drawn back with the contact held of a depth d, when its rim lets go.

        Griffith's balance: s^2 / 2 dF'/dA = w, F' the stiffness that the held contact has as a flat punch.
        """
        a = np.sqrt(self.radius * d)
        growth = np.pi * self.radius * (1 + np.minimum(a / self.thickness, 1.0))
        # N/mm^2: a push that does not stiffen has no rim that lets go
        return np.sqrt(2 * w * growth / np.maximum(self.push(d)[2], 1e-9))

    def pull(self, w: float, depth: np.ndarray, deepest: np.ndarray) -> np.ndarray:
        """Return the push without adhesion less that with it [N] at depths after the deepest.

        The rim does not move until it lets go, so no contact is larger than that of the deepest point.
        """
        held = depth
        for _ in range(20):  # a contraction by 1/4 and less each time
            held = np.minimum(depth + self.retreat(w, held), deepest)
        force, stiffness, _ = self.push(held)
        return self.push(depth)[0] - force + stiffness * (held - depth)


EFFECT = solved(
    "adhesion",
    "work",
    (0.0, 2e-3),
    "width: 0.1 J/m2, twice silicone's surface energy of 0.02 J/m2 with some dissipation; bounds: 2 J/m2, a sticky"
    " gel torn off fast (judgement)",
    has("contact.adhesion.work_N_per_mm"),
    means=("the surface sticks to the indenter",),
    signature="less force during unloading, as much at any depth or more where the contact is large, down to a pull before"
    " the indenter lets go; loading clean within millinewtons",
    separated_by="slow unloading with readings up to where the indenter lets go; a dusted surface",
    applies=pressed_by_balls,
    grid=lambda context: [{"law": law} for law in LAWS],
    to_forces=to_forces,
    by_formula=True,
)
