"""The fit: the verdict's problem about the present estimate, its MAP fit, and the same again until the step is small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gelforge.calibration.parameters import Free
from gelforge.config import Study
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.evidence.candidates import columns_of
from gelforge.mismatch.evidence.covariance import readings_covariance
from gelforge.mismatch.evidence.problem import Problem, secant
from gelforge.mismatch.evidence.refit import Refitted, refitted
from gelforge.mismatch.evidence.screen import Candidate, Screened, judged_by, terms_of
from gelforge.mismatch.fem.nominal import base_where_solved, with_known
from gelforge.mismatch.fem.solutions import Solver, SolverFailed
from gelforge.mismatch.fem.solver import base_of
from gelforge.mismatch.inference.holdout import split
from gelforge.mismatch.inference.scan import global_test
from gelforge.mismatch.readings.observations import Observations
from gelforge.mismatch.thresholds import FORM_ERRORS
from gelforge.progress import stage

ENOUGH = 0.1  # of a posterior standard deviation: a 90 % interval of 3.3 of them moves by 3 %
MOST = 12  # fits; half of them with derivatives of the coarser mesh
FORM_ERROR = FORM_ERRORS[0]  # of a change of the forces, a share of it
# Of a prior's standard deviation: two thirds of its probability, in which the columns follow the solved forces.
NEAR = 1.0
# Of the force, by a plausible step: a larger change is taken as linear in place of in proportion.
PROPORTIONAL = 3.0


@dataclass(frozen=True, eq=False)
class Linear:
    """The verdict's problem about an estimate, q coordinates less those of the priors' means."""

    at: np.ndarray  # (q,)
    problem: Problem  # forces about the estimate, columns (n, 1) of each parameter
    study: Study  # with the estimate

    @property
    def columns(self) -> np.ndarray:
        """Return the change of the n readings per unit of the coordinates (n, q)."""
        return np.column_stack([part.columns for part in self.problem.candidates])

    def forces(self, a: np.ndarray) -> np.ndarray:
        """Return the forces (R, 3) [N] at coordinates (q,), in proportion where the change is a share of the force.

        A modulus or thickness multiplies the force: over a factor of three that is nearer than a straight line.
        """
        problem = self.problem
        slopes = np.zeros((*problem.base.shape, len(a)))
        slopes[problem.observations.read] = self.columns
        size = np.abs(problem.base)[..., None]
        share = np.divide(slopes, problem.base[..., None], out=np.zeros_like(slopes), where=size > 0)
        grows = (np.abs(share) * self.prior_sd).max(axis=-1) < PROPORTIONAL
        step = a - self.at
        change = np.where(grows, problem.base * np.expm1(np.where(grows, share @ step, 0.0)), slopes @ step)
        return problem.base + change

    def fitted(self, mask: np.ndarray) -> Refitted:
        """Return the MAP fit of the coordinates to the entries (n,) bool.

        Changes of the forces err by their form, as those of the verdict do: in a long step little is asked of what several
        parameters do together, and of a short one the errors are gone.
        """
        far = self._screened(self.problem, mask)
        errors = replace(self.problem, change_error=FORM_ERROR)
        uncertain = errors.with_model_error(terms_of(self.problem.candidates, far.theta - self.at))
        from_means = replace(
            uncertain,
            change_error=0.0,
            base=self.forces(np.zeros(len(self.at))),
            forces_with=lambda terms, rows: self.forces(np.concatenate([a for _, a in terms])),
        )
        return refitted(from_means, self._screened(uncertain, mask), mask)

    def _screened(self, problem: Problem, mask: np.ndarray) -> Screened:
        """Return the coordinates by their columns alone."""
        covariance = problem.covariance.restricted(mask)
        residual = problem.residual + self.columns @ self.at  # of which the coordinates are to explain all
        white = covariance.whiten(np.column_stack([residual, self.columns])[mask])
        return judged_by(white[:, 0], problem.candidates, list(white[:, 1:].T[:, :, None]))

    @property
    def prior_sd(self) -> np.ndarray:
        """Return the priors' standard deviations (q,)."""
        return np.concatenate([part.prior_sd for part in self.problem.candidates])

    def moved(self, at: np.ndarray, base: np.ndarray, study: Study) -> Linear:
        """Return the problem about an estimate near by, whose forces (R, 3) are solved and whose columns follow them.

        The secant makes columns those of the study's mesh, and of the contact over the way: along parameters that make up
        for each other little is left of them, and errors of a coarser mesh are not small next to that.
        """
        problem, step = self.problem, at - self.at
        missing = problem.observations.flat(base - problem.base) - self.columns @ step
        columns = secant(self.columns, missing, step, self.prior_sd)
        pairs = zip(problem.candidates, columns.T)
        parts = [replace(part, columns=column[:, None]) for part, column in pairs]
        return Linear(at, replace(problem, base=base, candidates=parts), study)

    def taught_by(self, other: Linear) -> Linear:
        """Return the problem about the same estimate, with another one's columns."""
        return replace(self, problem=replace(self.problem, candidates=other.problem.candidates))

    def cost(self) -> float:
        """Return minus the log posterior of the estimate, but for a constant that the covariance decides."""
        white = self.problem.covariance.whiten(self.problem.residual)
        return 0.5 * float(white @ white + np.sum((self.at / self.prior_sd) ** 2))

    def left(self, a: np.ndarray) -> np.ndarray:
        """Return what is left of the n readings at coordinates (q,)."""
        return self.problem.observations.flat(self.problem.observations.force - self.forces(a))


