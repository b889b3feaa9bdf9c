"""Quasi-static equilibrium of a body pressed by a rigid indenter: mixed Newton iteration along a path of the indenter."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from gelforge.mechanics.body import NO_TANGENT, Body, Response
from gelforge.mechanics.contact import OPEN, add_node_blocks, adhesive_traction, contact_forces, film_given
from gelforge.mechanics.indenters import Indenter, rotation_of
from gelforge.mechanics.kernels import symmetric_product
from gelforge.mechanics.sparse import DirectSolver, NotPositiveDefinite, direct_solver, refined_solve

STEP_LENGTHS = (1.0, 0.5, 0.25, 0.125, 0.0625)
# A factorisation is kept while the residual is this small and each correction with it halves the residual at least.
CHORD_RESIDUAL = 2e-2
CHORD_RATE = 0.5
# Below this a symmetric iteration that wins less than CHORD_RATE only creeps to the limit of slipping nodes: the consistent
# tangent ends it. Further from the solution that one cycles between stick and slip, unless no node has changed between
# open, stick and slip in this many iterations.
CREEP_RESIDUAL = 1e-4
STEADY = 2
LEAST_FORCE = (
    1e-5  # N; a contact force below this is measured by it: after release there is none, only rounding
)
# A gap below this closes an open node; what lies between is the rounding of a flat face that stands on the surface.
TOUCHES_MM = -1e-12
# A step that is not to be halved any more may take this many times max_iterations: friction creeps, and gets there.
PATIENCE = 3
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
    friction_exponent: float = 0.0  # n of mu (1 + p / friction_pressure)^-n
    friction_pressure: float = 0.01  # MPa
    adhesion_work: float = 0.0  # N/mm, of separation
    adhesion_approach: float = 0.0  # N/mm, before the first touch
    adhesion_range: float = 0.05  # mm
    film_thickness: float = 0.0  # mm, of what gives way between indenter and surface
    film_pressure: float = 0.01  # MPa, at which half of it has


@dataclass(frozen=True)
class State:
    """A converged state (or the undeformed start)."""

    centre: np.ndarray  # (3,) of the indenter [mm], or (6,) with its rotation vector [rad] after it
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
    touched: np.ndarray | None = None  # (S,) bool, nodes that have been in contact; None: none has
    memory: Any = None  # of a body that remembers (mechanics.memory.Memory)

    @property
    def force(self) -> np.ndarray:
        """The total contact force (3,) [N] on the body."""
        return (self.normal_force + self.friction_force).sum(axis=0)

    @property
    def reaction(self) -> np.ndarray:
        """The total force (3,) [N] of the base on the body, summed from internal forces."""
        return self.fixed_force.sum(axis=0)


Watch = Callable[[State, State], None]


class Press:
    """A body and an indenter; finds equilibrium for positions of the indenter."""

    def __init__(
        self, body: Body, indenter: Indenter, settings: Settings = Settings(), linear_solver: str = "auto"
    ):
        self.body, self.indenter, self.settings = body, indenter, settings
        mesh = body.mesh
        self.surface, self.area = mesh.surface.nodes, mesh.surface.area
        self.free = body.pattern.equation >= 0
        self.slots = body.pattern.node_slots(self.surface)
        self.solver: DirectSolver = direct_solver(body.pattern, linear_solver)
        self._values = np.empty(len(body.pattern.indices))

    def start(self, x: float, y: float) -> State:
        """Return the undeformed state with the indenter touching the plane z = 0 at (x, y) [mm]."""
        return self.start_at(self.indenter.start(x, y))

    def start_at(self, centre: np.ndarray) -> State:
        """Return the undeformed state with the indenter at a centre (3,) [mm]."""
        S = len(self.surface)
        u = np.zeros_like(self.body.mesh.X)
        gap = self._gap(u, centre)[0]
        none = np.zeros((S, 3))
        return State(
            centre=centre,
            u=u,
            pressure=np.zeros(len(self.body.mesh.elements)),
            contact_pressure=np.zeros(S),
            gap=gap,
            normal_force=none,
            friction_force=none,
            contact_state=np.zeros(S, np.int8),
            fixed_force=np.zeros((self.body.mesh.fixed.sum(), 3)),
            memory=self.body.initial if self.body.remembers else None,
        )

    def follow(
        self, start: State, centres: np.ndarray, watch: Watch | None = None, times: np.ndarray | None = None
    ) -> Iterator[State]:
        """Yield the state at each centre (n, 3) [mm] in turn; a step that fails is halved.

        Centres (n, 6) hold a rotation vector [rad] too: the indenter turns about its centre. watch is called with the
        states before and after every step, halves included. times (n,) [s]: when it is there, for a body that remembers.
        Raises NotConverged, with the position reached, after max_halvings.
        """
        previous, state = None, replace(start, centre=_padded(start.centre, np.shape(centres)[-1]))
        for number, centre in enumerate(centres):
            iterations = factorisations = 0
            pending = [(np.asarray(centre, dtype=float), 0, None if times is None else float(times[number]))]
            while pending:
                target, halvings, time = pending[-1]
                limit = self.iterations_allowed(halvings)
                try:
                    new = self.step(
                        previous, state, target, limit=limit, **({} if time is None else {"time": time})
                    )
                except NotConverged as failure:
                    if halvings == self.settings.max_halvings:
                        raise NotConverged(f"{failure}; step halved {halvings} times") from None
                    pending[-1] = (target, halvings + 1, time)
                    between = None if time is None else (state.memory.time + time) / 2
                    pending.append(((state.centre + target) / 2, halvings + 1, between))
                    continue
                pending.pop()
                if watch is not None:
                    watch(state, new)
                previous, state = state, new
                iterations += new.iterations
                factorisations += new.factorisations
            state = replace(state, iterations=iterations, factorisations=factorisations)
            yield state

    def iterations_allowed(self, halvings: int) -> int:
        """Return how many iterations a step may take that has been halved so often: the last one has more patience."""
        s = self.settings
        return s.max_iterations * (PATIENCE if halvings == s.max_halvings else 1)

    # ------------------------------------------------------------------------------------------ one step
    def step(
        self,
        previous: State | None,
        state: State,
        centre: np.ndarray,
        guess: State | None = None,
        time: float | None = None,
        limit: int | None = None,
    ) -> State:
        """Return the equilibrium with the indenter at centre, from state; previous gives the predictor its slope.

        guess: a state to begin the iteration at instead of the prediction. time [s]: the end of the step, for a body that
        remembers; without, the step takes no time. limit: iterations, max_iterations if not given.
        """
        s = self.settings
        limit = s.max_iterations if limit is None else limit
        if self.body.remembers:
            self.body.begin(state.memory, state.memory.time if time is None else time)
        u, pressure, lam = (
            self._predict(previous, state, centre)
            if guess is None
            else (guess.u.copy(), guess.pressure.copy(), guess.contact_pressure.copy())
        )
        gap, normal, turn = self._gap(u, centre)
        active = (lam > 0) | ((lam == 0) & (gap < TOUCHES_MM))
        lam = np.where(active, lam, 0.0)
        factored_for, last_residual, changes, factorisations = None, np.inf, 0, 0
        last_contact, steady = None, 0
        response, contact = self._evaluate(u, pressure, lam, active, gap, normal, turn, state, centre)
        for iteration in range(limit + 1):
            residual = self._residual(response, contact)
            penetration = float(np.abs(self._closing(gap, lam)[0][active]).max(initial=0.0))
            volume_error = self.body.pressure_error(response, pressure)
            if not np.isfinite(residual):
                raise NotConverged(f"no finite residual at centre {np.round(centre, 4)} mm")
            if (
                iteration > 0
                and residual < s.force_tolerance
                and penetration < s.gap_tolerance
                and volume_error < s.volume_tolerance
                and changes == 0
                and response.admissible
            ):
                return self._converged(
                    centre, u, pressure, lam, gap, response, contact, iteration, factorisations, residual
                )
            if iteration == limit:
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
            same = (
                changes == 0 and residual <= last_residual and np.array_equal(contact["state"], last_contact)
            )
            steady, last_contact = (steady + 1 if same else 0), contact["state"]
            settled = residual < CREEP_RESIDUAL or (steady >= STEADY and residual < CHORD_RESIDUAL)
            creeps = settled and residual > CHORD_RATE * last_residual
            last_residual = residual
            exact = chord or creeps
            du = self._correction(response, contact, consistent=exact)
            new_pressure = self.body.linearised_pressure(response, du)
            new_lam = self._next_pressure(lam, active, gap, normal, du)
            for length in STEP_LENGTHS:
                trial_u = u + length * du
                trial_p = pressure + length * (new_pressure - pressure)
                trial_lam = lam + length * (new_lam - lam)
                trial_gap, normal_at, turn_at = self._gap(trial_u, centre)
                trial_active = np.where(active, trial_lam > 0, trial_gap < TOUCHES_MM)
                trial_lam = np.where(trial_active, trial_lam, 0.0)
                response, contact = self._evaluate(
                    trial_u, trial_p, trial_lam, trial_active, trial_gap, normal_at, turn_at, state, centre
                )
                # A consistent step across the limit of friction may overshoot, and cycle with the symmetric ones.
                allowed = max(residual, CREEP_RESIDUAL) if exact else np.inf
                if response.admissible and self._residual(response, contact) < allowed:
                    break  # else the iterate is shortened
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
            f"no equilibrium at centre {np.round(centre, 4)} mm after {limit} iterations: unbalanced force "
            f"{residual:.1e} of the contact force (limit {s.force_tolerance:.0e}), penetration {penetration:.1e} mm "
            f"(limit {s.gap_tolerance:.0e}), {changes} nodes still changing contact, smallest J {response.smallest_J:.3f}"
            + (
                f", a point at {response.largest_extension:.3g} of its law's limit of extension"
                if response.largest_extension
                else ""
            )
        )

    def _predict(self, previous: State | None, state: State, centre: np.ndarray):
        """Return displacement, element and contact pressures extrapolated along a straight path of the indenter."""
        if previous is None or previous.contact_pressure.max() == 0:
            return state.u.copy(), state.pressure.copy(), state.contact_pressure.copy()
        move, last = centre - state.centre, state.centre - previous.centre
        # The path turns or rests: no slope to follow.
        if move @ last <= 0.999 * np.linalg.norm(move) * np.linalg.norm(last):
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

    def _closing(self, gap: np.ndarray, lam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the gap that contact has to close (S,) [mm], less what a film gives, and the augmentation (S,) [N/mm^3]."""
        s = self.settings
        given, slope = film_given(lam, s.film_thickness, s.film_pressure)
        return gap + given, s.normal_stiffness / (1 + s.normal_stiffness * slope)

    def _next_pressure(self, lam, active, gap, normal, du) -> np.ndarray:
        """Return the contact pressures (S,) [MPa] after a correction du (N, 3), to first order."""
        closing, stiffness = self._closing(gap, lam)
        moved = np.einsum("si,si->s", normal, du[self.surface])
        return np.where(active, lam - stiffness * (closing + moved), 0.0)

    def _carried(self, old: State, centre: np.ndarray) -> np.ndarray:
        """Return the motion (S, 3) or (3,) [mm] since the old state of the indenter's points at the surface nodes."""
        shift = (centre - old.centre)[:3]
        if len(centre) == 3 or np.array_equal(centre[3:], old.centre[3:]):
            return shift
        arm = (self.body.mesh.X + old.u)[self.surface] - old.centre[:3]
        turned = rotation_of(centre[3:]) @ rotation_of(old.centre[3:]).T
        return shift + arm @ (turned - np.eye(3)).T

    def _evaluate(
        self, u, pressure, lam, active, gap, normal, turn, old: State, centre
    ) -> tuple[Response, dict]:
        S = len(self.surface)
        contact = {name: np.empty((S, 3)) for name in ("f_mixed", "f_condensed", "f_consistent", "friction")}
        contact |= {name: np.empty((S, 3, 3)) for name in ("stiffness", "stiffness_consistent")}
        contact["state"] = np.empty(S, np.int8)
        slip = (u - old.u)[self.surface] - self._carried(old, centre)
        closing, stiffness = self._closing(gap, lam)
        contact_forces(
            closing, normal, turn, slip, lam, active, self.area, old.friction_force, old.contact_state == OPEN,
            stiffness, self.settings.tangential_stiffness, self.settings.friction,
            contact["f_mixed"], contact["f_condensed"], contact["f_consistent"], contact["friction"],
            contact["stiffness"], contact["stiffness_consistent"], contact["state"],
            self.settings.friction_exponent, self.settings.friction_pressure,
        )  # fmt: skip
        touches = contact["state"] != OPEN
        contact["touched"] = touches if old.touched is None else touches | old.touched
        if max(self.settings.adhesion_work, self.settings.adhesion_approach) > 0:
            self._adhere(contact, gap, normal, turn, active, old)
        return self.body.response(u, pressure, NO_TANGENT), contact

    def _adhere(self, contact: dict, gap, normal, turn, active, old: State) -> None:
        """Add the cohesive pull to the contact's forces; its tangent is not positive and enters the consistent one only."""
        s = self.settings
        touched = np.zeros(len(gap), bool) if old.touched is None else old.touched
        work = np.where(touched, s.adhesion_work, s.adhesion_approach)
        traction, slope = adhesive_traction(gap, active, work, s.adhesion_range)
        pull = -(self.area * traction)[:, None] * normal
        for name in ("f_mixed", "f_condensed", "f_consistent"):
            contact[name] += pull
        contact["stiffness_consistent"] += (self.area * slope)[:, None, None] * (
            normal[:, :, None] * normal[:, None, :]
        ) + (self.area * traction)[:, None, None] * turn

    def _residual(self, response: Response, contact: dict) -> float:
        """Return the norm of the unbalanced forces at the free nodes over that of the contact forces."""
        unbalanced = response.f_mixed.copy()
        unbalanced[self.surface] -= contact["f_mixed"]
        size = max(np.linalg.norm(contact["f_mixed"]), LEAST_FORCE)
        return float(np.linalg.norm(unbalanced[self.free]) / size)

    def _factor(self, u: np.ndarray, pressure: np.ndarray, contact: dict) -> None:
        response = self.body.response(u, pressure, self._values)
        add_node_blocks(self.slots, contact["stiffness"], self._values)
        self._factored_blocks = contact["stiffness"]
        try:
            self.solver.factor(self._values)
        except NotPositiveDefinite as error:
            raise NotConverged(
                f"the tangent lost its positive definiteness at smallest J {response.smallest_J:.3f} ({error}); smaller "
                "steps of depth or a smaller bulk_to_shear may keep it"
            ) from None

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
            touched=contact["touched"],
            memory=self.body.remember(u) if self.body.remembers else None,
        )


def _padded(centre: np.ndarray, length: int) -> np.ndarray:
    """Return a centre with zeros for the rotation vector where a path has one."""
    return np.concatenate([centre, np.zeros(length - len(centre))])
