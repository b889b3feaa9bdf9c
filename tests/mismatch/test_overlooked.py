"""What the training readings rank low and all readings rank first is refitted too: the deepest presses are set aside."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from test_judge import problem_of

from gelforge.config.mismatch import Mismatch
from gelforge.mismatch.holdout import split
from gelforge.mismatch.judge import judge
from gelforge.mismatch.screen import Candidate

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
