"""The ten steps together on ARTIFICIAL readings: forces from formulas, effects at first order, no finite elements."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from artificial_problem import LOCATED, SETTINGS, judged, named, problem_of
from numpy.testing import assert_allclose

from gelforge.mechanics.equilibrium import NotConverged
from gelforge.mismatch.alternatives import Alternatives, normalised
from gelforge.mismatch.confirmation import told_of
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.groups import grouped
from gelforge.mismatch.holdout import Gain
from gelforge.mismatch.identifiability import RIVAL, group_of_winner
from gelforge.mismatch.judge import judge
from gelforge.mismatch.problem import PLACE_ERROR
from gelforge.mismatch.refit import refitted
from gelforge.mismatch.remains import Remains
from gelforge.mismatch.scan import Finding
from gelforge.mismatch.screen import screened
from gelforge.mismatch.stage import noise_case
from gelforge.mismatch.weighing import weighed
from gelforge.mismatch.words import plain, sentence_of


@pytest.mark.thorough
def test_nulls_raise_few_alarms():
    """Four tests at 0.01 each, two of them bounds: of 40 nulls 0.8 to 1.6 are expected to alarm, and more than 4 seldom."""
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
    ("force_hysteresis", [0.0, 0.0, 0.15]),
    ("frame_compliance", [0.12]),
    ("thickness_gradient", [0.03, 0.0]),
]


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize(("name", "amounts"), CASES)
def test_one_effect_is_in_the_group_that_istold_of(name, amounts):
    base = artificial.context(7, per_side=3)
    problem, found = judged(artificial.with_effect(base, name, amounts, np.random.default_rng(8)))
    assert found.state in ("named", "group")
    (group,) = found.answer.groups
    assert name in group.members
    assert found.answer.gain.clear
    assert found.state == "group" or group.members[0] == name
    assert "it is explained by" in sentence_of(problem, found)


@pytest.mark.thorough
def test_two_effects_are_bothtold_of():
    base, rng = artificial.context(9, per_side=3), np.random.default_rng(10)
    tilt = CATALOGUE["tilt"].to_forces(base, {}, base.force, np.array([2.5, 0.0]))
    both = CATALOGUE["viscoelastic"].to_forces(base, {"part": "gel", "time_s": 1.0}, tilt, np.array([0.5]))
    _, found = judged(artificial.read(base, both, rng))
    told = {name for group in found.answer.groups for name in group.members}
    assert len(found.answer.fit.parts) >= 2 and {"tilt", "viscoelastic"} <= told


@pytest.mark.thorough
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


@pytest.mark.thorough
def test_an_effect_that_cannot_be_solved_gives_way_to_the_next_and_istold_of():
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
    assert plain(Finding(name, kind, {}, 5.0, 0.1)) == words


@pytest.mark.thorough
def test_an_answer_that_the_readings_set_aside_refute_is_open_where_something_is_certainly_there():
    problem, found, state = named()
    # 10 standard errors: a true answer gains 50 give or take 10
    assert [state(gain=Gain(total, 10.0, 3)) for total in (25.0, 15.0, -5.0)] == ["named", "open", "open"]
    assert [state(p=5e-3, gain=Gain(total, 10.0, 3)) for total in (15.0, -5.0)] == ["insufficient"] * 2
    refuted = replace(found.answer, gain=Gain(-5.0, 10.0, 3))
    told = sentence_of(problem, replace(found, state="open", answer=refuted))
    assert "no effect of the catalogue explains it" in told and "refute it" in told


@pytest.mark.thorough
def test_what_an_answer_leaves_with_the_readings_set_aside_may_not_be_certain_either():
    _, found, state = named()
    test, scan = (replace(one, p=5e-4) for one in (found.mismatch.test, found.mismatch.scan))
    assert state(everywhere=Remains(test, scan)) == "open"
    assert state(p=5e-3, everywhere=Remains(test, scan)) == "named"


def test_an_exact_twin_of_an_effect_that_errs_is_not_named_for_that():
    """On the artificial base a tilt and cross-talk are one; the error of the tilt's change alone must not decide."""
    base = artificial.context(1, per_side=3)
    problem = problem_of(artificial.with_effect(base, "tilt", [2.0, -1.0], np.random.default_rng(2)))
    every = np.ones(len(problem.labels), bool)
    ranked = [
        one for one in weighed(problem, every, problem.candidates) if one.name in ("tilt", "cross_talk")
    ]
    tilt = next(one for one in ranked if one.name == "tilt")
    assert tilt.error_cost < -0.3 and next(one for one in ranked if one.name == "cross_talk").error_cost == 0
    chances = normalised({one.name: one.log_bayes_factor for one in ranked})
    alternatives = Alternatives({}, len(ranked)).joined(ranked)
    group = grouped(ranked, problem.covariance, alternatives)
    assert set(group.members) == {"tilt", "cross_talk"}
    assert group.odds < group_of_winner(ranked, problem.covariance, chances).odds