@dataclass(frozen=True, eq=False)
class Fit:
    """Calibrated parameters and what the model leaves of the readings with them."""

    free: Sequence[Free]
    a: np.ndarray  # (q,) coordinates less those of the priors' means
    covariance: np.ndarray  # (q, q)
    start: Linear  # about the priors' means
    last: Linear  # about the last estimate that was solved: the step from it is below ENOUGH, or between two refused ones
    solved: int  # estimates
    converged: bool
    block: str  # what is held out: positions, deepest
    held_out: np.ndarray  # (n,) bool
    a_trained: np.ndarray  # (q,) by the other readings
    p: float  # that noise leaves as much

    @property
    def sd(self) -> np.ndarray:
        return np.sqrt(np.diag(self.covariance))

    @property
    def study(self) -> Study:
        """Return the study with the estimates."""
        return _study_at(self.last.study, self.free, self.last.at, self.a)


def calibrated(solver: Solver, observations: Observations, free: Sequence[Free]) -> Fit:
    """Return the free parameters of the solver's study that its observations ask for, by all and without some of them.

    Raises SolverFailed where the study cannot be solved at the priors' means.
    """
    a = np.zeros(len(free))
    given = np.array([one.coordinate(one.start) for one in free])
    study = _study_at(solver.study, free, given, a)
    linear = start = _about(replace(solver, study=study), observations, free, a, first=True)
    observations, every = start.problem.observations, np.ones(len(start.problem.labels), bool)
    across, refused = False, None
    for solved in range(1, MOST + 1):
        fit = linear.fitted(every)
        a = np.concatenate(fit.theta)
        sd = np.sqrt(np.diag(fit.covariance))
        step = a - linear.at
        converged = has_converged(step, sd, refused)
        if converged and refused is not None:  # the estimate is the best that was solved
            a = linear.at
        if across and (converged or solved == MOST):
            break
        if not across and (converged or solved == MOST // 2):
            linear, across, refused = _across(solver, observations, free, linear, sd), True, None
            continue
        values = (f"{one.name} {one.value(x):.4g} {one.kind.unit}" for one, x in zip(free, a))
        stage(f"step {', '.join(values)}")
        reached = _reached(solver, observations, free, linear, a)
        refused = step if np.array_equal(reached.at, linear.at) else None
        linear = reached
    block, held_out = held_out_of(linear.problem, solver.study.seed)
    a_trained = np.concatenate(linear.fitted(~held_out).theta) if held_out.any() else a
    test = global_test(linear.left(a), linear.problem.covariance, linear.columns)
    return Fit(free, a, fit.covariance, start, linear, solved, converged, block, held_out, a_trained, test.p)


def has_converged(step: np.ndarray, sd: np.ndarray, refused: np.ndarray | None) -> bool:
    """Return whether a fit ends: each parameter's step is small, or opposite to the refused step.

    Where a surface begins to slip, the sensitivities of either side point to the other one. Then no step is small, and the
    estimate lies between two that fit no better.

    Parameters
    ----------
    step : numpy.ndarray
        (q,) of the coordinates, from the estimate.
    sd : numpy.ndarray
        (q,), their posterior standard deviations.
    refused : numpy.ndarray or None
        (q,), the step before, if it fitted no better and was not taken.

    Returns
    -------
    bool

    Examples
    --------
    >>> import numpy as np
    >>> has_converged(np.array([0.3, 0.01]), np.ones(2), np.array([-0.4, 0.02]))
    True
    """
    small = np.abs(step) <= ENOUGH * sd
    back = np.zeros(len(step), bool) if refused is None else step * refused < 0
    return bool(np.all(small | back))


def _across(
    solver: Solver, observations: Observations, free: Sequence[Free], linear: Linear, sd: np.ndarray
) -> Linear:
    """Return the problem with columns that are solved differences across a standard deviation (q,) on the study's mesh.

    Those of the coarser mesh err, and where a surface sticks they hold at one coefficient of friction and not close to it:
    an interval is what the forces do over its width. A difference that is not solved leaves its column.
    """
    parts = list(linear.problem.candidates)
    for k, (x, s) in enumerate(zip(linear.at, sd)):
        there = linear.at.copy()
        there[k] -= np.copysign(s, x)  # towards the prior's mean, within the bounds
        study = _study_at(linear.study, free, linear.at, there)
        try:
            change = _forces(replace(solver, study=study), observations) - linear.problem.base
        except SolverFailed:
            continue
        column = linear.problem.observations.flat(change) / (there[k] - x)
        parts[k] = replace(parts[k], columns=column[:, None])
    return replace(linear, problem=replace(linear.problem, candidates=parts))


def held_out_of(problem: Problem, seed: int) -> tuple[str, np.ndarray]:
    """Return the entries (n,) bool of about a quarter of the sites; of few sites those of the deepest quarter of depths."""
    held = split(problem.labels, seed).held
    name = "positions" if held["positions"].any() else "deepest"
    return name, held[name]


def _study_at(study: Study, free: Sequence[Free], now: np.ndarray, then: np.ndarray) -> Study:
    for one, here, there in zip(free, now, then):
        study = one.to_study(study, float(here), float(there))
    return study


def _reached(
    solver: Solver, observations: Observations, free: Sequence[Free], linear: Linear, a: np.ndarray
) -> Linear:
    """Return the problem about an estimate, or as far on the way there as the finite elements reach. Raises SolverFailed."""
    # a step is halved, to a sixteenth, where the finite elements do not reach its end
    for k in range(4):
        there = linear.at + 0.5**k * (a - linear.at)
        study = _study_at(linear.study, free, linear.at, there)
        try:
            if np.all(np.abs(there - linear.at) < NEAR * linear.prior_sd):
                near = linear.moved(there, _forces(replace(solver, study=study), observations), study)
                # A step that fits worse has taught the columns, and is not taken.
                return near if near.cost() <= linear.cost() else linear.taught_by(near)
            return _about(replace(solver, study=study), observations, free, there)
        except (SolverFailed, NotConverged) as failure:
            reason = failure
    raise SolverFailed(f"no step from the last estimate can be solved: {reason}")


def _forces(solver: Solver, observations: Observations) -> np.ndarray:
    """Return the forces (R, 3) [N] of the solver's study at the readings. Raises SolverFailed."""
    return with_known(base_of(solver, observations, ()), solver).context.force


def _about(
    solver: Solver, observations: Observations, free: Sequence[Free], at: np.ndarray, first: bool = False
) -> Linear:
    """Return the verdict's problem with the study's present estimate as nominal model; first: of what can be solved."""
    effects = [one.effect_about(float(x)) for one, x in zip(free, at)]
    solved = base_where_solved if first else base_of
    base = with_known(solved(solver, observations, effects), solver)
    parts = []
    for effect in effects:
        if effect.name in base.failed:
            raise SolverFailed(
                f"{effect.name} has no derivative ({base.failed[effect.name]}); leave it out of --free"
            )
        columns, zero = columns_of(base.context, effect, {}), np.zeros(1)
        parts.append(Candidate(effect.name, {}, columns, effect.prior_sd, zero, form_error=FORM_ERROR))
    covariance = readings_covariance(base.context, base.law, base.floor, base.solution)
    problem = Problem(
        base.context.observations,
        base.context.force,
        covariance,
        parts,
        # as formulas: what a fit varies are these columns, and the solver is asked about the estimate it gives
        {effect.name: replace(effect, by_formula=True) for effect in effects},
        lambda terms, rows: base.context.force,
        base.failed,
    )
    return Linear(at, problem, solver.study)
