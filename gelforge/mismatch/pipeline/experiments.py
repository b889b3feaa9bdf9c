"""Experiments that would distinguish two surviving effects: what each would show, what it costs, and its expected odds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from gelforge.config import ForceSensor, Study
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.candidates import columns_of
from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.identifiability import Plan, next_experiment
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.evidence.screen import Candidate, Screened
from gelforge.mismatch.model.effect import Context, Curves, Parameter
from gelforge.mismatch.readings.observations import COLUMNS, Observations
from gelforge.mismatch.result.verdict import Amount, NamedEffect, Verdict
from gelforge.mismatch.summary.findings import NINETY

CLEAR_S = 8.0  # between two indentations: the unloading, to the next position and down to the surface
WEIGHTS_N = (0.5, 1.0, 2.0, 5.0)
WEIGHT_S = 20.0  # to put a weight on, read and take it off


def with_experiments(verdict: Verdict, problem: Problem, context: Context) -> Verdict:
    """Return a verdict that also says what recording the same again, and weights, would cost and decide in each group.

    Both are known without a solve; `gelforge mismatch plan` weighs others. Those that are expected to decide come first.
    """
    effects = {effect.name: effect for effect in verdict.effects}
    found = []
    for names in rivals(verdict):
        if of_camera(names):
            continue
        pair = [effects[name] for name in names]
        plans = [again(problem, context, pair), weights(context.study, pair)]
        best = next_experiment(plans, *map(survivor, pair))[0]
        if best.decides:
            found.append(best)
    found.sort(key=lambda experiment: (experiment.cost_s, -(experiment.expected_log_odds or 0.0)))
    return verdict.model_copy(update={"next_experiments": [*found, *verdict.next_experiments]})


def rivals(verdict: Verdict) -> list[tuple[str, str]]:
    """Return the first effect of each group beside every other one that may be there instead."""
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
        effect, amounts = CATALOGUE[one.name], np.array([amount.value for amount in one.amounts])
        columns[one.name] = columns_of(context, effect, one.shape)
        part = Candidate(one.name, one.shape, columns[one.name], effect.prior_sd, np.zeros(len(amounts)))
        directions = problem.errors_of([part], amounts)
        if directions.size:
            errors[one.name] = problem.covariance.errors(directions)
    presses = context.observations.table["press"].nunique()
    return Plan(name, minutes, presses, problem.covariance, columns, errors)


def weights(study: Study, survivors: Sequence[NamedEffect]) -> Plan:
    """Return the plan of dead weights on the force sensor, along z and, turned, along x and y: the gel has no part in it."""
    force = np.array([-w * axis for axis in np.eye(3) for w in WEIGHTS_N])
    R = len(force)
    at = [("weights", f"w{k}", k, 0, "load", WEIGHT_S * k, 1.0, 0.0, 0.0, 1.0, 1.0) for k in range(R)]
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
        columns[effect.name] = columns_of(still, effect, one.shape) if of_sensor else nothing
    name, covariance = "dead weights on the force sensor, along each axis", Covariance(sigma.ravel() ** 2)
    return Plan(name, R * WEIGHT_S / 60, 0, covariance, columns)


def survivor(effect: NamedEffect) -> Screened:
    """Return what a verdict says of an effect as a judged effect; its values are taken as independent."""
    amounts = np.array([amount.value for amount in effect.amounts])
    parameters = CATALOGUE[effect.name].parameters
    sd = np.array([_spread(amount, parameter) for amount, parameter in zip(effect.amounts, parameters)])
    none = np.zeros((0, len(amounts)))
    part = Candidate(effect.name, effect.shape, none, CATALOGUE[effect.name].prior_sd, np.zeros(len(amounts)))
    factor = effect.log_bayes_factor
    return Screened((part,), factor, factor, amounts, np.diag(sd**2), np.zeros(0), 0.0, 0.0)


def _spread(amount: Amount, parameter: Parameter) -> float:
    """Return the standard deviation of a reported value, by a side that its physical range does not cut; else its width."""
    (low, high), value = amount.interval_90, amount.value
    ends = {*parameter.bounds, 0.0} if parameter.sign else {*parameter.bounds}
    sides = [abs(end - value) for end in (low, high) if end not in ends and low <= value <= high]
    return max(sides) / NINETY if sides else parameter.width
