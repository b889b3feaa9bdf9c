"""The same pressed block in FElupe (Dutzler 2023, doi 10.5281/zenodo.4817406): same mesh, laws, bulk moduli; its own code.

FElupe's nearly incompressible solid has a constant pressure and volume ratio per hexahedron and U = K (J - 1)^2 / 2: the
same element as ours, written by others. The ball is its rigid contact with a penalty per node.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import felupe as fem
import numpy as np

from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.meshes.mesh import Mesh

ITERATIONS = 30


class Ball(fem.mechanics.ContactRigidBase):
    """FElupe's contact with a rigid ball about the centre point, as its documentation writes it."""

    def __init__(self, field, points, centerpoint, radius, **keys):
        self.radius = radius
        super().__init__(field, points, centerpoint, **keys)

    def _kinematics(self, dx):
        distance = np.linalg.norm(dx, axis=1)
        normal = dx / distance[:, None]
        turn = (np.eye(3) - normal[:, :, None] * normal[:, None, :]) / distance[:, None, None]
        return distance - self.radius, normal, turn


@dataclass
class Twin:
    """A block in FElupe: one field over all nodes, one solid per region."""

    mesh: Mesh
    field: fem.FieldContainer
    solids: list[fem.SolidBodyNearlyIncompressible]


def twin(mesh: Mesh, laws: dict[str, Ogden], bulk_to_shear: float, centre: np.ndarray | None = None) -> Twin:
    """Return the mesh (no hanging nodes) as FElupe bodies; with centre (3,), that point is added as the last one."""
    points = mesh.X if centre is None else np.vstack([mesh.X, centre])
    whole = fem.RegionHexahedron(fem.Mesh(points, mesh.elements, "hexahedron"))
    whole.mesh.points_without_cells = np.array([], dtype=int)
    field = fem.FieldContainer([fem.Field(whole, dim=3)])
    solids = []
    for r, name in enumerate(mesh.regions):
        part = fem.RegionHexahedron(fem.Mesh(points, mesh.elements[mesh.region == r], "hexahedron"))
        part.mesh.points_without_cells = np.array([], dtype=int)
        bulk = bulk_to_shear * laws[name].shear_modulus
        own = fem.FieldContainer([fem.Field(part, dim=3)])
        solids.append(fem.SolidBodyNearlyIncompressible(material(laws[name]), own, bulk=bulk))
    return Twin(mesh, field, solids)


def material(law: Ogden):
    """Return FElupe's material: its hand-written neo-Hooke where the law is one, else Ogden by automatic differentiation."""
    if law.alpha == (2.0,):
        return fem.NeoHooke(mu=law.shear_modulus)
    from felupe.constitution.tensortrax import Hyperelastic, models  # an optional part of FElupe

    moduli = [m * a / 2 for m, a in zip(law.mu, law.alpha)]  # FElupe's convention is 2 mu / alpha^2
    return Hyperelastic(models.hyperelastic.ogden, mu=moduli, alpha=list(law.alpha))


def internal_forces(block: Twin, u: np.ndarray) -> np.ndarray:
    """Return the nodal internal forces (N, 3) [N] at displacements u (N, 3) [mm], pressures following the volume."""
    force = np.zeros_like(u)
    for solid in block.solids:
        solid.field[0].values[:] = u
        solid.restore(solid.checkpoint(), restore_state=False)
        force += np.asarray(solid.assemble.vector().todense()).reshape(-1, 3)
    return force


def solve_held(
    block: Twin, held: np.ndarray, values: np.ndarray, steps: int = 4, tolerance: float = 1e-9
) -> tuple[np.ndarray, np.ndarray]:
    """Return u (N, 3) and internal forces (N, 3) with nodes held (N,) bool at values (N, 3), reached in steps."""
    field = block.field
    for share in np.linspace(0, 1, steps + 1)[1:]:
        _newton(field, block.solids, held, share * values, tolerance)
    u = field[0].values.copy()
    return u, internal_forces(block, u)


def press_with_penalty(
    block: Twin, radius: float, depths, penalty: float, solver: Callable, tolerance: float
) -> tuple[list[np.ndarray], int]:
    """Return the force (3,) [N] of the ball on the block at each depth [mm], without friction, and the Newton iterations.

    The ball's centre is the last point; penalty [N/mm^3] acts on each node's area. A step that fails is halved.
    """
    mesh, field, N = block.mesh, block.field, len(block.mesh.X)
    top = mesh.surface.top
    contacts = [  # FElupe's penalty is per node: one contact for every area that nodes of an even mesh have
        Ball(
            field, mesh.surface.nodes[top & (mesh.surface.area == area)], N, radius, multiplier=penalty * area
        )
        for area in np.unique(mesh.surface.area[top])
    ]
    items, held = [*block.solids, *contacts], np.append(mesh.fixed, True)
    forces, reached, iterations = [], 0.0, 0
    for depth in depths:
        pending = [depth]
        while pending:
            before, values = [item.checkpoint() for item in items], np.zeros((N + 1, 3))
            start, values[N, 2] = field[0].values.copy(), -pending[-1]
            try:
                iterations += _newton(field, items, held, values, tolerance, solver).iterations
            except fem.NewtonConvergenceError:
                if pending[-1] - reached < depth / 64:
                    raise
                field[0].values[:] = start
                for item, state in zip(items, before):
                    item.field.link(field)
                    item.restore(state)
                pending.append((reached + pending[-1]) / 2)
                continue
            reached = pending.pop()
        total = sum(np.asarray(ball.assemble.vector(field).todense()).reshape(-1, 3) for ball in contacts)
        forces.append(total[N])
    return forces, iterations


def _newton(field, items, held, values, tolerance, solver=None):
    """Bring FElupe's field to equilibrium with FElupe's own Newton iteration."""
    dof = np.arange(3 * len(held)).reshape(-1, 3)
    for item in items:
        item.field.link(field)
    found = fem.newtonraphson(
        x0=field,
        items=items,
        dof0=dof[held].ravel(),
        dof1=dof[~held].ravel(),
        ext0=values[held].ravel(),
        tol=tolerance,
        maxiter=ITERATIONS,
        verbose=0,
        **({} if solver is None else {"solver": solver}),
    )
    field[0].values[:] = found.x[0].values
    return found
