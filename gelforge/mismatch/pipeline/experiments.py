"""Experimental design: what a plan could detect before it is recorded, and what would distinguish surviving effects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

from gelforge.config import ConfigError, DepthZero, ForceSensor, Study
from gelforge.indentation.planning.plan import plan_cells
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.candidates import columns_of
from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.identifiability import Plan, next_experiment
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.evidence.screen import Candidate, Screened
from gelforge.mismatch.fem.nominal import problem_of, spread
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.model.effect import Context, Curves, Parameter
from gelforge.mismatch.readings.errors import CONTACT_POINT_MM, depth_scatter
from gelforge.mismatch.readings.observations import COLUMNS, Observations, last_moves
from gelforge.mismatch.readings.sessions import SPEED_MM_PER_S
from gelforge.mismatch.result.verdict import NamedEffect, ParameterEstimate, Verdict
from gelforge.mismatch.summary.findings import NINETY, limits_of

CLEAR_S = 8.0  # between two indentations: the unloading, to the next position and down to the surface


def with_experiments(verdict: Verdict, problem: Problem, context: Context) -> Verdict:
    """Return a verdict that also says what recording the same again, and weights, would cost and decide in each group.

    Both are known without a solve; `gelforge mismatch plan` weighs others. Those that are expected to decide come first.
    """
    effects = {effect.name: effect for effect in verdict.effects}
    experiments = []
    for names in rivals(verdict):
        if of_camera(names):
            continue
        pair = [effects[name] for name in names]
        plans = [again(problem, context, pair), weights(context.study, pair)]
        best = next_experiment(plans, *map(survivor, pair))[0]
        if best.decides:
            experiments.append(best)
    experiments.sort(key=lambda experiment: (experiment.cost_s, -(experiment.expected_log_odds or 0.0)))
    return verdict.model_copy(update={"next_experiments": [*experiments, *verdict.next_experiments]})


def rivals(verdict: Verdict) -> list[tuple[str, str]]:
    """Return the first effect of each group next to every other one that may be there instead."""
    return [(group.names[0], other) for group in verdict.answer for other in group.names[1:]]


def of_camera(names: Sequence[str]) -> list[str]:
    """Return the effects of the camera among some: neither indentations nor weights show them."""
    return [name for name in names if CATALOGUE[name].to_forces is None]


def again(problem: Problem, context: Context, survivors: Sequence[NamedEffect]) -> Plan:
    """Return the plan of the very same recording once more."""
    pressed = context.observations.table.groupby("press")["press_time_s"].max()
    minutes = (pressed.sum() + CLEAR_S * len(pressed)) / 60
    return planned("the same recording again", float(minutes), problem, context, survivors)


def planned(
    name: str, minutes: float, problem: Problem, context: Context, survivors: Sequence[NamedEffect]
) -> Plan:
    """Return a plan of indentations by the problem that its readings would pose, with the errors of each effect's change."""
    columns, errors = {}, {}
    for one in survivors:
        effect, theta = CATALOGUE[one.name], np.array([estimate.value for estimate in one.parameters])
        columns[one.name] = columns_of(context, effect, one.hyperparameters)
        part = Candidate(
            one.name, one.hyperparameters, columns[one.name], effect.prior_sd, np.zeros(len(theta))
        )
        directions = problem.errors_of([(part, theta)])
        if directions.size:
            errors[one.name] = problem.covariance.errors(directions)
    presses = context.observations.table["press"].nunique()
    return Plan(name, minutes, presses, problem.covariance, columns, errors)


def weights(study: Study, survivors: Sequence[NamedEffect], each_s: float = 20.0) -> Plan:
    """Return the plan of dead weights on the force sensor, along z and, turned, along x and y: the gel has no part in it.

    each_s: to put one on, read and take it off.
    """
    # N, a usual set (judgement)
    force = np.array([-w * axis for axis in np.eye(3) for w in (0.5, 1.0, 2.0, 5.0)])
    R = len(force)
    at = [("weights", f"w{k}", k, 0, "load", each_s * k, 1.0, 0.0, 0.0, 1.0, 1.0) for k in range(R)]
    table = pd.DataFrame(at, columns=COLUMNS[:11]).reindex(columns=COLUMNS)
    sigma = np.broadcast_to(np.array(ForceSensor().resolution_N) / np.sqrt(12), (R, 3)).copy()
    observations = Observations(
        table, force, np.zeros((1, 2)), sigma, sigma, np.zeros(R), np.full(R, "press")
    )
    flat = Curves((np.array([1.0]),), (np.zeros((1, 3)),))
    still = Context(study, observations, force, flat, {})  # the force is what was put on
    columns = {}
    for one in survivors:
        effect = CATALOGUE[one.name]
        of_sensor = effect.data_entry_error or effect.family == "force sensor"
        nothing = np.zeros((3 * R, len(effect.parameters)))
        columns[effect.name] = columns_of(still, effect, one.hyperparameters) if of_sensor else nothing
    name, covariance = "dead weights on the force sensor, along each axis", Covariance(sigma.ravel() ** 2)
    return Plan(name, R * each_s / 60, 0, covariance, columns)


