"""A set of effects whose fit fails is out of the posterior: the others are an answer without it."""

from types import SimpleNamespace

import pytest

from gelforge.mismatch.inference.fits import _with_fits
from gelforge.mismatch.inference.posterior import NOTHING, Posterior


def test_every_set_that_is_left_has_a_probability():
    names = [frozenset({"friction"}), frozenset({"viscoelastic"}), frozenset({"friction", "viscoelastic"})]
    sets = {effects: SimpleNamespace(log_bayes_factor=float(k)) for k, effects in enumerate(names)}
    singles = {"friction": sets[names[0]], "viscoelastic": sets[names[1]]}
    evidence = {effects: one.log_bayes_factor for effects, one in sets.items()}
    lines = {name: frozenset({name}) for name in singles}
    posterior = Posterior(sets, singles, evidence, {}, len(singles), lines)
    fit = SimpleNamespace(log_bayes_factor=4.0)
    found = _with_fits(posterior, posterior, {names[1]: fit}, {names[2]: "could not be solved"})
    assert set(found.sets) == set(names[:2])
    assert set(found.probability) == {NOTHING, *found.sets}
    assert found.evidence[names[1]] == 4.0
    assert sum(found.probability.values()) == pytest.approx(1.0)
