"""Looking ahead: what a plan could detect before it is recorded, and which experiment would tell survivors apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd

from gelforge.config import ConfigError, ForceSensor, Study
from gelforge.indentation.plan import plan_cells
from gelforge.mismatch.context import Context
from gelforge.mismatch.covariance import Covariance, readings_covariance
from gelforge.mismatch.effect import Parameter
from gelforge.mismatch.effects import CATALOGUE, with_taken
from gelforge.mismatch.identifiability import Plan, detection_limits, next_experiment
from gelforge.mismatch.observations import COLUMNS, Observations, last_moves
from gelforge.mismatch.screen import Candidate, Screened
from gelforge.mismatch.sessions import SPEED_MM_PER_S, TOUCHDOWN_MM
from gelforge.mismatch.solutions import Solver
from gelforge.mismatch.solver import Base, base_of
from gelforge.mismatch.stage import candidates_of, columns_of, problem_of, spread_sites
from gelforge.mismatch.verdict import Amount, NamedEffect, Verdict

CLEAR_S = 8.0  # between two presses: the way up, to the next position and down to the surface
DWELL_S = (0.5, 0.6, 0.7, 0.8, 0.9)  # readings beside the images
LONG_DWELL_S = (1.0, 3.0, 10.0, 30.0, 60.0)
WAYS_UP = (0.75, 0.5, 0.25)  # of the press's depth
WEIGHTS_N = (0.5, 1.0, 2.0, 5.0)
NINETY_TO_SIGMA = 2 * 1.6449
LATER_DAYS = 30.0


def planned_observations(
    study: Study,
    dwell_s: tuple[float, ...] = DWELL_S,
    ways_up: tuple[float, ...] = (),
    ages_days: tuple[float, ...] = (np.nan,),
) -> Observations:
    """Return the readings that a study's plan would give, force zero: every cell to each of its depths in random order.

    Noise is that of a force sensor as the session's defaults describe it, touchdown's scatter TOUCHDOWN_MM; one session
    for each age of the sensor.
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
    noise = np.broadcast_to(sigma, (R, 3)).copy()
    sites = np.array([[cell.x_mm, cell.y_mm] for cell in cells])
    found = Observations(
        table,
        np.zeros((R, 3)),
        sites,
        noise,
        noise / np.sqrt(3),
        np.full(R, TOUCHDOWN_MM),
        np.full(R, "press"),
        came_along=np.concatenate([last_moves(own) for _, own in table.groupby("session", sort=False)]),
    )
    return spread_sites(found, study)


def limits_table(solver: Solver) -> pd.DataFrame:
    """Return per effect and parameter the smallest amount that the study's plan would show, beside a plausible one."""
    problem, _ = problem_of(solver, planned_observations(solver.study), recorded=False)
    rows = []
    for limit in detection_limits(problem.covariance, problem.candidates):
        parameter = CATALOGUE[limit.name].parameters[limit.parameter]
        rows.append(
            (
                limit.name,
                parameter.name,
                parameter.unit,
                limit.amount,
                parameter.width,
                limit.amount <= parameter.width,
            )
        )
    columns = ["effect", "parameter", "unit", "detectable", "plausible", "plausible_amount_seen"]
    return pd.DataFrame(rows, columns=columns).sort_values(["effect", "parameter"], ignore_index=True)


def experiments_table(solver: Solver, verdict: Verdict) -> pd.DataFrame:
    """Return for each experiment its cost and the log odds that it is expected to give to the right one of two survivors.

    Raises ConfigError for a verdict with nothing left to tell apart.
    """
    effects = {effect.name: effect for effect in verdict.effects}
    pairs = [(g.members[0], other) for g in verdict.answer for other in g.members[1:]]
    if not pairs:
        raise ConfigError(
            f"the verdict is {verdict.state} and leaves no two effects that cannot be told apart; nothing is to be decided"
        )
    plans = list(plans_of(solver, [effects[name] for pair in pairs for name in pair]))
    rows = []
    for first, second in pairs:
        for experiment in next_experiment(plans, _survivor(effects[first]), _survivor(effects[second])):
            rows.append(
                (
                    f"{first} or {second}",
                    experiment.name,
                    experiment.cost,
                    experiment.expected_log_odds,
                    experiment.decides,
                )
            )
    return pd.DataFrame(
        rows, columns=["tells apart", "experiment", "minutes", "expected_log_odds", "decides"]
    )


