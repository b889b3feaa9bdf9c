"""Problems of the judge on artificial readings: effects at first order, no finite elements."""

from dataclasses import replace
from functools import cache

import artificial
import numpy as np

from gelforge.config.parts.mismatch import Mismatch
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.candidates import candidates_of
from gelforge.mismatch.evidence.covariance import readings_covariance
from gelforge.mismatch.evidence.problem import Problem, at_first_order
from gelforge.mismatch.free_forms import modules_of
from gelforge.mismatch.inference.judge import _state, judge

LOCATED = {"void", "inclusion", "delamination"}
SETTINGS = Mismatch(sites=9, draws=1000)


def problem_of(context, left_out=LOCATED, boxes=()):
    """Return the problem of a context: covariance as stated, every effect by its first order; boxes as of the body map."""
    effects = {
        name: effect
        for name, effect in CATALOGUE.items()
        if name not in left_out and effect.to_forces is not None and effect.applies(context.study)
    }
    R = len(context.observations.table)
    covariance = readings_covariance(context, np.zeros((R, 3, 0)), 0.002 * context.force)
    candidates = candidates_of(context, effects, {})
    found = Problem(
        context.observations, context.force, covariance, candidates, effects, None, {},
        change_error=Mismatch().change_error, modules=modules_of(context, boxes),
    )  # fmt: skip
    return replace(found, forces_with=at_first_order(found))


def judged(context, **keys):
    problem = problem_of(context, **keys)
    return problem, judge(problem, SETTINGS, seed=1)


@cache  # of the process: nothing of it is changed in place
def identified():
    """Return a problem with a tilt in it, its judgement, and a function that puts another answer in its place."""
    base = artificial.context(17, per_side=3)
    problem = problem_of(artificial.with_effect(base, "tilt", [4.0, -3.0], np.random.default_rng(18)))
    found = judge(problem, SETTINGS, seed=1)
    assert found.state == "identified"

    def state(out=False, model=None, **other):
        return _state(found.posterior, replace(found.answer, **other), out, model)

    return problem, found, state
