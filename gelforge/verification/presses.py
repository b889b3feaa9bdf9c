"""Checks of contact: indentations whose force is known, and what every indentation must balance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gelforge.mechanics.bodies.body import Body, SmallStrainBody
from gelforge.mechanics.contact.state import Settings, State
from gelforge.mechanics.indenters.shapes import Cylinder, Sphere
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.meshes.elements import lumped_area
from gelforge.mechanics.meshes.mesh import Block, Mesh, Sizes, layered_block
from gelforge.mechanics.reference_solutions import (
    bonded_layer_at_radius,
    contact_modulus,
    hertz,
    poissons_ratio,
)
from gelforge.mechanics.solving.balances import force_balance, moment_balance
from gelforge.mechanics.solving.equilibrium import Press
from gelforge.verification.check import Check, absolute, relative, vanishing
from gelforge.verification.elements import GEL, distorted

# ------------------------------------------------------------------------------------- small strain, known solutions
NEO_HOOKE = Ogden((0.02,), (2.0,))  # MPa
BULK_TO_SHEAR = 1000.0  # Poisson's ratio 0.4995; a study's usual one (config/parts/mechanics.py)
NU = poissons_ratio(BULK_TO_SHEAR)
# mm: at a contact radius of 1 mm the strains are some 0.01, a / R (Hertz 1882), and a ball is a paraboloid to 1e-4
RADIUS = 100.0

# The problems whose errors docs/verification.md compares with their limits:
PER_RADIUS = 8  # elements over the contact radius
WITHIN = "contact radius [mm], within one element"


def hertz_presses() -> list[Check]:
    """Return force, contact radius and exponent of an indentation of a nearly infinite block.

    The block's outer part is stretched to 130 contact radii, where its base still adds 0.8 % to the force (the bonded
    layer's solution); 8 elements over the contact radius and few far away add 0.9 %.
    """
    mesh, middle = half_space()
    depths = np.array([0.01, 0.02])
    modulus = contact_modulus(NEO_HOOKE.shear_modulus, NU)
    states, press = _press_flat(mesh, middle, depths)
    known = hertz(depths[0], RADIUS, modulus)
    force = np.array([-state.force[2] for state in states])
    exponent = np.log(force[1] / force[0]) / np.log(depths[1] / depths[0])
    radius = contact_radius(press, states[0])
    return [
        relative("Hertz: force [N]", "Hertz 1882", known.force, force[0], 0.02),
        absolute(f"Hertz: {WITHIN}", "Hertz 1882", known.contact_radius, radius, 1.0 / PER_RADIUS),
        absolute("Hertz: exponent of force in depth", "Hertz 1882", 1.5, exponent, 0.02),
    ]


def half_space(far: float = 1.0) -> tuple[Mesh, float]:
    """Return a nearly infinite block, fine within 1.3 mm of the middle of its top, and x = y of that middle [mm].

    far: size of elements far away before they are stretched [mm]; 2 in place of 1 adds 1.1 % to Hertz's force.
    """
    width, near = 28.0, 1.0 / PER_RADIUS
    block = Block(width, width, (("gel", width / 2),))
    mesh = layered_block(block, width / 2, width / 2, Sizes(near, near_radius=1.3, growth=0.3, far=far))
    return spread_out(mesh, np.array([width / 2, width / 2, 0.0]), start=5.0, length=2.2), width / 2


def bonded_layers(ratios=(0.3, 0.5, 1.0)) -> list[Check]:
    """Return force and contact radius of indentations of bonded layers, by the ratio of contact radius to thickness.

    The force at 8 elements over the contact radius lies within 0.6 % of that at 16, which lies within 0.4 % of the solution.
    """
    checks = []
    for ratio in ratios:
        thickness, near = 1.0 / ratio, 1.0 / PER_RADIUS
        known = bonded_layer_at_radius(1.0, RADIUS, thickness, NEO_HOOKE.shear_modulus, NU)
        width = 2 * (
            1.0 + 3 * thickness
        )  # what is pressed out comes up within two thicknesses of the contact
        block = Block(width, width, (("gel", thickness),))
        sizes = Sizes(near, near_radius=1.3, growth=0.3, far=thickness / 2)
        mesh = layered_block(block, width / 2, width / 2, sizes)
        (state,), press = _press_flat(mesh, width / 2, [known.depth])
        name, source = f"bonded layer a/h = {ratio:g}", "Fredholm equation"
        checks += [
            relative(f"{name}: force [N]", source, known.force, -state.force[2], 0.01),
            absolute(f"{name}: {WITHIN}", source, 1.0, contact_radius(press, state), near),
        ]
    return checks


def contact_patch() -> list[Check]:
    """Return how even the pressure is under a flat indenter that covers a block, hanging nodes on its top included.

    Without lateral contraction (K/mu = 2/3) and at small strain the block on its clamped base shortens evenly.
    """
    height, depth, mu = 2.0, 0.01, 0.02
    sizes = Sizes(near=0.5, near_radius=0.6, growth=0.4, far=1.0)
    mesh = layered_block(Block(4.0, 4.0, (("gel", height),)), 2.0, 2.0, sizes)
    inside = ((mesh.X > mesh.X.min(axis=0) + 1e-9) & (mesh.X < mesh.X.max(axis=0) - 1e-9)).all(axis=1)
    mesh = replace(distorted(replace(mesh, fixed=~inside), 0.2), fixed=mesh.fixed)
    settings = Settings(friction=0.0, force_tolerance=1e-12, gap_tolerance=1e-12)
    body = SmallStrainBody(mesh, {"gel": Ogden((mu,), (2.0,))}, 2 / 3)
    press = Press(body, Cylinder(radius=20.0, length=20.0, edge=1.0), settings)
    (state,) = follow(press, (2.0, 2.0), [depth])
    top = mesh.X[mesh.surface.nodes, 2] > -1e-9
    assert mesh.ties is not None  # the mesh is refined around the contact
    # of the top alone: rim nodes own side faces too
    area = mesh.ties.T @ lumped_area(mesh.X, mesh.surface.faces)
    pressure = -state.normal_force[top, 2] / area[mesh.surface.nodes[top]]
    known = 2 * mu * depth / height  # E = 2 mu (1 + nu), nu = 0
    # Rounding of stresses that cancel at the inner nodes, and of the gap: 1e-16 of 20 mm times 20 N/mm^3.
    return [
        Check(
            "contact patch test: pressure [MPa], its largest error over all nodes",
            "uniform stress E depth / height",
            known,
            float(pressure[np.argmax(np.abs(pressure - known))]),
            float(np.abs(pressure / known - 1).max()),
            1e-9,
        )
    ]


def spread_out(mesh: Mesh, centre: np.ndarray, start: float, length: float) -> Mesh:
    """Return the mesh with its parts beyond start [mm] from the centre stretched along each axis.

    A distance d becomes start + length (exp((d - start) / length) - 1), so that a small block reaches nearly infinity. Areas
    of the contact surface are right within start only.
    """
    away = mesh.X - centre
    inner = np.minimum(np.abs(away), start)
    outer = length * np.expm1((np.abs(away) - inner) / length)
    X = centre + np.sign(away) * (inner + outer)
    return replace(mesh, X=X if mesh.ties is None else mesh.ties @ X)


def contact_radius(press: Press, state: State) -> float:
    """Return the radius [mm] of the circle that has the area of the nodes in contact."""
    return float(np.sqrt(press.area[state.contact_state > 0].sum() / np.pi))


def follow(press: Press, position: tuple[float, float], depths, start: State | None = None) -> list[State]:
    """Return the states at these depths [mm] at a position (x, y) [mm], from touch or from another state."""
    centres = press.indenter.start(*position) - np.outer(depths, [0.0, 0.0, 1.0])
    return list(press.follow(start or press.start(*position), centres))


def _press_flat(mesh: Mesh, middle: float, depths) -> tuple[list[State], Press]:
    """Return the states of a frictionless indentation by the large ball in the middle of a block, and the indentation."""
    settings = Settings(friction=0.0, gap_tolerance=1e-6)
    press = Press(Body(mesh, {"gel": NEO_HOOKE}, BULK_TO_SHEAR), Sphere(RADIUS), settings)
    return follow(press, (middle, middle), depths), press


# --------------------------------------------------------------------------------------- finite strain, what must hold
SKIN = Ogden((85.1168e-3, -0.0020e-3), (2.8991, -8.2915))
WIDTH, POSITION, DEPTHS = 16.0, (10.9, 10.3), (0.4, 0.8, 1.2)  # mm; the place is off every line of symmetry
# Iterated until rounding decides: what is left then is the formulation's own.
ROUNDING = Settings(force_tolerance=1e-11, gap_tolerance=1e-11, volume_tolerance=1e-12)
FRICTIONLESS = replace(ROUNDING, friction=0.0)


BALL_MM = 5.0  # radius of the ball of Sferrazza et al. 2019


def sensor_press(position: tuple[float, float] = POSITION, settings: Settings = ROUNDING) -> Press:
    """Return the indentation of a small two-layer sensor with a wall, off its centre, by a ball."""
    block = Block(WIDTH, WIDTH, (("gel", 3.0), ("skin", 1.0)), wall=1.0)
    mesh = layered_block(block, *position, Sizes(near=1.0, near_radius=2.5, growth=0.3, far=2.0))
    return Press(Body(mesh, {"gel": GEL, "skin": SKIN, "wall": SKIN}, 1000.0), Sphere(BALL_MM), settings)


def balances() -> list[Check]:
    """Return what is left of forces and moments with friction, iterated to rounding."""
    press = sensor_press()
    states = follow(press, POSITION, DEPTHS)
    force = max(force_balance(state) for state in states)
    moment = max(moment_balance(press.body.mesh, state, BALL_MM) for state in states)
    return [
        vanishing("contact plus reaction forces, over the force", "equilibrium", force, 1e-10),
        vanishing("their moment about the ball, over force x radius", "equilibrium", moment, 1e-10),
    ]


def augmentation_independence() -> list[Check]:
    """Return how much nodal forces change when the iteration closes gaps, or stops slips, sixteen times faster."""
    checks = []
    for kind in ("normal", "tangential"):
        name = f"{kind}_augmentation"
        forces = []
        for factor in (0.25, 4.0):
            settings = replace(ROUNDING, **{name: factor * getattr(ROUNDING, name)})
            state = follow(sensor_press(settings=settings), POSITION, DEPTHS)[-1]
            forces.append(state.normal_force + state.friction_force)
        change = np.linalg.norm(forces[1] - forces[0]) / np.linalg.norm(forces[0])
        quantity = f"change of nodal forces with {kind} augmentation x 16, over the force"
        checks.append(vanishing(quantity, "contact without penalty", change, 1e-8))
    return checks


def energy_and_cycle() -> list[Check]:
    """Return d(energy)/d(depth) next to the force, and how well an elastic cycle closes, without friction."""
    press = sensor_press(settings=FRICTIONLESS)
    depth, h = (
        0.805,
        0.004,
    )  # between two events (a node that touches), where the force is smooth in the depth
    before, middle, after = follow(press, POSITION, [0.4, depth - h, depth, depth + h])[1:]
    slope = (after.energy - before.energy) / (2 * h)
    back = follow(press, POSITION, [0.4], start=follow(press, POSITION, [1.2], start=after)[-1])[-1]
    there = follow(press, POSITION, [0.4])[-1]
    force = -middle.force[2]
    opened = float(np.linalg.norm(back.force - there.force) / np.linalg.norm(there.force))
    normals = middle.normal_force, press.body.mesh.X[press.surface] + middle.u[press.surface] - middle.centre
    moment = np.linalg.norm(np.cross(*normals[::-1]).sum(axis=0)) / (force * BALL_MM)
    return [
        # central differences are wrong by h^2 F''/6, about (h/depth)^2 / 6
        relative("d(energy)/d(depth) [N]", "the ball's force", force, slope, 1e-4),
        vanishing("moment of normal forces about the ball, over force x radius", "geometry", moment, 1e-12),
        vanishing("force after an elastic cycle, change over the force", "elasticity", opened, 1e-8),
    ]


def quarter_turn() -> list[Check]:
    """Return how well the indentation at a position turned by 90 degrees gives the force turned by 90 degrees."""
    x, y = POSITION
    turned_position = (WIDTH - y, x)
    force = follow(sensor_press(), POSITION, DEPTHS)[-1].force
    turned = follow(sensor_press(turned_position), turned_position, DEPTHS)[-1].force
    error = np.linalg.norm(turned - [-force[1], force[0], force[2]]) / np.linalg.norm(force)
    quantity = "force with the indentation turned by 90 degrees, over the force"
    return [vanishing(quantity, "symmetry", error, 1e-8)]
