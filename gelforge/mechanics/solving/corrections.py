"""Newton's corrections of displacements and element pressures: GMRES on the mixed tangent with a kept factorisation.

The factorisation is that of the condensed tangent at an earlier iterate. As an approximate inverse of the condensed tangent
at another iterate it is of no use: a change eps of the coupling between displacements and pressures counts eps sqrt(K/mu).
With the pressures kept as unknowns, and the factorisation applied with the coupling of its own iterate, it is a good one.
Nodes that have changed between open, stick and slip since then enter by Woodbury's formula.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from gelforge.mechanics.bodies.body import Body, Response
from gelforge.mechanics.contact.forces import ContactForces, add_node_blocks
from gelforge.mechanics.linear.krylov import flexible_gmres
from gelforge.mechanics.linear.sparse import direct_solver
from gelforge.mechanics.linear.sparsity import symmetric_product

# Nodes that may have changed between open, stick and slip since the factorisation. Each costs three right-hand sides; this
# many take about as long as a factorisation (docs/decisions/0004-newton-on-the-mixed-tangent.md).
MOST_CHANGED = 30
# Of GMRES in one correction (counts: benchmarks/cell_cost.py).
MOST_STEPS = 25
# Steps of GMRES beyond which the next correction has a factorisation of its own
# (docs/decisions/0004-newton-on-the-mixed-tangent.md).
MANY_STEPS = 14


class Corrections:
    """Solves the linearised equations of a body and of the contact at its surface nodes."""

    def __init__(self, body: Body, surface: np.ndarray, linear_solver: str):
        self.body, self.surface = body, surface
        pattern = body.pattern
        self.solver = direct_solver(pattern, linear_solver)
        self.free = pattern.equation >= 0
        self.factorisations = 0
        self._values = np.empty(len(pattern.indices))  # of the body's tangent
        self._coupling = np.empty(0)  # where that was computed
        self._slots = pattern.node_slots(surface)
        self._equations = pattern.equation[surface]  # (S, 3)
        self._movable = (self._equations >= 0).all(axis=1)
        self._factored: ContactForces | None = None  # the contact at the factorisation
        self._factored_coupling = np.empty(0)
        self._columns: dict[int, np.ndarray] = {}  # by surface node: inverse of the factorised tangent (3, n)
        self._steps = 0  # of the last GMRES
        self._stiffness = body.element_bulk / body.element_volume  # (E,) of an element's volume [N/mm^5]
        # Errors of volumes [mm^3] count as forces by this factor [N/mm^3].
        self._weight = body.element_shear / np.cbrt(body.element_volume)

    def forget(self) -> None:
        """Drop the factorisation: what follows depends on nothing before."""
        self._factored = None

    def outdated(self, state: np.ndarray) -> bool:
        """Return whether a contact state (S,) asks for a factorisation of its own."""
        if self._factored is None or self._steps > MANY_STEPS:
            return True
        return int((state != self._factored.state).sum()) > MOST_CHANGED

    def response(self, u: np.ndarray, pressure: np.ndarray) -> Response:
        """Return the body's response at u (N, 3) [mm] and pressure (E,) [MPa], and take its tangent from now on."""
        response = self.body.response(u, pressure, self._values)
        self._coupling = response.coupling
        return response

    def factor(self, forces: ContactForces) -> None:
        """Factorise the body's tangent with the contact's symmetric one. Raises NotPositiveDefinite."""
        values = self._values.copy()
        add_node_blocks(self._slots, forces.stiffness, values)
        self._factored = None  # of a failure nothing is kept
        self.solver.factor(values)
        self._factored, self._factored_coupling = forces, self._coupling
        self._columns, self._steps = {}, 0
        self.factorisations += 1

    def correction(
        self, pressure: np.ndarray, response: Response, forces: ContactForces, consistent: bool, target: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the corrections of displacements (N, 3) [mm] and of element pressures (E,) [MPa].

        consistent: with the contact's unsymmetric tangent, else with its symmetric one. target: norm [N] of what may be
        left of the linear equations.
        """
        n, kv, weight = self.body.pattern.size, self._stiffness, self._weight
        blocks = forces.stiffness_consistent if consistent else forces.stiffness
        invert = self._inverse(forces, blocks)
        now, held, then = response.coupling, self._coupling, self._factored_coupling
        touched = np.flatnonzero((np.abs(blocks).max(axis=(1, 2)) > 0) & self._movable)
        rows, own_blocks = self._equations[touched], blocks[touched]
        pattern = self.body.pattern

        def product(z: np.ndarray) -> np.ndarray:
            u, p = z[:n], z[n:]
            force = np.empty(n)
            symmetric_product(pattern.indptr, pattern.indices, self._values, u, force)
            force[rows] += np.einsum("sij,sj->si", own_blocks, u[rows])
            growth = self._grown(now, u)
            # The condensed tangent has the pressures of its own iterate, which are taken out.
            if now is held:
                force += self._pushed(now, p - kv * growth)
            else:
                force += self._pushed(now, p) - self._pushed(held, kv * self._grown(held, u))
            return np.concatenate([force, weight * (growth - p / kv)])

        def precondition(r: np.ndarray) -> np.ndarray:
            grown = r[n:] / weight
            u = invert(r[:n] + self._pushed(then, kv * grown))
            return np.concatenate([u, kv * (self._grown(then, u) - grown)])

        force = response.f_mixed.copy()
        force[self.surface] -= forces.f_consistent if consistent else forces.f_condensed
        volume = (response.p_volume - pressure) / kv
        rhs = np.concatenate([-force[self.free], -weight * volume])
        solution, self._steps = flexible_gmres(product, precondition, rhs, target, MOST_STEPS)
        du = np.zeros_like(force)
        du[self.free] = solution[:n]
        return self.body.spread(du), solution[n:]

    def _inverse(self, forces: ContactForces, blocks: np.ndarray):
        """Return the factorised tangent's inverse with the blocks (S, 3, 3) of nodes whose contact state has changed."""
        assert self._factored is not None
        changed = np.flatnonzero((forces.state != self._factored.state) & self._movable).tolist()
        if not changed:
            return self.solver.solve
        self._add_columns([node for node in changed if node not in self._columns])
        columns = np.concatenate([self._columns[node] for node in changed])  # (m, n)
        rows = self._equations[changed].ravel()
        difference = np.zeros((len(rows), len(rows)))
        for k, node in enumerate(changed):
            three = slice(3 * k, 3 * k + 3)
            difference[three, three] = blocks[node] - self._factored.stiffness[node]
        small = columns[:, rows].T.astype(float)
        gain = np.linalg.solve(np.eye(len(rows)) + difference @ small, difference)

        def invert(r: np.ndarray) -> np.ndarray:
            z = self.solver.solve(r)
            return z - (gain @ z[rows]).astype(columns.dtype) @ columns

        return invert

    def _add_columns(self, nodes: list[int]) -> None:
        if not nodes:
            return
        rows = self._equations[nodes].ravel()
        unit = np.zeros((len(rows), self.body.pattern.size), np.float32)
        unit[np.arange(len(rows)), rows] = 1.0
        columns = self.solver.solve_many(unit)
        self._columns |= {node: columns[3 * k : 3 * k + 3] for k, node in enumerate(nodes)}

    def _grown(self, coupling: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the growth (E,) [mm^3] of elements with free displacements (n,)."""
        full = np.zeros(self.free.shape)
        full[self.free] = u
        return _volumes(self.body.mesh.elements, coupling, self.body.spread(full))

    def _pushed(self, coupling: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Return the forces (n,) [N] of element pressures (E,) at the free displacements."""
        full = np.zeros(self.free.shape)
        _push(self.body.mesh.elements, coupling, pressure, full)
        return self.body.gathered(full)[self.free]


@nb.njit(cache=True, fastmath={"reassoc", "contract"})
def _volumes(elements, coupling, u):
    E, A = elements.shape
    growth = np.empty(E)
    for e in range(E):
        s = 0.0
        for a in range(A):
            for i in range(3):
                s += coupling[e, a, i] * u[elements[e, a], i]
        growth[e] = s
    return growth


@nb.njit(cache=True, fastmath={"reassoc", "contract"})
def _push(elements, coupling, pressure, force):
    E, A = elements.shape
    for e in range(E):
        for a in range(A):
            for i in range(3):
                force[elements[e, a], i] += pressure[e] * coupling[e, a, i]
