"""The headline: 25 words at most in every state, of whatever cause. ARTIFICIAL judgements of real effects and free forms."""

from itertools import product
from types import SimpleNamespace

import artificial
import pytest

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.effects.force_frame import READ
from gelforge.mismatch.evidence.gaussian import NOTHING
from gelforge.mismatch.free_forms import modules_of
from gelforge.mismatch.summary.words import sentence_of

PROBLEM = SimpleNamespace(effects=CATALOGUE)
PLACED = {"void", "inclusion", "delamination", "wall_gap"}
HYPERPARAMETERS = {name: {"x_mm": 12.34, "y_mm": 20.1} for name in PLACED}
HYPERPARAMETERS |= {"force_frame": {"axes": max(READ, key=len)}, "frictionless": {"coefficient": 0.0}}


def answer_of(*names, like=("tilt",), alternatives=()):
    """Return an answer whose effects have a line and alternatives each."""
    parts = [
        SimpleNamespace(name=n, hyperparameters=HYPERPARAMETERS.get(n, {}), binary=CATALOGUE[n].binary)
        for n in names
    ]
    groups = [
        SimpleNamespace(
            members=(name, *like),
            names=(name, *like, *alternatives),
            probability=0.95,
            chance=0.99,
            shares={name: 0.55},
        )
        for name in names
    ]
    theta = [[-0.1234] * max(1, len(CATALOGUE[name].parameters)) for name in names]
    fit, adequacy = SimpleNamespace(parts=parts, theta=theta), SimpleNamespace(p=0.4)
    return SimpleNamespace(fit=fit, groups=groups, sure=groups, adequacy=adequacy)


def headline(state, answer=None, model=None, out_of_range=False, p=0.0123):
    words = "all forces in proportion from one indentation to the next"
    judgement = SimpleNamespace(
        state=state,
        posterior=SimpleNamespace(discrepancy_words=words, probability={NOTHING: 0.16}),
        answer=answer,
        model=model,
        mismatch=SimpleNamespace(p=p),
        out_of_range=out_of_range,
    )
    return sentence_of(PROBLEM, judgement)


def short(sentence: str) -> bool:
    return len(sentence.split()) <= 25 and sentence.endswith(".")


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_every_effect_alone_or_with_others_fits_into_it(name):
    for other in ([], *([one] for one in CATALOGUE if one != name)):
        for state in ("identified", "ambiguous", "inconclusive"):
            said = headline(state, answer_of(name, *other))
            assert short(said), said
    three = headline("identified", answer_of(name, "delamination", "tilt"))
    assert short(three) and "1 more" in three


def test_free_forms_and_no_answer_fit_and_the_value_is_said_where_it_fits():
    # Free forms discrepancies and no answer fit into it
    modules = modules_of(artificial.context(3, per_side=3), ())
    assert {"gain_in_time", "softening"} <= {module.name for module in modules}  # those of most words
    for module, with_effects in product(modules, (False, True)):
        model = SimpleNamespace(
            sure=True, module=module, probability=0.97, with_effects=with_effects, kernel=module
        )
        for said in (
            headline("identified", answer_of("delamination"), model),
            headline("unexplained", None, model),
        ):
            assert short(said), said

    # What has no answer fits into it
    unknown = answer_of("tilt")
    for said in (
        headline("consistent"),
        headline("consistent", p=1.2e-5),
        headline("inconclusive"),
        headline("unexplained"),
        headline("unexplained", unknown),
        headline("unexplained", unknown, out_of_range=True),
    ):
        assert short(said), said

    # The value is said where it fits and the probability of a member is its share
    alone = answer_of("gel_stiffness", like=())
    assert headline("identified", alone) == "The gel is 12 % softer than simulated (probability 0.95)."
    two = answer_of("gel_stiffness", like=(), alternatives=("tilt",))
    assert "2 causes are possible" in (said := headline("ambiguous", two)) and "(share 55 %)" in said
