"""Quasi-static equilibrium of a body pressed by a rigid indenter: mixed Newton iteration along a path of the indenter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from gelforge.mechanics.body import NO_TANGENT, Body, Response
from gelforge.mechanics.contact import OPEN, add_node_blocks, contact_forces
from gelforge.mechanics.indenters import Sphere
from gelforge.mechanics.kernels import symmetric_product
from gelforge.mechanics.sparse import DirectSolver, NotPositiveDefinite, direct_solver, refined_solve

LEAST_J = 0.05  # an iterate in which an element keeps less of its volume is shortened
STEP_LENGTHS = (1.0, 0.5, 0.25, 0.125, 0.0625)
# A factorisation is kept while the residual is this small and each correction with it halves the residual at least.
CHORD_RESIDUAL = 2e-2
CHORD_RATE = 0.5
# Below this a symmetric iteration that wins less than CHORD_RATE only creeps to the limit of slipping nodes: the consistent
# tangent ends it. Further from the solution that one cycles between stick and slip.
CREEP_RESIDUAL = 1e-4
GMRES_TOLERANCE = 1e-2  # of a correction with the kept factorisation: the next residual is no smaller anyway


class NotConverged(ArithmeticError):
    """A step of the indenter for which no equilibrium was found."""


@dataclass(frozen=True)
class Settings:
    """Constants of the iteration; lengths mm, forces N."""

    friction: float = 0.45
    normal_stiffness: float = 20.0  # N/mm^3
    tangential_stiffness: float = 3.0  # N/mm^3
    force_tolerance: float = 1e-6  # norm of unbalanced over norm of contact forces
    gap_tolerance: float = 1e-4  # mm
    volume_tolerance: float = 1e-6  # error of an element's volume ratio
    max_iterations: int = 40
    max_halvings: int = 4
    initial_normals: bool = False


@dataclass(frozen=True)
class State:
    """A converged state (or the undeformed start)."""

    centre: np.ndarray  # (3,) the indenter [mm]
    u: np.ndarray  # (N, 3) displacement [mm]
    pressure: np.ndarray  # (E,) element pressure [MPa]
    contact_pressure: np.ndarray  # (S,) per undeformed area [MPa]
    gap: np.ndarray  # (S,) [mm]
    normal_force: np.ndarray  # (S, 3) of the indenter on the surface nodes [N]
    friction_force: np.ndarray  # (S, 3) [N]
    contact_state: np.ndarray  # (S,) open, stick, slip
    fixed_force: (
        np.ndarray
    )  # (n_fixed, 3) internal forces at the fixed nodes, the base's forces on the body [N]
    energy: float = 0.0  # mJ
    iterations: int = 0
    factorisations: int = 0
    residual: float = 0.0  # norm of unbalanced over norm of contact forces
    smallest_J: float = 1.0

    @property
    def force(self) -> np.ndarray:
        """The total contact force (3,) [N] on the body."""
        return (self.normal_force + self.friction_force).sum(axis=0)

    @property
    def reaction(self) -> np.ndarray:
        """The total force (3,) [N] of the base on the body, summed from internal forces."""
        return self.fixed_force.sum(axis=0)


class Press:
    """A body and an indenter; finds equilibrium for positions of the indenter."""

    def __init__(
        self, body: Body, indenter: Sphere, settings: Settings = Settings(), linear_solver: str = "auto"
    ):
        self.body, self.indenter, self.settings = body, indenter, settings
        mesh = body.mesh
        self.surface, self.area = mesh.surface.nodes, mesh.surface.area
        self.free = body.pattern.equation >= 0
        self.slots = body.pattern.node_slots(self.surface)
        self.solver: DirectSolver = direct_solver(body.pattern, linear_solver)
        self._values = np.empty(len(body.pattern.indices))

    def start(self, x: float, y: float) -> State:
        """Return the undeformed state with the indenter touching at (x, y) [mm]."""
        centre = self.indenter.start(x, y)
        S = len(self.surface)
        u = np.zeros_like(self.body.mesh.X)
        gap = self._gap(u, centre)[0]
        none = np.zeros((S, 3))
        return State(
            centre=centre,
            u=u,
            pressure=np.zeros(len(self.body.mesh.hexahedra)),
            contact_pressure=np.zeros(S),
            gap=gap,
            normal_force=none,
            friction_force=none,
            contact_state=np.zeros(S, np.int8),
            fixed_force=np.zeros((self.body.mesh.fixed.sum(), 3)),
        )

    def follow(self, start: State, centres: np.ndarray) -> Iterator[State]:
        """Yield the state at each centre (n, 3) [mm] in turn; a step that fails is halved.

        Raises NotConverged, with the position reached, after max_halvings.
        """
        previous, state = None, start
        for centre in centres:
            iterations = factorisations = 0
            pending = [(np.asarray(centre, dtype=float), 0)]
            while pending:
                target, halvings = pending[-1]
                try:
                    new = self.step(previous, state, target)
                except NotConverged as failure:
                    if halvings == self.settings.max_halvings:
                        raise NotConverged(f"{failure}; step halved {halvings} times") from None
                    pending[-1] = (target, halvings + 1)
                    pending.append(((state.centre + target) / 2, halvings + 1))
                    continue
                pending.pop()
                previous, state = state, new
                iterations += new.iterations
                factorisations += new.factorisations
            state = replace(state, iterations=iterations, factorisations=factorisations)
            yield state

    # ------------------------------------------------------------------------------------------ one step
    def step(self, previous: State | None, state: State, centre: np.ndarray) -> State:
        """Return the equilibrium with the indenter at centre, from state; previous gives the predictor its slope."""
        s = self.settings
        u, pressure, lam = self._predict(previous, state, centre)
        gap, normal, turn = self._gap(u, centre)
        active = (lam > 0) | ((lam == 0) & (gap < 0))
        lam = np.where(active, lam, 0.0)
        factored_for, last_residual, changes, factorisations = None, np.inf, 0, 0
        response, contact = self._evaluate(u, pressure, lam, active, gap, normal, turn, state, centre)
        for iteration in range(s.max_iterations + 1):
            residual = self._residual(response, contact)
            penetration = float(np.abs(gap[active]).max(initial=0.0))
            volume_error = self.body.pressure_error(response, pressure)
            if not np.isfinite(residual):
                raise NotConverged(f"no finite residual at centre {np.round(centre, 4)} mm")
            if (
                iteration > 0
                and residual < s.force_tolerance
                and penetration < s.gap_tolerance
                and volume_error < s.volume_tolerance
                and changes == 0
            ):
                return self._converged(
                    centre, u, pressure, lam, gap, response, contact, iteration, factorisations, residual
                )
            if iteration == s.max_iterations:
                break
            chord = (
                factored_for is not None
                and np.array_equal(active, factored_for)
                and residual < CHORD_RESIDUAL
                and residual < CHORD_RATE * last_residual
            )
            if not chord:
                self._factor(u, pressure, contact)
                factored_for, factorisations = active, factorisations + 1
            creeps = residual < CREEP_RESIDUAL and residual > CHORD_RATE * last_residual
            last_residual = residual
            du = self._correction(response, contact, consistent=chord or creeps)
            new_pressure = self.body.linearised_pressure(response, du)
            new_lam = np.where(
                active,
                lam - s.normal_stiffness * (gap + np.einsum("si,si->s", normal, du[self.surface])),
                0.0,
            )
            for length in STEP_LENGTHS:
                trial_u = u + length * du
                trial_p = pressure + length * (new_pressure - pressure)
                trial_lam = lam + length * (new_lam - lam)
                trial_gap, normal_at, turn_at = self._gap(trial_u, centre)
                trial_active = np.where(active, trial_lam > 0, trial_gap < 0)
                trial_lam = np.where(trial_active, trial_lam, 0.0)
                response, contact = self._evaluate(
                    trial_u, trial_p, trial_lam, trial_active, trial_gap, normal_at, turn_at, state, centre
                )
                if response.smallest_J > LEAST_J:
                    break
            changes = int((trial_active != active).sum())
            u, pressure, lam, active, gap, normal = (
                trial_u,
                trial_p,
                trial_lam,
                trial_active,
                trial_gap,
                normal_at,
            )
        raise NotConverged(
            f"no equilibrium at centre {np.round(centre, 4)} mm after {s.max_iterations} iterations: unbalanced force "
            f"{residual:.1e} of the contact force (limit {s.force_tolerance:.0e}), penetration {penetration:.1e} mm "
            f"(limit {s.gap_tolerance:.0e}), {changes} nodes still changing contact, smallest J {response.smallest_J:.3f}"
        )

    def _predict(self, previous: State | None, state: State, centre: np.ndarray):
        """Return displacement, element and contact pressures extrapolated along a straight path of the indenter."""
        if previous is None or previous.contact_pressure.max() == 0:
            return state.u.copy(), state.pressure.copy(), state.contact_pressure.copy()
        move, last = centre - state.centre, state.centre - previous.centre
        if move @ last < 0.999 * np.linalg.norm(move) * np.linalg.norm(
            last
        ):  # the path turns: no slope to follow
            return state.u.copy(), state.pressure.copy(), state.contact_pressure.copy()
        ratio = np.linalg.norm(move) / np.linalg.norm(last)
        return tuple(
            getattr(state, name) + ratio * (getattr(state, name) - getattr(previous, name))
            for name in ("u", "pressure", "contact_pressure")
        )

    def _gap(self, u: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        reference = self.body.mesh.X[self.surface]
        moved = reference + u[self.surface]
        if self.settings.initial_normals:
            moved = np.concatenate([reference[:, :2], moved[:, 2:]], axis=1)
            return self.indenter.vertical_gap(moved, centre)
        return self.indenter.gap(moved, centre)

    def _evaluate(
        self, u, pressure, lam, active, gap, normal, turn, old: State, centre
    ) -> tuple[Response, dict]:
        S = len(self.surface)
        contact = {name: np.empty((S, 3)) for name in ("f_mixed", "f_condensed", "f_consistent", "friction")}
        contact |= {name: np.empty((S, 3, 3)) for name in ("stiffness", "stiffness_consistent")}
        contact["state"] = np.empty(S, np.int8)
        slip = (u - old.u)[self.surface] - (centre - old.centre)
        contact_forces(
            gap, normal, turn, slip, lam, active, self.area, old.friction_force, old.contact_state == OPEN,
            self.settings.normal_stiffness, self.settings.tangential_stiffness, self.settings.friction,
            contact["f_mixed"], contact["f_condensed"], contact["f_consistent"], contact["friction"],
            contact["stiffness"], contact["stiffness_consistent"], contact["state"],
        )  # fmt: skip
        return self.body.response(u, pressure, NO_TANGENT), contact

    def _residual(self, response: Response, contact: dict) -> float:
        """Return the norm of the unbalanced forces at the free nodes over that of the contact forces."""
        unbalanced = response.f_mixed.copy()
        unbalanced[self.surface] -= contact["f_mixed"]
        size = max(np.linalg.norm(contact["f_mixed"]), 1e-12)
        return float(np.linalg.norm(unbalanced[self.free]) / size)

    def _factor(self, u: np.ndarray, pressure: np.ndarray, contact: dict) -> None:
        self.body.response(u, pressure, self._values)
        add_node_blocks(self.slots, contact["stiffness"], self._values)
        self._factored_blocks = contact["stiffness"]
        try:
            self.solver.factor(self._values)
        except NotPositiveDefinite as error:
            raise NotConverged(f"the tangent lost its positive definiteness ({error})") from None

    def _correction(self, response: Response, contact: dict, consistent: bool) -> np.ndarray:
        """Return du (N, 3) of the condensed system: with the symmetric factorisation at hand, or consistent through it."""
        force = response.f_condensed.copy()
        force[self.surface] -= contact["f_consistent" if consistent else "f_condensed"]
        rhs = -force[self.free]
        du = np.zeros_like(force)
        if consistent:
            du[self.free] = self._consistent_solve(
                rhs, contact["stiffness_consistent"] - self._factored_blocks
            )
        else:
            du[self.free], _ = refined_solve(self.solver, self.body.pattern, self._values, rhs, 0.0, 1)
        return self.body.spread(du)

    def _consistent_solve(self, rhs: np.ndarray, blocks: np.ndarray) -> np.ndarray:
        """Return the solution with the factorised tangent plus unsymmetric blocks (S, 3, 3) at the surface nodes."""
        pattern, full = self.body.pattern, np.zeros_like(self.body.mesh.X)
        touched = np.flatnonzero(np.abs(blocks).max(axis=(1, 2)) > 0)
        nodes, blocks = self.surface[touched], blocks[touched]

        def product(x):
            y = np.empty(pattern.size)
            symmetric_product(pattern.indptr, pattern.indices, self._values, x, y)
            full[self.free] = x
            extra = np.zeros_like(full)
            extra[nodes] = np.einsum("sij,sj->si", blocks, full[nodes])
            return y + extra[self.free]

        shape = (pattern.size, pattern.size)
        operator = LinearOperator(shape, product, dtype=float)
        preconditioner = LinearOperator(shape, self.solver.solve, dtype=float)
        solution, _ = gmres(operator, rhs, M=preconditioner, rtol=GMRES_TOLERANCE, restart=20, maxiter=1)
        return solution

    def _converged(
        self, centre, u, pressure, lam, gap, response, contact, iterations, factorisations, residual
    ) -> State:
        return State(
            centre=np.asarray(centre, dtype=float),
            u=u,
            pressure=pressure,
            contact_pressure=lam,
            gap=gap,
            normal_force=contact["f_mixed"] - contact["friction"],
            friction_force=contact["friction"],
            contact_state=contact["state"],
            fixed_force=response.f_mixed[self.body.mesh.fixed],
            energy=response.energy,
            iterations=iterations,
            factorisations=factorisations,
            residual=residual,
            smallest_J=response.smallest_J,
        )
