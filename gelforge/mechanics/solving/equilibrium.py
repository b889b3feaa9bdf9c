"""Quasi-static equilibrium of a body pressed by a rigid indenter: mixed Newton iteration along a path of the indenter."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gelforge.mechanics.bodies.body import Body, Response
from gelforge.mechanics.bodies.memory import RememberingBody
from gelforge.mechanics.contact.forces import SLIP, ContactForces
from gelforge.mechanics.contact.state import Settings, State
from gelforge.mechanics.contact.surface import Iterate, SurfaceContact
from gelforge.mechanics.indenters.shapes import Indenter
from gelforge.mechanics.linear.sparse import NotPositiveDefinite
from gelforge.mechanics.solving.corrections import Corrections
from gelforge.mechanics.solving.prediction import extrapolated, slope_of, unknowns

# Constants that steer the iteration change how many steps and factorisations it takes, which benchmarks/cell_cost.py prints,
# and no converged state beyond its tolerances:
STEP_LENGTHS = tuple(0.5**halvings for halvings in range(5))  # of a correction
# Below this residual, and with no node changing between open, stick and slip, the contact's consistent tangent is taken
# (counts: benchmarks/cell_cost.py).
CONSISTENT_RESIDUAL = 2e-2
# Of two residuals in turn: an iteration that wins less is slow (counts: benchmarks/cell_cost.py).
RATE = 0.5
# Below this a symmetric iteration that is slow only creeps to the limit of slipping nodes: the consistent
# tangent ends it. Further from the solution that one cycles between stick and slip, unless no node has changed between
# open, stick and slip in this many iterations (counts: benchmarks/cell_cost.py).
CREEP_RESIDUAL, STEADY = 1e-4, 2
# The linear equations are solved to this share of the residual, and never further than this share of its tolerance
# (counts: benchmarks/cell_cost.py).
LINEAR_SHARE, LINEAR_LEAST = 0.03, 0.02
# The body's tangent of an earlier iterate serves while the residual is this small and each correction with it halves the
# residual at least. A correction from a residual AHEAD leads to one that asks for a tangent: it comes with the forces
# (counts: benchmarks/cell_cost.py).
KEPT_TANGENT, AHEAD = 1e-2, 3e-2
# Nodes that slip, beyond which the first consistent step has a factorisation of its own (counts: benchmarks/cell_cost.py).
MANY_SLIDE = 50
# From this iteration on the weight that decides between stick and slip is halved in each: a step that cycles between them
# comes to rest (counts: benchmarks/cell_cost.py).
PATIENT = 10
# With friction the first step after the first touch is at most this share of the element size, and each further one at most
# twice as long: of a node that touches within a step, only the step before says how it has moved until then
# (docs/decisions/0010-exact-friction.md).
FIRST_STEP = 0.25
# A step that is not to be halved any more may take this many times max_iterations: friction creeps, and gets there
# (tests/mechanics/test_last_steps.py).
PATIENCE = 3
# Of a number of steps: far above the 1e-16 of a double (IEEE 754-2019) and far below a step.
ROUNDING = 1e-9
USUAL = Settings()


class NotConverged(ArithmeticError):
    """A step of the indenter for which no equilibrium was found."""


Watch = Callable[[State, State], None]


class Aim(NamedTuple):
    """Where a step is to end."""

    centre: np.ndarray  # (3,) or (6,) of the indenter [mm, rad]
    halvings: int  # of the step that the path asks for
    time: float | None  # [s], for a body that remembers
    limit: int | None = None  # of iterations


class Press:
    """A body and an indenter; finds equilibrium for positions of the indenter.

    One path at a time: `follow` begins with a factorisation of its own, `step` alone goes on with the last one.
    """

    def __init__(
        self, body: Body, indenter: Indenter, settings: Settings = USUAL, linear_solver: str = "auto"
    ):
        self.body, self.indenter, self.settings = body, indenter, settings
        self.contact = SurfaceContact(body, indenter, settings)
        self.surface, self.area = self.contact.nodes, self.contact.area
        self.corrections = Corrections(body, self.surface, linear_solver)
        self.free = self.corrections.free
        self._tangent_at: Iterate | None = None  # the iterate whose body tangent the values hold

    def start(self, x: float, y: float) -> State:
        """Return the undeformed state with the indenter touching the plane z = 0 at (x, y) [mm]."""
        return self.start_at(self.indenter.start(x, y))

    def start_at(self, centre: np.ndarray) -> State:
        """Return the undeformed state with the indenter at a centre (3,) [mm]."""
        S = len(self.surface)
        u = np.zeros_like(self.body.mesh.X)
        gap = self.contact.gap(u, centre)[0]
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
            memory=self.body.initial if isinstance(self.body, RememberingBody) else None,
        )

    def follow(
        self, start: State, centres: np.ndarray, watch: Watch | None = None, times: np.ndarray | None = None
    ) -> Iterator[State]:
        """Yield the state at each centre (n, 3) [mm] in turn, by the steps of `parts`; a step that fails is halved.

        Centres (n, 6) hold a rotation vector [rad] too: the indenter turns about its centre. watch is called with the
        states before and after every step, halves included. times (n,) [s]: when it is there, for a body that remembers.
        Raises NotConverged, with the position reached, after max_halvings.
        """

        def solved(previous, state, at, aim: Aim) -> State:
            new = self.step(previous, state, aim.centre, time=aim.time, limit=aim.limit)
            if watch is not None:
                watch(state, new)
            return new

        yield from self.follow_aims(start, start.centre, centres, solved, times)

    def follow_aims(
        self,
        start: State,
        begun: np.ndarray,
        centres: np.ndarray,
        solved: Callable[[State | None, State, np.ndarray, Aim], State],
        times: np.ndarray | None = None,
    ) -> Iterator[State]:
        """Yield the state at each centre (n, 3) or (n, 6) [mm] in turn, by the steps of `parts`; halve a step that fails.

        solved(previous, state, at, aim): the state that follows a state, reached by an aim at `at`, at the next aim;
        begun (3,) or (6,): the aim of the start. Raises NotConverged after max_halvings.
        """
        self.corrections.forget()  # a path's result depends on no other path
        length = np.shape(centres)[-1]
        previous, state, at = None, replace(start, centre=padded(start.centre, length)), padded(begun, length)
        ends = [None if times is None else float(times[number]) for number in range(len(centres))]
        for centre, end in zip(np.asarray(centres, dtype=float), ends):
            iterations = factorisations = 0
            began = 0.0 if end is None else state.memory.time
            pending: list[Aim] = []
            for share in self.parts(state, centre - at)[::-1]:
                there = at + share * (centre - at) if share < 1 else centre
                pending.append(Aim(there, 0, None if end is None else began + share * (end - began)))
            while pending:
                aim = pending[-1]._replace(limit=self.iterations_allowed(pending[-1].halvings))
                try:
                    new = solved(previous, state, at, aim)
                except NotConverged as failure:
                    if aim.halvings == self.settings.max_halvings:
                        raise NotConverged(f"{failure}; step halved {aim.halvings} times") from None
                    pending[-1] = Aim(aim.centre, aim.halvings + 1, aim.time)
                    between = None if aim.time is None else (state.memory.time + aim.time) / 2
                    pending.append(Aim((at + aim.centre) / 2, aim.halvings + 1, between))
                    continue
                pending.pop()
                previous, state, at = state, new, aim.centre
                iterations += new.iterations
                factorisations += new.factorisations
            state = replace(state, iterations=iterations, factorisations=factorisations)
            yield state

    def parts(self, state: State, move: np.ndarray) -> list[float]:
        """Return the shares, increasing to 1, of a move (3,) or (6,) [mm, rad] of the indenter at which to stop on the way.

        Without friction only the end matters. With it a step is no longer than longest_step element sizes, and the first
        ones after the first touch grow from FIRST_STEP of one, each by two.
        """
        s, size = self.settings, self.contact.element_size
        length = float(np.linalg.norm(move[:3]) + np.linalg.norm(move[3:]) * self.indenter.size)
        if s.friction == 0 or length == 0:
            return [1.0]
        stops = [1.0]
        if state.contact_pressure.max(initial=0.0) == 0:
            lead = min(max(float(state.gap.min()), 0.0), length)
            while (length * stops[0] - lead) > FIRST_STEP * size * (1 + ROUNDING):
                stops.insert(0, (length * stops[0] + lead) / 2 / length)
        shares, last = [], 0.0
        for stop in stops:
            n = max(1, math.ceil(length * (stop - last) / (s.longest_step * size) - ROUNDING))
            shares += [last + (stop - last) * k / n for k in range(1, n)] + [stop]
            last = stop
        return shares

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
        s, contact, corrections = self.settings, self.contact, self.corrections
        limit = s.max_iterations if limit is None else limit
        if isinstance(self.body, RememberingBody):
            self.body.begin(state.memory, state.memory.time if time is None else time)
        move = contact.step(state, centre)
        ratio = 0.0 if guess else slope_of(previous, state, centre)
        if previous is not None and ratio:
            at = extrapolated(contact, previous, state, ratio, centre)
        else:
            at = contact.begin(*unknowns(guess or state), centre)
        last_contact: np.ndarray | None = None
        last_residual, changes, steady, before = np.inf, 0, 0, corrections.factorisations
        # Where nothing says how the nodes move, those in contact begin as sticking to the indenter, by no weight of slip.
        response = self._evaluate(at, tangent=True)
        forces = contact.forces(at, move, 1.0 if ratio or guess else 0.0)
        for iteration in range(limit + 1):
            residual, slipped = self._residual(response, forces), contact.friction_error(forces)
            penetration = contact.penetration(at)
            volume_error = self.body.pressure_error(response, at.pressure)
            if not np.isfinite(residual):
                raise NotConverged(f"no finite residual at centre {np.round(centre, 4)} mm")
            if (
                iteration > 0
                and max(residual, slipped) < s.force_tolerance
                and penetration < s.gap_tolerance
                and volume_error < s.volume_tolerance
                and changes == 0
                and response.admissible
            ):
                counts = iteration, corrections.factorisations - before
                return self._converged(state, centre, at, response, forces, *counts, residual)
            if iteration == limit:
                break
            settled = last_contact is not None and np.array_equal(forces.state, last_contact)
            steady = steady + 1 if settled and changes == 0 and residual <= last_residual else 0
            # The limit of friction follows the pressure where the contact has come to rest, or the iteration only creeps.
            creeps = residual > RATE * last_residual and (
                residual < CREEP_RESIDUAL or (steady >= STEADY and residual < CONSISTENT_RESIDUAL)
            )
            exact = creeps or (settled and residual < CONSISTENT_RESIDUAL)
            fresh = residual > KEPT_TANGENT or residual > RATE * last_residual
            last_contact, last_residual = forces.state, residual
            # With many nodes sliding, the consistent tangent is far from a factorisation of another place of the indenter.
            many_slide = bool((forces.state == SLIP).sum() > MANY_SLIDE)
            slides = exact and corrections.factorisations == before and many_slide
            self._prepare(at, forces, fresh, slides)
            target = max(LINEAR_SHARE * residual, LINEAR_LEAST * s.force_tolerance) * contact.size_of(forces)
            try:
                du, dp = corrections.correction(at.pressure, response, forces, exact, target)
            except np.linalg.LinAlgError as error:
                raise NotConverged(f"no correction at centre {np.round(centre, 4)} mm: {error}") from None
            weight = 0.5 ** max(0, iteration - PATIENT)
            for length in STEP_LENGTHS:
                trial = contact.corrected(at, forces, du, at.pressure + dp, centre, length)
                trial_response = self._evaluate(trial, tangent=residual > AHEAD)
                trial_forces = contact.forces(trial, move, weight)
                # A consistent step across the limit of friction may overshoot, and cycle with the symmetric ones.
                allowed = max(residual, CREEP_RESIDUAL) if exact else np.inf
                if trial_response.admissible and self._residual(trial_response, trial_forces) < allowed:
                    break  # else the iterate is shortened
            changes = int((trial.active != at.active).sum())
            at, response, forces = trial, trial_response, trial_forces
        extension = response.largest_extension
        reached = (
            f", a point at {extension:.3g} of its constitutive model's limit of extension"
            if extension
            else ""
        )
        raise NotConverged(
            f"no equilibrium at centre {np.round(centre, 4)} mm after {limit} iterations: unbalanced force "
            f"{residual:.1e} and friction {slipped:.1e} of the contact force (limit {s.force_tolerance:.0e}), penetration "
            f"{penetration:.1e} of an element (limit {s.gap_tolerance:.0e}), {changes} nodes still changing contact, "
            f"smallest J {response.smallest_J:.3f}{reached}"
        )

    def _evaluate(self, at: Iterate, tangent: bool = False) -> Response:
        if tangent:
            self._tangent_at = at
            return self.corrections.response(at.u, at.pressure)
        return self.body.response(at.u, at.pressure)

    def _residual(self, response: Response, forces: ContactForces) -> float:
        """Return the norm of the unbalanced forces at the free nodes over that of the contact forces."""
        unbalanced = response.f_mixed.copy()
        unbalanced[self.surface] -= forces.f_mixed
        return float(np.linalg.norm(unbalanced[self.free])) / self.contact.size_of(forces)

    def _prepare(self, at: Iterate, forces: ContactForces, fresh: bool, factor: bool) -> None:
        """See to a tangent, of this iterate if `fresh`, and to a factorisation near enough to it, a new one if `factor`."""
        if fresh and self._tangent_at is not at:
            self._evaluate(at, tangent=True)
        if not (factor or self.corrections.outdated(forces.state)):
            return
        try:
            self.corrections.factor(forces)
        except NotPositiveDefinite as error:
            raise NotConverged(
                f"the tangent is no longer positive definite ({error}); use smaller depth steps or a smaller bulk_to_shear"
            ) from None

    def _converged(
        self,
        old: State,
        centre: np.ndarray,
        at: Iterate,
        response: Response,
        forces: ContactForces,
        iterations: int,
        factorisations: int,
        residual: float,
    ) -> State:
        centre = np.asarray(centre, dtype=float)
        return State(
            centre=centre,
            u=at.u,
            pressure=at.pressure,
            contact_pressure=at.contact_pressure,
            gap=at.gap,
            normal_force=forces.f_mixed - forces.friction,
            friction_force=forces.friction,
            contact_state=forces.state,
            fixed_force=response.f_mixed[self.body.mesh.fixed],
            energy=response.energy,
            iterations=iterations,
            factorisations=factorisations,
            residual=residual,
            smallest_J=response.smallest_J,
            touched=forces.touched,
            travel=centre - padded(old.centre, len(centre)),
            moved=(at.u - old.u)[self.surface],
            memory=self.body.remember(at.u) if isinstance(self.body, RememberingBody) else None,
        )


def padded(centre: np.ndarray, length: int) -> np.ndarray:
    """Return a centre with zeros for the rotation vector where a path has one."""
    return np.concatenate([centre, np.zeros(length - len(centre))])
