"""Checks of friction: partial slip of a ball on a half space, the cone's edge, and no drag without friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gelforge.mechanics.bodies.body import Body, SmallStrainBody
from gelforge.mechanics.contact.forces import SLIP, STICK
from gelforge.mechanics.contact.state import Settings, State
from gelforge.mechanics.indenters.shapes import Cylinder, Sphere
from gelforge.mechanics.meshes.mesh import Block, Sizes, layered_block
from gelforge.mechanics.reference_solutions import (
    cattaneo_mindlin,
    cattaneo_mindlin_traction,
    contact_modulus,
    hertz,
    poissons_ratio,
    pressed_with_friction,
    sliding_shift,
)
from gelforge.mechanics.solving.equilibrium import Press
from gelforge.verification.check import Check, absolute, relative, vanishing
from gelforge.verification.presses import (
    BULK_TO_SHEAR,
    NEO_HOOKE,
    NU,
    PER_RADIUS,
    RADIUS,
    ROUNDING,
    contact_radius,
    follow,
    half_space,
)

# The problems whose errors docs/verification.md compares with their limits:
FRICTION = 0.3  # any would do: the references hold for each
DEPTH = 0.01  # mm: a contact radius of sqrt(100 mm x 0.01 mm) = 1 mm (Hertz 1882)
FAR = 2.0  # mm: friction is compared with the normal force that results


def partial_slip() -> list[Check]:
    """Return force, stick radius and traction of a ball that is pressed on a nearly infinite block and moved sideways.

    The shift is four fifths of that at which all of it slides. As the ball is moved at a constant depth, its normal force
    is taken as found. The block's base, 130 contact radii below, adds 0.8 % to forces; 8 elements over the contact radius
    change them by 1 % or so, and what the solution leaves out (slip across the shift) by some per cent. Within an element
    of the rim, where the traction ends with an infinite slope, a node's mean is no value at its place; further inside
    rings of one element are compared, in which the radial shear that pressing has left cancels.
    """
    mesh, middle = half_space(FAR)
    body = SmallStrainBody(mesh, {"gel": NEO_HOOKE}, BULK_TO_SHEAR)
    press = Press(body, Sphere(RADIUS), Settings(friction=FRICTION, gap_tolerance=1e-6))
    start = press.start(middle, middle)
    G = NEO_HOOKE.shear_modulus
    pressed = hertz(DEPTH, RADIUS, contact_modulus(G, NU))
    shift = sliding_shift(pressed.force, pressed.contact_radius, FRICTION, G, NU) * 0.8
    path = np.array([[0.0, 0.0, -DEPTH], [shift, 0.0, -DEPTH]])
    state = list(press.follow(start, start.centre + path))[-1]
    a, N = contact_radius(press, state), -float(state.normal_force[:, 2].sum())
    known = cattaneo_mindlin(shift, N, a, FRICTION, G, NU)
    stick = np.sqrt(press.area[state.contact_state == STICK].sum() / np.pi)
    r = np.hypot(*(press.body.mesh.X[press.surface, :2] - [middle + shift, middle]).T)
    ring = np.floor(r[r < a - 1 / PER_RADIUS] * PER_RADIUS).astype(int)
    inside, weight = r < a - 1 / PER_RADIUS, np.bincount(ring)
    expected = cattaneo_mindlin_traction(r[inside], a, known.stick_radius, N, FRICTION)
    traction = state.friction_force[inside, 0] / press.area[inside]
    error = np.bincount(ring, traction - expected) / np.maximum(weight, 1)
    off = np.sqrt(np.average(error**2, weights=weight)) / expected.max()
    name, source = "ball moved sideways by 4/5 of its slip", "Cattaneo 1938, Mindlin 1949"
    return [
        relative(f"{name}: sideways force [N]", source, known.force, float(state.force[0]), 0.04),
        absolute(
            f"{name}: stick radius [mm], within one element",
            source,
            known.stick_radius,
            stick,
            1 / PER_RADIUS,
        ),
        vanishing(f"{name}: shear traction of rings, rms error over its largest", source, off, 0.07),
    ]


# Spence's (1975) ball at Poisson's ratio 0.3: 2 (1 + nu) / (3 (1 - 2 nu)). A gel that keeps its volume has no shear under a
# ball.
SPENCE_BULK_TO_SHEAR = 13 / 6


def pressed_stick_zone() -> list[Check]:
    """Return force ratio and stick radius of a ball that is pressed straight into a nearly infinite block with friction.

    The contact grows with the depth and every ring of it begins to slip as it touches; the steps are graded as the solver
    does. The friction's sum over the normal force feels no single node; the stick radius is one of 8 elements fine.
    """
    nu = poissons_ratio(SPENCE_BULK_TO_SHEAR)
    known = pressed_with_friction(FRICTION, nu)
    mesh, middle = half_space(FAR)
    body = SmallStrainBody(mesh, {"gel": NEO_HOOKE}, SPENCE_BULK_TO_SHEAR)
    press = Press(body, Sphere(RADIUS), Settings(friction=FRICTION, gap_tolerance=1e-6))
    state = follow(press, (middle, middle), DEPTH * np.linspace(0.4, 1, 5) ** 2)[-1]
    outward = press.body.mesh.X[press.surface, :2] - middle
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    share = (state.friction_force[:, :2] * outward).sum() / -state.normal_force[:, 2].sum()
    stick = np.sqrt(press.area[state.contact_state == STICK].sum() / np.pi) / contact_radius(press, state)
    name, source = "ball pressed in with friction", "Spence 1975, by an integral equation"
    return [
        absolute(f"{name}: radial friction over normal force", source, known.friction_share, share, 0.004),
        absolute(
            f"{name}: stick over contact radius, within an element",
            source,
            known.stick_ratio,
            stick,
            1 / PER_RADIUS,
        ),
    ]


def cone_edge() -> list[Check]:
    """Return whether a block on a plane slips just beyond the cone of friction, and not just within it.

    An elastic block is pressed by a plate and sheared so that nothing slips; the largest ratio of shear to normal force
    at a node is where the cone's edge has to be. With friction a millionth above it nothing slips and nothing changes; a
    millionth below, that node alone slips, with the limit's force.
    """
    edge, stuck = _sheared_block(5.0)
    _, above = _sheared_block(edge * (1 + 1e-6))
    beyond, below = _sheared_block(edge * (1 - 1e-6))
    size = np.linalg.norm(stuck.friction_force)
    source = "Coulomb's cone"
    return [
        vanishing("nodes that slip within the cone's edge", source, (above.contact_state == SLIP).sum(), 0),
        vanishing(
            "change of friction within it",
            source,
            np.linalg.norm(above.friction_force - stuck.friction_force) / size,
            1e-8,
        ),
        relative("force ratio of the node that slips beyond it", source, edge * (1 - 1e-6), beyond, 1e-8),
        relative("whether any node slips beyond it", source, 1, (below.contact_state == SLIP).any(), 0),
    ]


def _sheared_block(friction: float) -> tuple[float, State]:
    """Return the largest ratio of shear to normal force at a node of a sheared block under a plate, and its state."""
    mesh = layered_block(Block(4.0, 4.0, (("gel", 1.0),)), 2.0, 2.0, Sizes(near=0.5, far=0.5))
    body = SmallStrainBody(mesh, {"gel": NEO_HOOKE}, 2 / 3)
    press = Press(body, Cylinder(radius=20.0, length=20.0, edge=1.0), replace(ROUNDING, friction=friction))
    start = press.start(2.0, 2.0)
    path = np.array([[0.0, 0.0, -0.02], [0.005, 0.0, -0.02]])
    state = list(press.follow(start, start.centre + path))[-1]
    on = state.contact_state > 0
    ratio = np.linalg.norm(state.friction_force[on], axis=1) / np.linalg.norm(state.normal_force[on], axis=1)
    return float(ratio.max()), state


def frictionless_slide() -> list[Check]:
    """Return the drag on a ball drawn over a frictionless surface, and its force next to the slope of the energy.

    Drawn over the middle of a block by one element the ball ends where the mesh looks the same: no work is done.
    """
    block = Block(16.0, 16.0, (("gel", 3.0),))
    mesh = layered_block(block, 8.0, 8.0, Sizes(near=0.5, near_radius=4.0, growth=0.5, far=1.0))
    press = Press(Body(mesh, {"gel": NEO_HOOKE}, 100.0), Sphere(5.0), replace(ROUNDING, friction=0.0))
    start = press.start(8.0, 8.0)
    step, size = 0.002, 0.5
    slide = [*np.linspace(-size / 2, size / 2, 9), size / 8 - step, size / 8, size / 8 + step]
    path = np.array([[-size / 2, 0.0, -0.5], *[[x, 0.0, -0.8] for x in slide]])
    states = list(press.follow(start, start.centre + path))[1:]
    force = np.array([state.force for state in states])
    before, middle, after = states[-3:]
    slope = (after.energy - before.energy) / (2 * step)
    drag = np.trapezoid(force[:9, 0], dx=size / 8) / size
    mean = "mean drag of a frictionless ball over one element, over its force"
    along = "its force along the slide less the slope of the energy, over its force"
    return [
        vanishing(mean, "no work is done", drag / force[0, 2], 1e-3),
        # central differences: h^2 of a force that changes over an element
        vanishing(along, "elasticity", (-middle.force[0] - slope) / middle.force[2], 1e-4),
    ]