def survivor(effect: NamedEffect) -> Screened:
    """Return what a verdict says of an effect as a judged effect; its values are taken as independent."""
    theta = np.array([one.value for one in effect.parameters])
    parameters = CATALOGUE[effect.name].parameters
    sd = np.array([_spread(one, parameter) for one, parameter in zip(effect.parameters, parameters)])
    none = np.zeros((0, len(theta)))
    part = Candidate(
        effect.name, effect.hyperparameters, none, CATALOGUE[effect.name].prior_sd, np.zeros(len(theta))
    )
    factor = effect.log_bayes_factor
    return Screened((part,), factor, factor, theta, np.diag(sd**2), np.zeros(0), 0.0, 0.0)


def _spread(one: ParameterEstimate, parameter: Parameter) -> float:
    """Return the standard deviation of a reported value, by a side that its physical range does not cut; else its width."""
    (low, high), value = one.interval_90, one.value
    sides = [abs(end - value) for end in (low, high) if end not in parameter.bounds and low <= value <= high]
    return max(sides) / NINETY if sides else parameter.width


def planned_observations(
    study: Study,
    dwell_s: tuple[float, ...] = (0.5, 0.6, 0.7, 0.8, 0.9),
    ways_up: tuple[float, ...] = (),
    ages_days: tuple[float, ...] = (np.nan,),
) -> Observations:
    """Return the readings that a study's plan would give, force zero: every site to each of its depths in random order.

    Noise is that of a force sensor as the session's defaults describe it, and so is what shares one depth zero; contact
    point's scatter is the study's, or CONTACT_POINT_MM; one session for each age of the sensor.
    """
    cells = list(plan_cells(study).values())
    rng, rows, time = np.random.default_rng([study.seed, 7]), [], 0.0
    presses = [(site, depth) for site, cell in enumerate(cells) for depth in cell.depths_mm]
    for number, age in enumerate(ages_days):
        for order, k in enumerate(rng.permutation(len(presses))):
            site, depth = presses[k]
            arrive = depth / SPEED_MM_PER_S
            course = [("load", arrive, depth), *(("dwell", arrive + s, depth) for s in dwell_s)]
            last = course[-1][1]
            course += [("unload", last + (1 - w) * depth / SPEED_MM_PER_S, w * depth) for w in ways_up]
            for phase, at, d in course:
                rows.append(
                    (f"plan{number}", f"plan{number}/p{order:05d}", order, site, phase, time + at, at,
                     cells[site].x_mm, cells[site].y_mm, d, depth, age, np.nan)
                )  # fmt: skip
            time += course[-1][1] + CLEAR_S
    table = pd.DataFrame(rows, columns=COLUMNS)
    sigma = np.array(ForceSensor().resolution_N) / np.sqrt(12)
    R = len(table)
    press_depth, session_depth = depth_scatter(DepthZero(), study.mismatch.contact_point_scatter_mm)
    noise = np.broadcast_to(sigma, (R, 3)).copy()
    sites = np.array([[cell.x_mm, cell.y_mm] for cell in cells])
    observations = Observations(
        table,
        np.zeros((R, 3)),
        sites,
        noise,
        noise / np.sqrt(3),
        np.full(R, press_depth),
        np.full(R, CONTACT_POINT_MM if np.isnan(session_depth) else session_depth),
        came_along=np.concatenate(
            [last_moves(session) for _, session in table.groupby("session", sort=False)]
        ),
    )
    return spread(observations, study)


def planned_problem(solver: Solver) -> Problem:
    """Return the problem that the readings of the study's plan would pose.

    Parameters
    ----------
    solver : Solver
        Of the study.

    Returns
    -------
    Problem
        With forces of zero and the noise of a force sensor.
    """
    return problem_of(solver, planned_observations(solver.study), recorded=False)[0]