def test_what_shapes_and_scales_have_cost_is_paid_on():
    """A second effect that does nothing has no more evidence than the first one alone, whatever was chosen for that."""
    base = artificial.context(23, per_side=3)
    problem = problem_of(artificial.with_effect(base, "viscoelastic", [0.3], np.random.default_rng(24)))
    every = np.ones(len(problem.labels), bool)
    first = next(one for one in weighed(problem, every, problem.candidates) if one.name == "viscoelastic")
    assert first.paid < -1  # three times and two parts, three scales
    drift = next(one for one in problem.candidates if one.name == "force_drift")
    nothing = replace(drift, columns=1e-9 * drift.columns)
    others = replace(problem, candidates=[*(c for c in problem.candidates if c is not drift), nothing])
    (second,) = weighed(others, every, [nothing], first.parts, first.paid)
    assert second.log_bayes_factor == pytest.approx(
        first.log_bayes_factor, abs=0.2
    )  # the order of their two errors
    fit = refitted(problem, first, every)
    free = refitted(problem, replace(first, best_log_bayes_factor=first.log_bayes_factor), every)
    assert fit.log_bayes_factor - free.log_bayes_factor == pytest.approx(first.paid)


@pytest.mark.thorough
def test_a_group_that_is_less_likely_than_not_is_no_answer():
    _, found, state = named()
    (group,) = found.answer.groups
    two = replace(group, members=(*group.members, "yaw"), odds=3.0)
    states = [state(groups=(replace(two, probability=p),)) for p in (0.8, 0.3)]
    assert states == ["group", "insufficient"]


@pytest.mark.thorough
def test_what_is_sure_is_named_whichever_effect_takes_up_the_little_beside_it():
    problem, found, state = named()
    (group,) = found.answer.groups
    little = replace(group, members=("clock_offset",), probability=0.2)
    assert state(groups=(group, little)) == "named"
    assert state(groups=(group, replace(little, probability=0.7))) == "named"  # likely, but not sure
    assert state(groups=(replace(group, probability=0.8), little)) == "insufficient"  # nothing is
    assert state(groups=(replace(group, members=(*group.members, "yaw"), odds=3.0), little)) == "group"
    (part,), (amounts,) = found.answer.fit.parts, found.answer.fit.amounts
    fit = replace(
        found.answer.fit, parts=(part, replace(part, name="clock_offset")), amounts=(amounts, amounts[:1])
    )
    final = replace(found.answer.final, fit=fit)
    both = replace(found, answer=replace(found.answer, fit=fit, final=final, groups=(group, little)))
    assert both.told == (group,) and both.unnamed == (little,)
    assert noise_case(problem, both, 1.0).beside == ["clock_offset"]
    assert "beside something that these readings cannot name (clock offset fits)" in sentence_of(
        problem, both
    )
    assert replace(both, state="open").told == (group, little)
    assert replace(both, state="insufficient").told == () == replace(both, state="insufficient").unnamed
    assert found.unnamed == ()


@pytest.mark.thorough
def test_where_one_effect_was_refuted_and_none_of_several_is_sure_something_unknown_is_there():
    problem, found, state = named()
    (group,) = found.answer.groups
    unsure = {"groups": (replace(group, probability=0.3),), "after_refuted": True}
    assert [state(p=p, **unsure) for p in (1e-4, 5e-3)] == ["open", "insufficient"]
    assert state(after_refuted=True) == "named"  # a sure answer stays one
    told = sentence_of(problem, replace(found, state="open", answer=replace(found.answer, **unsure)))
    assert "no effect of the catalogue explains it" in told and "refute one effect alone" in told


def test_an_error_of_a_change_is_an_error_of_its_amount():
    base = artificial.context(21, per_side=3)
    problem = problem_of(artificial.with_effect(base, "gel_stiffness", [0.5], np.random.default_rng(22)))
    every = np.ones(len(problem.labels), bool)
    start = next(
        one
        for one in screened(problem.residual, problem.covariance, problem.candidates)
        if one.name == "gel_stiffness"
    )
    fits = [refitted(replace(problem, change_error=e), start, every) for e in (0.0, 0.1)]
    sd = [float(np.sqrt(fit.covariance[0, 0])) for fit in fits]
    added = np.sqrt(sd[1] ** 2 - sd[0] ** 2) / fits[1].amounts[0][0]
    # Of the variance of 10 % a quarter is the same at all depths and places, for pressing and sideways forces on their own:
    # 5 / sqrt(2) % at least, 10 % at most.
    assert 0.035 < added < 0.1
    gains = next(
        one
        for one in screened(problem.residual, problem.covariance, problem.candidates)
        if one.name == "force_gain"
    )
    exact = [refitted(replace(problem, change_error=e), gains, every).covariance for e in (0.0, 0.1)]
    assert np.array_equal(*exact)  # what is not solved does not err


