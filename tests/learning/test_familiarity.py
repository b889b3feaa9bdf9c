"""The flag of images unlike the training set: quiet on images like them, raised by flow that training does not span."""

import numpy as np
import pytest

from gelforge.learning.models.familiarity import find_familiar

N = 12  # regions along a side


def flows(count, seed, width=0.15):
    """Return flow fields (count, 2 N N) that point away from random places, larger where pressed deeper, with noise."""
    rng = np.random.default_rng(seed)
    at = (np.stack(np.meshgrid(*[np.arange(N) + 0.5] * 2), axis=0) / N).reshape(2, -1)
    place, depth = rng.uniform(0.3, 0.7, (count, 2, 1)), rng.uniform(0.2, 1.0, (count, 1, 1))
    away = at - place
    field = depth * away / width * np.exp(-(away**2).sum(axis=1, keepdims=True) / (2 * width**2))
    return (field + 0.02 * rng.standard_normal(field.shape)).reshape(count, -1)


@pytest.fixture(scope="module")
def familiar():
    return find_familiar(flows(1000, 1), np.arange(1000) % 50)


def test_images_like_the_training_set_are_not_flagged(familiar):
    assert (
        familiar.unlike(flows(2000, 3)) > 1
    ).mean() < 0.02  # limits are those of one in 200, for each of two


@pytest.mark.parametrize(
    "changed",
    [
        lambda flow: flow + np.repeat([0.15, 0.0], N * N),  # the camera moved: everything does
        lambda flow: flow.reshape(-1, 2, N, N).transpose(0, 1, 3, 2).reshape(len(flow), -1),  # another frame
        lambda flow: 2.5 * flow,  # deeper than anything learnt from
        lambda flow: flow + 0.2 * (np.arange(2 * N * N) % N < 2),  # a smear at the border of the lens
    ],
    ids=["camera moved", "axes swapped", "another size", "a touched lens"],
)
def test_what_training_does_not_span_is_flagged(familiar, changed):
    assert (familiar.unlike(changed(flows(200, 4))) > 1).mean() > 0.9


def test_another_form_of_the_field_is_flagged(familiar):
    assert (familiar.unlike(flows(200, 5, width=0.3)) > 1).mean() > 0.9


def test_groups_that_differ_widen_the_limits():
    """Places that none of the other groups saw are what an image of a new site is; within a group they would be known."""
    own = np.repeat(np.arange(25), 40)
    offset = 0.08 * np.random.default_rng(6).standard_normal((25, 2 * N * N))  # each group's own
    inputs = flows(1000, 1) + offset[own]
    new = flows(400, 7) + 0.08 * np.random.default_rng(8).standard_normal(2 * N * N)
    assert (find_familiar(inputs, own).unlike(new) > 1).mean() < 0.05
    assert (find_familiar(inputs, np.arange(1000) % 25).unlike(new) > 1).mean() > 0.5


def test_few_rows_or_groups_give_no_flag():
    assert find_familiar(flows(50, 1), np.arange(50)) is None
    assert find_familiar(flows(300, 1), np.arange(300) % 4) is None