def plans_of(solver: Solver, survivors: list[NamedEffect]) -> Iterator[Plan]:
    """Yield the experiments that this study's sensor and stage allow."""
    study = solver.study
    variants = {
        "the same plan again": planned_observations(study),
        "the same plan, read on the way up too": planned_observations(study, ways_up=WAYS_UP),
        f"the same plan with dwells of {LONG_DWELL_S[-1]:g} s": planned_observations(study, LONG_DWELL_S),
        f"the same plan now and in {LATER_DAYS:g} days": planned_observations(
            study, ages_days=(0.0, LATER_DAYS)
        ),
    }
    effects = [CATALOGUE[name] for name in {effect.name for effect in survivors}]
    for name, observations in variants.items():
        base = base_of(solver, observations, with_taken(effects))
        failed: dict[str, str] = {}
        known = {c.name for c in candidates_of(base.context, {e.name: e for e in effects}, failed)}
        if {effect.name for effect in survivors} <= known:
            minutes = float(observations.table["time_s"].max()) / 60
            yield Plan(name, minutes, _covariance(base), _columns(base.context, survivors))
    yield _weights(study, survivors)


def _covariance(base: Base) -> Covariance:
    return readings_covariance(base.context, base.law, base.floor, base.alike)


def _columns(context: Context, survivors: list[NamedEffect]) -> dict[str, np.ndarray]:
    return {effect.name: columns_of(context, CATALOGUE[effect.name], effect.shape) for effect in survivors}


def _weights(study: Study, survivors: list[NamedEffect]) -> Plan:
    """Return the plan of dead weights on the force sensor, along z and, turned, along x and y: the gel has no part in it."""
    force = np.array([-w * axis for axis in np.eye(3) for w in WEIGHTS_N])
    R = len(force)
    table = pd.DataFrame(
        [
            ("weights", f"w{k}", k, 0, "load", 20.0 * k, 1.0, 0.0, 0.0, 1.0, 1.0, np.nan, np.nan)
            for k in range(R)
        ],
        columns=COLUMNS,
    )
    sigma = np.broadcast_to(np.array(ForceSensor().resolution_N) / np.sqrt(12), (R, 3)).copy()
    observations = Observations(
        table, force, np.zeros((1, 2)), sigma, sigma, np.zeros(R), np.full(R, "press")
    )
    columns = {}
    for survivor in survivors:
        effect = CATALOGUE[survivor.name]
        if effect.family == "force sensor":
            context = _still(study, observations, force)
            columns[effect.name] = columns_of(context, effect, survivor.shape)
        else:
            columns[effect.name] = np.zeros((3 * R, len(effect.parameters)))
    variance = observations.flat(observations.noise_N**2)
    return Plan(
        "dead weights on the force sensor, along each axis", R * 20.0 / 60, Covariance(variance), columns
    )


def _still(study: Study, observations: Observations, force: np.ndarray) -> Context:
    """Return the context of weights that lie still: the force is what was put on."""
    from gelforge.mismatch.context import Curves

    flat = Curves((np.array([1.0]),), (np.zeros((1, 3)),))
    return replace(Context(study, observations, force, flat, {}), force=force)


def _spread(amount: Amount, parameter: Parameter) -> float:
    """Return the standard deviation of a told amount, by a side that its physical range does not cut; else its width."""
    (low, high), value = amount.interval_90, amount.value
    ends = {*parameter.bounds, 0.0} if parameter.sign else {*parameter.bounds}
    sides = [abs(end - value) for end in (low, high) if end not in ends and low <= value <= high]
    return 2 * max(sides) / NINETY_TO_SIGMA if sides else parameter.width


def _survivor(effect: NamedEffect) -> Screened:
    """Return what a verdict says of an effect as a judged effect; its amounts are taken as independent."""
    amounts = np.array([amount.value for amount in effect.amounts])
    parameters = CATALOGUE[effect.name].parameters
    sd = np.array([_spread(amount, parameter) for amount, parameter in zip(effect.amounts, parameters)])
    none = np.zeros((0, len(amounts)))
    part = Candidate(effect.name, effect.shape, none, CATALOGUE[effect.name].widths, np.zeros(len(amounts)))
    return Screened(
        (part,),
        effect.log_bayes_factor,
        effect.log_bayes_factor,
        amounts,
        np.diag(sd**2),
        np.zeros(0),
        0.0,
        0.0,
    )