@pytest.mark.parametrize(("name", "share"), [("gel_stiffness", 0.1), ("force_gain", 0.0)])
def test_a_change_errs_by_its_share_at_every_reading(name, share):
    problem = replace(problem_of(artificial.context(19, per_side=3), left_out=set()), change_error=0.1)
    part = next(c for c in problem.candidates if c.name == name)
    amounts = np.full(part.columns.shape[1], 0.3)
    assert_allclose(
        added(problem, part, amounts), (share * part.columns @ amounts) ** 2, rtol=1e-9, atol=1e-15
    )
    none = replace(problem, change_error=0.0)
    assert none.believing([part], amounts) is none


def test_what_was_solved_at_one_place_scales_the_others():
    problem = problem_of(artificial.context(19, per_side=3), left_out=set())
    part, other = [c for c in problem.candidates if c.name == "void"][:2]
    change = problem.forces_with([part], [np.ones(1)], np.ones(len(problem.base), bool)) - problem.base
    seated = problem.seated(part, np.ones(1), problem.base + 0.3 * change)
    for place in (part, other):
        assert_allclose(seated.own(place).columns, 0.3 * place.columns, atol=1e-12)
    gel = next(c for c in problem.candidates if c.name == "gel_stiffness")
    assert seated.own(gel) is gel


def added(problem, part, amounts):
    """Return the variance (n,) that errors of a change add."""
    wider = problem.believing([part], amounts).covariance
    return wider.standard_deviation**2 - problem.covariance.standard_deviation**2


def test_a_defect_errs_by_its_place_too():
    """Towards each place next to its own, by half of the way; none of them lies across."""
    problem = replace(problem_of(artificial.context(19, per_side=3), left_out=set()), change_error=0.1)
    voids = [c for c in problem.candidates if c.name == "void"]
    axes = ("x_mm", "y_mm", "z_mm", "radius_mm")
    part = voids[len(voids) // 4]  # of the middle, of the larger size
    beside = []
    for axis in axes:
        along = [c for c in voids if all(c.shape[k] == part.shape[k] for k in axes if k != axis)]
        for side in (-1, 1):
            away = [(side * (c.shape[axis] - part.shape[axis]), k) for k, c in enumerate(along)]
            nearest = min(((d, k) for d, k in away if d > 0), default=None)
            beside += [along[nearest[1]]] if nearest else []
    assert len(beside) == 5  # four in the plane, and the smaller size
    own = PLACE_ERROR * np.column_stack([part.columns, *(c.columns - part.columns for c in beside)])
    assert_allclose(added(problem, part, np.ones(1)), (own**2).sum(axis=1), rtol=1e-9, atol=1e-15)


def test_a_change_goes_through_what_was_solved():
    """Of two amounts along their own direction; across it the derivative stays."""
    problem = problem_of(artificial.context(19, per_side=3))
    part = next(c for c in problem.candidates if c.name == "tilt")
    amounts = np.array([2.0, -1.0])
    solved = problem.base + 1.3 * (
        problem.forces_with([part], [amounts], np.ones(len(problem.base), bool)) - problem.base
    )
    seated = problem.seated(part, amounts, solved).own(part)
    assert_allclose(seated.columns @ amounts, problem.observations.flat(solved - problem.base), atol=1e-12)
    across = np.array([1.0, 2.0])  # equal widths
    assert_allclose(seated.columns @ across, part.columns @ across, atol=1e-12)
    assert problem.seated(part, 1e-9 * amounts, solved) is problem


@pytest.mark.thorough
def test_the_readings_set_aside_decide_between_effects_that_are_told_apart_by_little():
    """The evidence of refitted effects is that of the training readings and of all others; solved within reach alone."""
    problem, found, _ = named()
    fit = found.answer.fit
    wedge = next(c for c in problem.candidates if c.name == "thickness_gradient")
    none = replace(fit, parts=(wedge,), amounts=(np.zeros(2),), spread=np.eye(2))
    near = {"own": fit, "wedge": replace(none, log_bayes_factor=fit.log_bayes_factor + 1)}
    told, forces = told_of(problem, found.blocks, near)
    assert told["own"] > told["wedge"] and set(forces) == {"own", "wedge"}
    assert told["own"] - fit.log_bayes_factor == pytest.approx(found.answer.gain.total)
    behind = replace(none, spread=np.zeros((2, 2)), log_bayes_factor=fit.log_bayes_factor - RIVAL - 1)
    far = near | {"wedge": behind}
    told, forces = told_of(problem, found.blocks, far)
    assert set(forces) == {"own"}
    # no amount of a wedge changes nothing, and gains nothing
    assert told["wedge"] == pytest.approx(behind.log_bayes_factor)


def test_one_site_and_one_depth_are_never_named():
    """Nothing can be set aside, so nothing is shown."""
    base = artificial.context(15, per_side=1, depths=(2.0,))
    context = artificial.with_effect(base, "gel_stiffness", [0.8], np.random.default_rng(16))
    down = (context.observations.table["phase"] == "load").to_numpy()
    found = judged(context.chosen(down))[1]
    assert not found.blocks.held_out.any()
    assert found.state in ("insufficient", "open")
