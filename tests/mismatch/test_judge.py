"""The ten steps together on ARTIFICIAL readings: forces from formulas, effects at first order, no finite elements."""

from dataclasses import replace

import artificial
import numpy as np
import pytest

from gelforge.config.mismatch import Mismatch
from gelforge.mechanics.equilibrium import NotConverged
from gelforge.mismatch.covariance import readings_covariance
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.findings import _plain, sentence_of
from gelforge.mismatch.judge import judge
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.scan import Finding
from gelforge.mismatch.stage import at_first_order, candidates_of

LOCATED = {"void", "inclusion", "delamination"}
SETTINGS = Mismatch(sites=9, refit_sites=4, rivals=2, draws=1000)


def problem_of(context, left_out=LOCATED):
    """Return the problem of a context: covariance as stated, every effect by its first order."""
    effects = {
        name: effect
        for name, effect in CATALOGUE.items()
        if name not in left_out and effect.to_forces is not None and effect.applies(context.study)
    }
    R = len(context.observations.table)
    covariance = readings_covariance(context, np.zeros((R, 3, 0)), 0.002 * context.force)
    candidates = candidates_of(context, effects, {})
    found = Problem(context.observations, context.force, covariance, candidates, effects, None, {})
    return replace(found, forces_with=at_first_order(found))


def judged(context, **keys):
    problem = problem_of(context, **keys)
    return problem, judge(problem, SETTINGS, seed=1)


def test_nulls_raise_few_alarms():
    """Two tests at 0.01 each: of 40 nulls 0.8 are expected to alarm, and more than 4 in one of 700 such runs."""
    states = [judged(artificial.context(seed, per_side=3))[1].state for seed in range(40)]
    assert sum(state not in ("null", "insufficient") for state in states) <= 4


CASES = [
    ("gel_stiffness", [0.25]),
    ("skin_stiffness", [0.4]),
    ("tilt", [2.0, -1.0]),
    ("misregistration", [0.8, 0.3]),
    ("contact_zero", [0.08]),
    ("cross_talk", [0.0, 0.08, 0.0, -0.06, 0.0, 0.0]),
    ("viscoelastic", [0.3]),
    ("force_hysteresis", [0.15]),
    ("frame_compliance", [0.12]),
    ("thickness_gradient", [0.03, 0.0]),
]


@pytest.mark.parametrize(("name", "amounts"), CASES)
def test_one_effect_is_in_the_group_that_is_told(name, amounts):
    base = artificial.context(7, per_side=3)
    problem, found = judged(artificial.with_effect(base, name, amounts, np.random.default_rng(8)))
    assert found.state in ("named", "group")
    (group,) = found.answer.groups
    assert name in group.members
    assert found.answer.gain.clear
    assert found.state == "group" or group.members[0] == name
    assert "it is explained by" in sentence_of(problem, found)


def test_two_effects_are_both_told():
    base, rng = artificial.context(9, per_side=3), np.random.default_rng(10)
    tilt = CATALOGUE["tilt"].to_forces(base, {}, base.force, np.array([2.5, 0.0]))
    both = CATALOGUE["viscoelastic"].to_forces(base, {"part": "gel", "time_s": 1.0}, tilt, np.array([0.5]))
    _, found = judged(artificial.read(base, both, rng))
    told = {name for group in found.answer.groups for name in group.members}
    assert len(found.answer.fit.parts) >= 2 and {"tilt", "viscoelastic"} <= told


@pytest.mark.parametrize("name", ["tilt", "cross_talk"])
def test_without_the_effect_in_the_catalogue_it_is_open(name):
    """Each of these leaves a lateral pattern that nothing else in the artificial catalogue has."""
    amounts = {"tilt": [3.0, -2.0], "cross_talk": [0, 0.15, 0, -0.1, 0, 0]}[name]
    base = artificial.context(11, per_side=3)
    context = artificial.with_effect(base, name, np.array(amounts, dtype=float), np.random.default_rng(12))
    alike = {"tilt": {"cross_talk", "misregistration"}, "cross_talk": {"tilt"}}[name] | {"thickness_gradient"}
    problem, found = judged(context, left_out=LOCATED | {name} | alike)
    assert found.state == "open"
    assert "no effect of the catalogue explains it" in sentence_of(problem, found)


def test_an_effect_that_cannot_be_solved_gives_way_to_the_next_and_is_told():
    base = artificial.context(13, per_side=3)
    problem = problem_of(artificial.with_effect(base, "gel_stiffness", [0.3], np.random.default_rng(14)))
    first = judge(problem, SETTINGS, seed=1).answer.winner.name

    def stuck(parts, amounts, rows):
        if rows.all() and any(part.name == first for part in parts):
            raise NotConverged("the gel folds")
        return problem.forces_with(parts, amounts, rows)

    found = judge(replace(problem, forces_with=stuck), SETTINGS, seed=1)
    assert first not in [part.name for part in found.answer.winner.parts]
    assert any(first in note and "the gel folds" in note for note in found.notes)


@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        (
            "near (16, 16) mm within 3 mm, share of the force",
            "position",
            "near (16, 16) mm within 3 mm in proportion to the force",
        ),
        ("growing with depth, force along z", "depth", "growing with depth as a force along z"),
        ("depths 1 to 2 mm, share of the force", "depth", "at depths 1 to 2 mm in proportion to the force"),
    ],
)
def test_patterns_are_told_in_words_that_follow_most_clearly(name, kind, words):
    assert _plain(Finding(name, kind, {}, 5.0, 0.1)) == words


def test_one_site_and_one_depth_are_never_named():
    """Nothing can be set aside, so nothing is shown."""
    base = artificial.context(15, per_side=1, depths=(2.0,))
    context = artificial.with_effect(base, "gel_stiffness", [0.8], np.random.default_rng(16))
    down = (context.observations.table["phase"] == "load").to_numpy()
    found = judged(context.chosen(down))[1]
    assert not found.blocks.held_out.any()
    assert found.state in ("insufficient", "open")
