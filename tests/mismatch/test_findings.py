"""What a verdict says of its errors, its groups and of fits that were cut short, on ARTIFICIAL readings."""

from dataclasses import replace
from types import SimpleNamespace

import artificial
import numpy as np
import pytest
from artificial_problem import SETTINGS, identified, problem_of

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.covariance import readings_covariance
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.inference.judge import judge
from gelforge.mismatch.pipeline.experiments import with_experiments
from gelforge.mismatch.result.verdict import Provenance
from gelforge.mismatch.summary.findings import _noise, effect_entries, located, verdict_of
from gelforge.mismatch.summary.words import uncomputed

PROVENANCE = Provenance(
    sessions={"s1": "0" * 64}, base="artificial", base_sha256="1" * 64, seed=1, draws=1000, versions={}
)


@pytest.mark.parametrize("zero_by", ["press", "session"])
@pytest.mark.parametrize("laws", [0, 2])
def test_the_errors_of_mesh_and_laws_are_told_apart_whoever_shares_depth_zero(zero_by, laws):
    context = artificial.context(per_side=2, sessions=2, zero_by=zero_by)
    directions = context.force[..., None] * np.array([0.03, 0.04])[:laws]
    problem = problem_of(context)
    covariance = readings_covariance(context, directions, 0.002 * context.force)
    noise = _noise(replace(problem, covariance=covariance))
    size = np.sqrt(np.mean(context.force**2, axis=0))
    # 5 % of two directions; rounding of square roots and back. 1e-5: a floor fades where it is as large as the force.
    assert noise.law_N == pytest.approx(0.05 * size if laws else 0 * size, rel=1e-12)
    assert noise.floor_N == pytest.approx(0.002 * size, rel=1e-5)


def answer_of(parts):
    return SimpleNamespace(fit=SimpleNamespace(parts=parts))


def verdict(problem, judgement):
    return verdict_of(problem, judgement, "artificial", True, None, PROVENANCE)


def test_where_a_defect_lies_and_that_a_fit_was_cut_short_are_reported():
    # Where a defect of the answer lies is reported with its layer. The artificial sensor: 4.5 mm of gel, the top of
    # which is 1.5 mm below the surface
    sensor = artificial.study().sensor
    ball = {"x_mm": 7.0, "y_mm": 12.0, "z_mm": -3.0, "radius_mm": 1.2}
    disc = {"x_mm": 5.0, "y_mm": 5.0, "z_mm": -1.5, "radius_mm": 2.1}
    none = np.zeros((0, 1))
    parts = [
        Candidate(n, s, none, [1.0], [1]) for n, s in (("void", ball), ("yaw", {}), ("delamination", disc))
    ]
    found = located(answer_of(parts), sensor)
    assert [(place.x_mm, place.y_mm, place.radius_mm) for place in found] == [
        (7.0, 12.0, 1.2),
        (5.0, 5.0, 2.1),
    ]
    assert [place.layer for place in found] == ["gel", "skin"]
    assert found[0].depth_mm == pytest.approx((1.8, 4.2)) and found[1].depth_mm == pytest.approx((1.5, 1.5))

    # A fit that was cut short is reported
    problem, found, _ = identified()
    assert not any("not final" in said for said in verdict(problem, found).cannot_know)
    moving = replace(found.answer, fit=replace(found.answer.fit, converged=False))
    told = verdict(problem, replace(found, answer=moving))
    assert any("tilt" in said or "cross talk" in said for said in told.cannot_know if "not final" in said)


@pytest.mark.thorough
def test_weights_are_told_to_decide_between_a_gain_and_a_stiffness_with_cost_and_odds():
    base = artificial.context(7, per_side=3)
    context = artificial.read(base, 1.06 * base.force, np.random.default_rng(8))
    problem = problem_of(context)
    told = with_experiments(verdict(problem, judge(problem, SETTINGS, seed=1)), problem, context)
    pair = [e for e in told.next_experiments if set(e.separates) == {"body_stiffness", "force_gain"}]
    assert pair and all("dead weights" in e.words for e in pair)  # the same again tells nothing of the two
    assert pair[0].presses == 0 and pair[0].cost_s > 0 and pair[0].expected_log_odds > np.log(10)


