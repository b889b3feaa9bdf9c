"""What the training readings rank low and all readings rank first is refitted too: the deepest presses are set aside."""

from dataclasses import replace

import artificial
import numpy as np
import pandas as pd
import pytest
from artificial_problem import problem_of

from gelforge.config.mismatch import Mismatch
from gelforge.mismatch import confirmation, refits
from gelforge.mismatch.alternatives import effects_of
from gelforge.mismatch.holdout import split
from gelforge.mismatch.judge import judge
from gelforge.mismatch.refit import End, refitted
from gelforge.mismatch.refits import Refits
from gelforge.mismatch.screen import Candidate
from gelforge.mismatch.search import _overlooked
from gelforge.mismatch.weighing import moved, unmasked, weighed

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


@pytest.mark.thorough(but_first=1)
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
        self.parts = (problem().candidates[0],)


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


def test_a_best_one_is_fitted_to_its_end_and_put_where_it_was_not_fitted(monkeypatch):
    """Of one that was broken off and taken for linear the evidence is not its own."""
    found, calls = problem(), []
    blocks = split(found.labels, SEED)
    ranked = weighed(found, blocks.train, found.candidates)
    tried = Refits(found, blocks, [])
    for one in ranked[:2]:
        tried.add(one)
    first, far = list(tried.fits)
    tried.fits[far] = replace(tried.fits[far], end=End.HOPELESS)

    def told_of(problem, blocks, fits, promising):
        calls.append((tuple(promising), fits[far].end))
        forces = {name: problem.base for name in fits if name == first or name in promising}
        return {first: 1.0, far: 2.0}, forces

    monkeypatch.setattr(refits, "told_of", told_of)
    told = tried.told([])
    assert told.best == far and far in told.forces
    assert calls[0] == ((), End.HOPELESS) and calls[1][0] == (far,) and calls[1][1] is not End.HOPELESS


def test_those_far_behind_change_what_was_set_aside_to_first_order():
    """The score is that of the linear change at the fitted amounts."""
    found = problem()
    blocks = split(found.labels, SEED)
    ranked = weighed(found, blocks.train, found.candidates)
    fits = {}
    for one in ranked[:2]:
        fit = refitted(found, unmasked(found, one), blocks.train)
        fits[fit.name] = fit
    first, far = fits
    assert found.solves(fits[far].parts[0]) and np.all(fits[far].amounts[0] != 0)
    fits[far] = replace(fits[far], log_bayes_factor=fits[first].log_bayes_factor - 100.0)
    told, forces = confirmation.told_of(found, blocks, fits)
    left = found.residual - fits[far].parts[0].columns @ fits[far].amounts[0]
    scores = confirmation.scores_of(found, blocks, left, fits[far])
    gained = scores["after"]["score"].sum() - scores["before"]["score"].sum()
    assert far not in forces
    assert told[far] == pytest.approx(fits[far].log_bayes_factor + gained)


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
