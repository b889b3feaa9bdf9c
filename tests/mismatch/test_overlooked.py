"""What the training readings rank low and all readings rank first is refitted too: the deepest presses are set aside."""

from dataclasses import replace

import artificial
import numpy as np
import pandas as pd
import pytest
from artificial_problem import problem_of

from gelforge.config.mismatch import Mismatch
from gelforge.mismatch import confirmation
from gelforge.mismatch.alternatives import effects_of
from gelforge.mismatch.holdout import split
from gelforge.mismatch.judge import judge
from gelforge.mismatch.screen import Candidate
from gelforge.mismatch.search import _overlooked
from gelforge.mismatch.weighing import moved, weighed

SEED, WIDTH = 1, 0.2
# Along three directions that only training readings feel, and one that only those set aside feel. All four of the decoys
# have more of what the training readings show than the truth, and less of the rest.
TRUTH = "wall_stiffness"
PATTERNS = {
    TRUTH: [1.0, 0.0, 0.0, 1.0],
    "gel_stiffness": [1.0, 0.35, 0.0, 0.4],
    "skin_stiffness": [1.0, 0.35, 0.02, 0.4],
    "compressibility": [1.0, 0.35, -0.02, 0.4],
    "law_exponent": [1.0, 0.35, 0.01, 0.4],
}


def problem(amount=0.12, chance=0.065):
    """Return a problem whose truth is an amount of TRUTH, and by chance what looks like the decoys in training."""
    found = problem_of(artificial.context(41, per_side=3))
    train = split(found.labels, SEED).train
    basis = np.zeros((len(found.labels), 4))
    rng = np.random.default_rng(7)
    basis[train, :3], basis[~train, 3] = rng.normal(size=(train.sum(), 3)), rng.normal(size=(~train).sum())
    basis *= 100 / np.linalg.norm(found.covariance.whiten(basis), axis=0)
    candidates = [
        Candidate(name, {}, basis @ np.array(pattern)[:, None], np.array([WIDTH]), np.zeros(1, int))
        for name, pattern in PATTERNS.items()
    ]

    def forces_with(parts, amounts, rows):
        change = sum(a[0] * np.array(PATTERNS[part.name]) for part, a in zip(parts, amounts))
        force = found.base.copy()
        force[found.observations.read] += basis @ change
        return np.where(rows[:, None], force, np.nan)

    force = found.base.copy()
    noise = found.covariance.draw(rng, 1)[:, 0]
    force[found.observations.read] += basis @ (amount * np.array(PATTERNS[TRUTH]) + [0, chance, 0, 0]) + noise
    observations = replace(found.observations, force=force)
    return replace(
        found, observations=observations, candidates=candidates, forces_with=forces_with, change_error=0.0
    )


@pytest.mark.parametrize(("rivals", "found"), [(1, True), (0, False)])
def test_the_answer_of_all_readings_is_refitted(rivals, found):
    """With no refits to spare it cannot be: the answer is then one of the decoys."""
    answer = judge(problem(), Mismatch(sites=9, rivals=rivals, draws=1000), seed=SEED).answer
    tried = {part.name for fit in answer.refits for part in fit.parts}
    assert (TRUTH in tried) == found
    assert (answer.winner.parts[0].name == TRUTH) == found


class Fit:
    """A refit of one part, as far as what is told needs it."""

    def __init__(self, name, evidence):
        self.name, self.log_bayes_factor = name, evidence


def test_what_others_gain_is_not_given_to_those_far_behind(monkeypatch):
    """A promising one has its own gain; so have those farther behind, with a linear change."""
    gains = {"first": 10.0, "promising": 200.0, "far": -3.0}
    table = {name: {"before": table_of(0.0), "after": table_of(own)} for name, own in gains.items()}
    monkeypatch.setattr(confirmation, "forces_of", lambda problem, fit: problem.base)
    monkeypatch.setattr(confirmation, "linear_change", lambda fit: 0.0)
    monkeypatch.setattr(confirmation, "scores_of", lambda problem, blocks, left, fit: table[fit.name])
    fits = {n: Fit(n, e) for n, e in (("first", 100.0), ("far", 94.0), ("promising", 20.0))}
    found = problem()
    told, forces = confirmation.told_of(found, split(found.labels, SEED), fits, ["promising"])
    assert told == {"first": 110.0, "far": 91.0, "promising": 220.0}
    assert set(forces) == {"first", "promising"}


def table_of(score):
    return pd.DataFrame({"score": [score]})


def test_one_that_cannot_be_solved_hides_no_other():
    """The likeliest has been tried in vain; the next one is looked at."""
    found = problem()
    ranked = weighed(found, np.ones(len(found.labels), bool), found.candidates)
    by_name = {one.name: one for one in ranked}
    winner = by_name["gel_stiffness"]
    failed = moved(by_name["skin_stiffness"], 30.0)
    by_all, tried = [winner, failed, by_name[TRUTH]], [effects_of(winner), effects_of(failed)]
    assert _overlooked(by_all, tried, []) is by_name[TRUTH]
    assert _overlooked(by_all, [*tried, effects_of(by_name[TRUTH])], []) is None