@pytest.mark.parametrize(
    ("p", "words"),
    [(0.5, "only noise remains"), (0.0045, "something small may remain"), (0.002, "something remains")],
)
def test_what_an_answer_leaves_is_reported_below_one_per_cent_and_doubts_it_below_two_per_mille(p, words):
    problem, found, state = identified()
    left = found.answer.adequacy
    left = replace(left, test=replace(left.test, p=0.9), scan=replace(left.scan, p=p))
    now = state(adequacy=left)
    assert now == ("unexplained" if p == 0.002 else "identified")
    said = verdict(problem, replace(found, state=now, answer=replace(found.answer, adequacy=left)))
    assert any(f"p = {p:.2g}" in sentence for sentence in said.cannot_know) == (p == 0.0045)
    assert ("leaves a residual" in said.sentence) == (now == "unexplained")
    assert said.adequacy.words == words


def test_groups_stand_as_they_are_sure_and_amounts_are_those_beside_the_others():
    # Groups stand as they are sure and what is not is said with its probability
    problem, found, _ = identified()
    (group,) = found.answer.groups
    rest = next(name for name in found.posterior.singles if name not in group.members)
    shares = {rest: 0.8, "clock_offset": 0.2}
    other = {"members": [rest], "alternatives": ["clock_offset"], "probability": 0.62, "shares": shares}
    less_probable = group.model_copy(update=other)
    fit, spread = found.answer.fit, np.eye(1)
    single = found.posterior.singles[rest]
    k = len(single.theta)
    spread = np.zeros((len(fit.spread) + k,) * 2)
    spread[: -k or None, : -k or None] = fit.spread
    spread[-k:, -k:] = single.covariance
    fit = replace(
        fit, parts=(*fit.parts, single.parts[0]), theta=(*fit.theta, single.theta), spread=spread,
        columns=np.column_stack([fit.columns, single.parts[0].columns]),
    )  # fmt: skip
    posterior = replace(found.posterior, evidence={**found.posterior.evidence, fit.effects: 1.0})
    answer = replace(found.answer, groups=(less_probable, group), fit=fit)
    said = verdict(problem, replace(found, answer=answer, posterior=posterior))
    assert [one.members for one in said.answer] == [[*group.members], [rest]]
    assert said.answer[1].names == [rest, "clock_offset"] and rest.split("_")[0] not in said.sentence
    assert [effect.name for effect in said.effects[:2]] in (
        [group.members[0], rest],
        [rest, group.members[0]],
    )

    # Values in place of an effect are those next to the others. Of two effects that act together, what may stand in
    # place of one is as large as it is next to the other
    base, rng = artificial.context(9, per_side=3), np.random.default_rng(10)
    tilt = CATALOGUE["tilt"].to_forces(base, {}, base.force, np.array([2.5, 0.0]))
    both = CATALOGUE["viscoelastic"].to_forces(base, {"part": "gel", "time_s": 1.0}, tilt, np.array([0.5]))
    problem = problem_of(artificial.read(base, both, rng))
    found = judge(problem, SETTINGS, seed=1)
    first = next(group for group in found.answer.groups if "tilt" in group.members)
    other = next(name for name in first.members if name != first.members[0])
    said = {effect.name: effect for effect in effect_entries(problem, found)}
    pair = found.answer.fit.effects - {first.members[0]} | {other}
    assert said[other].log_bayes_factor == pytest.approx(
        found.answer.refits[pair].log_bayes_factor
        if pair in found.answer.refits
        else found.posterior.sets[pair].log_bayes_factor
    )


def test_every_effect_has_a_clause_and_what_could_not_be_tried_is_told_once():
    # Every effect has a clause that says what it means
    gel = CATALOGUE["gel_stiffness"]
    assert gel.in_words({}, [0.12]) == "the gel is 12 % stiffer than simulated"
    assert gel.in_words({}, [-0.2]) == "the gel is 20 % softer than simulated"
    assert gel.in_words({}, [0.0]) == "the gel differs in stiffness"
    turned = CATALOGUE["frictionless"]
    assert turned.in_words({"coefficient": 0.0}, [1.0]) == "there is no friction, and the simulation has some"
    assert turned.in_words({"coefficient": 0.5}, [1.0]) == "there is friction, and the simulation has none"
    place = {"x_mm": 7.0, "y_mm": 12.5, "z_mm": -3.0, "radius_mm": 1.2}
    assert CATALOGUE["void"].in_words(place, [1.0]) == "there is a void in the gel near (7, 12.5) mm"

    # What could not be tried is reported once and not of what was tried elsewhere
    reasons = {
        "void@3": "it folds",
        "void": "it folds",
        "yaw": "it folds",
        "gel_stiffness.growth@1": "it snaps",
    }
    problem = SimpleNamespace(candidates=[SimpleNamespace(name="void")], failed=reasons)
    assert uncomputed(problem) == [
        "void (at some of its places or times), yaw could not be tried: it folds",
        "gel_stiffness could not be tried: it snaps",
    ]
