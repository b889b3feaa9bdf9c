"""A strong defect between the places that are tried is placed before sets are weighed. ARTIFICIAL readings."""

from dataclasses import replace

import artificial
import numpy as np
import pytest
from artificial_problem import SETTINGS
from test_places_between import away, bubble, off_the_middle, solvable

from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.inference.fits import placed
from gelforge.mismatch.inference.judge import judge
from gelforge.mismatch.thresholds import FORM_ERRORS, PLACE_ERROR


def quiet_base():
    """Return a base whose readings are so quiet that a bubble between two places is neither of them."""
    base = artificial.context(62)
    seen = base.observations
    errors = ("noise_N", "zero_N", "press_depth_mm", "session_depth_mm")
    return replace(base, observations=replace(seen, **{name: getattr(seen, name) / 10 for name in errors}))


@pytest.fixture(scope="module")
def hidden():
    base = quiet_base()
    there, spacing = off_the_middle(0.45, 0.4)
    read = artificial.read(base, base.force + bubble(base, there), np.random.default_rng(63))
    return solvable(read), there, spacing


def the_void(problem):
    (found,) = [one for one in problem.candidates if one.name == "void" and one.moved_from is not None]
    return found


def test_a_strong_defect_is_put_where_it_is_if_it_can_be_solved(hidden):
    problem, there, spacing = hidden
    relinearised, failure = placed(problem, problem)
    found = the_void(relinearised)
    assert not failure and away(found.hyperparameters, there) < 0.1 * spacing < away(found.tried, there)
    assert (
        relinearised.error_of(found) in FORM_ERRORS
        and PLACE_ERROR not in FORM_ERRORS
        and len(relinearised.candidates) == len(problem.candidates)
    )
    changed = [one for one, other in zip(relinearised.candidates, problem.candidates) if one is not other]
    assert changed == [found]
    true = problem.observations.flat(
        problem.forces_with([(found, np.array([1.0]))], np.ones(len(problem.base), bool))
    )
    assert found.columns[:, 0] == pytest.approx(
        true - problem.observations.flat(problem.base), rel=0.2, abs=0.01
    )

    # A defect that cannot be solved stays where it was tried
    problem, *_ = hidden

    def refusing(terms, rows):
        raise NotConverged("no equilibrium at 2 mm")

    same, failure = placed(problem, replace(problem, forces_with=refusing))
    assert same is problem and failure == "void could not be placed: no equilibrium at 2 mm"


@pytest.mark.thorough
def test_a_placed_defect_alone_is_identified_and_anything_else_changes_nothing(hidden):
    # It alone is identified
    problem, there, spacing = hidden
    found = judge(problem, SETTINGS, seed=1)
    assert found.state == "identified" and [group.members[0] for group in found.answer.sure] == ["void"]
    (part,) = found.answer.fit.parts
    assert away(part.hyperparameters, there) < 0.1 * spacing

    # What is no strong defect leaves the problem as it is
    base = artificial.context(62)
    tilted = solvable(artificial.with_effect(base, "tilt", [3.0, -2.0], np.random.default_rng(5)))
    assert placed(tilted, tilted) == (tilted, "")
    there, _ = off_the_middle(0.45, 0.4)
    faint = artificial.read(base, base.force + bubble(base, there, 0.02), np.random.default_rng(63))
    faint = solvable(faint)
    assert placed(faint, faint) == (faint, "")
