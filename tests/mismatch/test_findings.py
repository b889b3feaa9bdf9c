"""What a verdict says of its errors and of refits that were cut short, on ARTIFICIAL readings."""

from dataclasses import replace
from types import SimpleNamespace

import artificial
import numpy as np
import pytest
from artificial_problem import SETTINGS, problem_of

from gelforge.mechanics.equilibrium import NotConverged
from gelforge.mismatch import search
from gelforge.mismatch.covariance import readings_covariance
from gelforge.mismatch.experiments import with_experiments
from gelforge.mismatch.findings import _noise, located, verdict_of
from gelforge.mismatch.judge import judge
from gelforge.mismatch.remains import remains
from gelforge.mismatch.screen import Candidate
from gelforge.mismatch.verdict import Provenance
from gelforge.mismatch.words import uncomputed

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
    noise = _noise(replace(problem, covariance=covariance), [])
    size = np.sqrt(np.mean(context.force**2, axis=0))
    # 5 % of two directions; rounding of square roots and back. 1e-5: a floor fades where it is as large as the force.
    assert noise.law_N == pytest.approx(0.05 * size if laws else 0 * size, rel=1e-12)
    assert noise.floor_N == pytest.approx(0.002 * size, rel=1e-5)


def stuck_at_first(problem, share):
    """Return forces that are a little less than linear, by a solver that does not get beyond the first amounts."""
    first = {}

    def forces(parts, amounts, rows):
        name = tuple(part.name for part in parts)
        if not np.allclose(np.concatenate(amounts), first.setdefault(name, np.concatenate(amounts))):
            raise NotConverged("the gel folds")
        return problem.forces_with(parts, [share * a for a in amounts], rows)

    return forces


def answer_of(parts):
    return SimpleNamespace(final=SimpleNamespace(fit=SimpleNamespace(parts=parts)))


def test_where_a_defect_of_the_answer_lies_is_told_with_its_layer():
    """The artificial sensor: 4.5 mm of gel, the top of which is 1.5 mm below the surface."""
    sensor = artificial.study().sensor
    ball = {"x_mm": 7.0, "y_mm": 12.0, "z_mm": -3.0, "radius_mm": 1.2}
    disc = {"x_mm": 5.0, "y_mm": 5.0, "z_mm": -1.5, "radius_mm": 2.1}
    none = np.zeros((0, 1))
    parts = [
        Candidate(n, s, none, [1.0], [1]) for n, s in (("void", ball), ("yaw", {}), ("delamination", disc))
    ]
    told = [SimpleNamespace(members=["void", "inclusion"]), SimpleNamespace(members=["yaw", "delamination"])]
    assert [place.layer for place in located(answer_of(parts), sensor, told[:1])] == ["gel"]  # what is told
    found = located(answer_of(parts), sensor, told)
    assert [(place.x_mm, place.y_mm, place.radius_mm) for place in found] == [
        (7.0, 12.0, 1.2),
        (5.0, 5.0, 2.1),
    ]
    assert [place.layer for place in found] == ["gel", "skin"]
    assert found[0].depth_mm == pytest.approx((1.8, 4.2)) and found[1].depth_mm == pytest.approx((1.5, 1.5))


@pytest.mark.thorough
def test_weights_are_told_to_decide_between_a_gain_and_a_stiffness_with_cost_and_odds():
    base = artificial.context(7, per_side=3)
    context = artificial.read(base, 1.06 * base.force, np.random.default_rng(8))
    problem = problem_of(context)
    told = with_experiments(verdict(problem, judge(problem, SETTINGS, seed=1)), problem, context)
    pair = [e for e in told.next_experiments if set(e.separates) == {"body_stiffness", "force_gain"}]
    assert pair and all("dead weights" in e.words for e in pair)  # the same again tells nothing of the two
    assert pair[0].presses == 0 and pair[0].cost_s > 0 and pair[0].expected_log_odds > np.log(10)


def verdict(problem, judgement):
    return verdict_of(problem, judgement, "artificial", True, None, PROVENANCE)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("p", "state", "words"),
    [
        (0.5, "named", "only noise remains"),
        (0.0045, "named", "something small may remain"),
        (0.002, "open", "something remains"),
    ],
)
def test_what_an_answer_leaves_is_told_below_one_per_cent_and_doubts_it_below_two_per_mille(
    monkeypatch, p, state, words
):
    def left(*given):
        found = remains(*given)
        return replace(found, scan=replace(found.scan, p=p))

    monkeypatch.setattr(search, "remains", left)
    base = artificial.context(7, per_side=3)
    problem = problem_of(
        artificial.with_effect(base, "misregistration", [0.8, 0.3], np.random.default_rng(8))
    )
    found = judge(problem, SETTINGS, seed=1)
    assert found.state == state
    told = verdict(problem, found)
    assert any(f"p = {p:.2g}" in said for said in told.cannot_know) == (p == 0.0045)
    assert ("leaves something" in told.sentence) == (state == "open")
    assert told.adequacy.words == words


@pytest.mark.thorough
def test_what_rests_on_an_unfinished_refit_is_not_named_and_told():
    base = artificial.context(7, per_side=3)
    problem = problem_of(
        artificial.with_effect(base, "misregistration", [0.8, 0.3], np.random.default_rng(8))
    )
    finished = judge(problem, SETTINGS, seed=1)
    assert finished.state == "named" and finished.answer.fit.converged
    told = verdict(problem, finished)
    assert not any("final" in sentence for sentence in told.cannot_know)

    cut_short = replace(problem, forces_with=stuck_at_first(problem, 0.96))
    found = judge(cut_short, SETTINGS, seed=1)
    # All that `named` asks for is there, except that the amounts have come to rest.
    assert found.answer.adequacy.p > 0.01 and found.answer.gain.clear
    assert found.answer.fit.name == "misregistration" and not found.answer.fit.converged
    assert found.state == "insufficient"
    told = verdict(cut_short, found)
    assert any("misregistration" in said and "it is not named" in said for said in told.cannot_know)
    assert "not come to rest" in told.sentence


def test_what_could_not_be_tried_is_told_once_and_not_of_what_was_tried_elsewhere():
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