def limits_table(problem: Problem) -> pd.DataFrame:
    """Return per effect and parameter the smallest value that planned readings would show, next to a plausible one.

    Parameters
    ----------
    problem : Problem
        As of `planned_problem`.

    Returns
    -------
    pandas.DataFrame
        Values in the parameter's unit; detectable is infinite where no value shows.
    """
    rows = [
        (one.effect, one.parameter, one.unit, one.value or np.inf, one.plausible, one.seen)
        for one in limits_of(problem)
    ]
    columns = ["effect", "parameter", "unit", "detectable", "plausible", "plausible_value_seen"]
    return pd.DataFrame(rows, columns=columns).sort_values(["effect", "parameter"], ignore_index=True)


def visibility_table(solver: Solver) -> pd.DataFrame:
    """Return for each experiment its cost, how many values of effects it would show if plausible, and which ones newly.

    Newly: the same plan again, added to the first.
    """
    rows, first = [], None
    for name, observations in variants_of(solver.study).items():
        limits = limits_table(problem_of(solver, observations, recorded=False)[0])
        seen = limits[limits["plausible_value_seen"]]
        names = set(seen["effect"] + " " + seen["parameter"])
        first = names if first is None else first
        rows.append((name, _minutes(observations), len(names), ", ".join(sorted(names - first))))
    return pd.DataFrame(rows, columns=["experiment", "minutes", "plausible_values_seen", "seen_newly"])


def experiments_table(solver: Solver, verdict: Verdict) -> pd.DataFrame:
    """Return for each experiment its cost and the expected log odds of the right one of two surviving effects.

    Where the readings could not show enough to leave any: what each experiment would show (`visibility_table`).

    Parameters
    ----------
    solver : Solver
        Of the study.
    verdict : Verdict
        Of its recordings.

    Returns
    -------
    pandas.DataFrame
        A row for each experiment and pair; cost in minutes.

    Raises
    ------
    ConfigError
        For a verdict with nothing left to distinguish, or with effects of the camera alone.
    """
    effects = {effect.name: effect for effect in verdict.effects}
    pairs = rivals(verdict)
    if not pairs and verdict.state == "inconclusive":
        return visibility_table(solver)
    if not pairs:
        raise ConfigError(
            f"the verdict is {verdict.state} and leaves no two effects that cannot be distinguished; nothing is to"
            " be decided"
        )
    seen_alone = {name for pair in pairs for name in of_camera(pair)}
    pairs = [pair for pair in pairs if not of_camera(pair)]
    if not pairs:
        reported = "; ".join(f"{name}: {CATALOGUE[name].separated_by}" for name in sorted(seen_alone))
        raise ConfigError(f"no indentation shows what the camera alone sees ({reported})")
    plans = list(plans_of(solver, [effects[name] for pair in pairs for name in pair]))
    rows = [
        (f"{first} or {second}", one.words, (one.cost_s or 0.0) / 60, one.expected_log_odds, one.decides)
        for first, second in pairs
        for one in next_experiment(plans, survivor(effects[first]), survivor(effects[second]))
    ]
    columns = ["tells apart", "experiment", "minutes", "expected_log_odds", "decides"]
    return pd.DataFrame(rows, columns=columns)


def variants_of(study: Study) -> dict[str, Observations]:
    """Return the readings of a study's plan as it is and in other ways, by name."""
    dwells = (1.0, 3.0, 10.0, 30.0, 60.0)  # as long as a laboratory waits at each place (judgement)
    later = 30.0  # days: a silicone that goes on curing has changed (judgement)
    return {
        "the same plan again": planned_observations(study),
        "the same plan, read during unloading too": planned_observations(study, ways_up=(0.75, 0.5, 0.25)),
        f"the same plan with dwells of {dwells[-1]:g} s": planned_observations(study, dwells),
        f"the same plan now and in {later:g} days": planned_observations(study, ages_days=(0.0, later)),
    }


def _minutes(observations: Observations) -> float:
    return float(observations.table["time_s"].max()) / 60


def plans_of(solver: Solver, survivors: list[NamedEffect]) -> Iterator[Plan]:
    """Yield the experiments that this study's sensor and stage allow."""
    names = {effect.name for effect in survivors}
    for name, observations in variants_of(solver.study).items():
        problem, base = problem_of(solver, observations, recorded=False, names=names)
        if names <= {one.name for one in problem.candidates}:
            yield planned(name, _minutes(observations), problem, base.context, survivors)
    yield weights(solver.study, survivors)
