"""What a study takes as known must say which effect, parameter and shape it means; it is then part of the base."""

from types import SimpleNamespace

import artificial
import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.config import ConfigError, study_from
from gelforge.config.basis.variants import merged
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.effects.force_frame import READ
from gelforge.mismatch.fem.nominal import with_known
from gelforge.mismatch.fem.solver import Base


def based_on(effect, theta, hyperparameters):
    """Return the artificial base, and with one effect taken as known."""
    context = artificial.context(3, per_side=3)
    known = {"effect": effect, "parameters": theta, "hyperparameters": hyperparameters}
    study = study_from(merged(context.study.model_dump(mode="json"), {"mismatch": {"known": [known]}}))
    same = context.force
    unit = np.ones((len(same), 1))
    law, floor = 0.02 * same[..., None], 0.01 * np.abs(same)
    base = Base(context, None, same, same, unit, law, floor, np.arange(len(same)), {})
    return base, with_known(base, SimpleNamespace(study=study))


@pytest.mark.parametrize("axes", READ)
def test_axes_that_are_known_are_those_that_are_told(axes):
    base, changed = based_on("force_frame", {"on": 1}, {"axes": axes})
    turned = base.context.force[:, :2] @ np.array(READ[axes], dtype=float).T
    assert_allclose(changed.context.force[:, :2], turned, atol=1e-12)


@pytest.mark.parametrize(
    ("effect", "theta", "hyperparameters", "read"),
    [
        ("force_gain", {"x": -0.1, "z": 0.12}, {}, np.diag([0.9, 1.0, 1.12])),
        ("force_unit", {"on": 1}, {"unit": "kgf"}, np.eye(3) / 9.80665),
        ("cross_talk", {"x_of_z": 0.05}, {}, np.eye(3) + 0.05 * np.eye(3)[:, :1] @ np.eye(3)[2:]),
        ("force_offset", {"z": 0.3}, None, np.eye(3)),  # what is added reads no change otherwise
    ],
)
def test_a_known_force_sensor_reads_changes_as_it_reads_forces(effect, theta, hyperparameters, read):
    if hyperparameters is None:
        hyperparameters = CATALOGUE[effect].grid(artificial.context(3, per_side=3))[0]
    base, changed = based_on(effect, theta, dict(hyperparameters))
    before, after = base.context, changed.context
    assert_allclose(changed.sensor, read, atol=1e-12)
    name = "gel_stiffness"
    assert_allclose(after.derivative(name), before.derivative(name) @ read.T, atol=1e-12)
    assert_allclose(after.slope(), before.slope() @ read.T, atol=1e-9)
    assert_allclose(changed.law[..., 0], base.law[..., 0] @ read.T, atol=1e-12)
    assert_allclose(changed.floor**2, base.floor**2 @ (read**2).T, atol=1e-12)


@pytest.mark.parametrize(
    ("effect", "theta", "hyperparameters", "message"),
    [
        ("force_frame", {"on": 1}, {}, r"must be \['axes'\]; those tried are axes: turned by 180 deg, "),
        ("force_unit", {"on": 1}, {}, r"must be \['unit'\]; those tried are unit: .*kgf"),
        (
            "force_frame",
            {"on": 1},
            {"axes": "askew"},
            "no axes 'askew'; those tried are axes: turned by 180 deg",
        ),
        ("force_frame", {"on": 1}, {"axis": "y reversed"}, r"its hyperparameters are \['axis'\] and must be"),
        ("force_gain", {"z": 0.1}, {"axes": "y reversed"}, r"must be \[\]; those tried are none"),
        ("force_gain", {"w": 0.1}, {}, r"no parameter \['w'\]; it has"),
        ("force_grain", {"z": 0.1}, {}, "no effect 'force_grain'"),
    ],
)
def test_what_is_known_without_saying_which_is_refused(effect, theta, hyperparameters, message):
    with pytest.raises(ConfigError, match=message):
        based_on(effect, theta, hyperparameters)
