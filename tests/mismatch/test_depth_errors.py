"""The stage's scatter from press to press and the session's contact point are two errors, and both are allowed for."""

from dataclasses import replace
from types import SimpleNamespace

import artificial_readings
import numpy as np
import pandas as pd
import pytest
from artificial_readings import draws_of, flat_base, grid, readings
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest
from test_covariance import dense
from test_noise import pressed

from gelforge.config import DepthZero
from gelforge.mismatch.evidence.covariance import readings_covariance
from gelforge.mismatch.images.flow_covariance import contact_points
from gelforge.mismatch.inference.scan import global_test
from gelforge.mismatch.readings.errors import CONTACT_POINT_MM, depth_scatter, with_contact_point

STAGE_MM, CONTACT_MM = 0.02, 0.04
DRAWS = 400


def allowed(press_mm, session_mm, sites=4, sessions=1, **errors):
    """Return readings that allow for these errors of the depth, and their covariance."""
    found = readings(grid(sites), sessions=sessions, **errors)
    seen = found.observations
    depths = {"press_depth_mm": press_mm, "session_depth_mm": session_mm}
    seen = replace(seen, **{name: np.full(len(seen.force), size) for name, size in depths.items()})
    found = replace(found, observations=seen)
    law, floor = np.zeros((len(seen.force), 3, 0)), 0.002 * found.force
    return found, readings_covariance(found, law, floor)


def p_of(drawn, covariance) -> np.ndarray:
    """Return the p of the global test for each column of residuals (n, k)."""
    return np.array([global_test(residual, covariance).p for residual in drawn.T])


@pytest.fixture(scope="module")
def residuals():
    """Return residuals (n, DRAWS) of nulls whose depth has both errors."""
    return draws_of(allowed(STAGE_MM, CONTACT_MM)[1], np.random.default_rng(1), DRAWS)


def test_nulls_with_both_errors_are_calibrated_also_with_a_drifting_zero(residuals):
    """400 draws: one in a hundred is below 0.01 (1 to 8 with a chance of 0.96), and p is uniform."""
    p = p_of(residuals, allowed(STAGE_MM, CONTACT_MM)[1])
    assert np.mean(p < 0.01) < 0.0225 and kstest(p, "uniform").pvalue > 0.01

    # Nulls are calibrated over two sessions with a drifting zero
    _, covariance = allowed(STAGE_MM, CONTACT_MM, 3, 2, drift=0.002, trend=0.001, unload=True)
    p = p_of(draws_of(covariance, np.random.default_rng(2), DRAWS), covariance)
    assert np.mean(p < 0.01) < 0.0225 and kstest(p, "uniform").pvalue > 0.01


@pytest.mark.parametrize(
    ("press_mm", "session_mm"),
    [(0.0, CONTACT_MM), (STAGE_MM, 0.0), (0.0, np.hypot(STAGE_MM, CONTACT_MM))],
    ids=["contact point", "stage", "their sum as the session's"],
)
def test_nulls_with_both_errors_are_alarms_where_one_field_holds_either(residuals, press_mm, session_mm):
    _, covariance = allowed(press_mm, session_mm)
    assert np.mean(p_of(residuals, covariance) < 0.01) > 0.2


def test_a_gain_is_still_seen_beside_both_errors():
    """All forces 5 % too large are no error of the depth: 22 standard deviations without, 9 with these."""
    found, covariance = allowed(STAGE_MM, CONTACT_MM)
    assert np.linalg.norm(covariance.whiten(0.05 * flat_base(found))) > 8


sizes = st.sampled_from([0.0, 1e-4, 0.01, 0.3])


@settings(max_examples=20, deadline=None)
@given(sizes, sizes, sizes, sizes, st.integers(1, 2), st.booleans())
def test_the_covariance_is_symmetric_and_positive_definite(press, session, drift, trend, sessions, unload):
    found, covariance = allowed(press, session, 1, sessions, drift=drift, trend=trend, unload=unload)
    C = dense(found, np.zeros((len(found.force), 3, 0)), 0.002 * found.force)
    assert np.allclose(C, C.T, rtol=1e-12) and np.linalg.eigvalsh(C).min() > 0
    W = covariance.whiten(np.eye(len(C)))
    # the condition number of C, at most 1e5 here, times 1e-16, with room
    assert np.abs(W @ C @ W.T - np.eye(len(C))).max() < 1e-8
    assert covariance.log_det == pytest.approx(np.linalg.slogdet(C)[1], rel=1e-9)


@pytest.mark.parametrize("by", ["press", "session"])
def test_without_new_keys_the_covariance_is_that_of_one_field_bit_for_bit(by):
    """As one field for the contact point and who shares it, `zero_by`, gave it."""
    found = readings(grid(2), sessions=2, zero_by=by, rounding=0.003, dwell=1)
    seen, labels = found.observations, found.observations.labels()
    law, floor = artificial_readings.law_directions(found), 0.01 * found.force
    covariance = readings_covariance(found, law, floor)
    contact_point = seen.flat(
        np.full(len(found.force), artificial_readings.CONTACT_POINT)[:, None] * found.slope()
    )
    zero = np.eye(3)[labels["axis"].to_numpy()] * seen.flat(seen.zero_N)[:, None]
    by_session = np.full(len(labels), by == "session")
    press = np.column_stack([zero, np.where(by_session, 0, contact_point)])
    session = np.where(
        by_session[:, None], contact_point[:, None] * pd.get_dummies(labels["session"]).to_numpy(float), 0.0
    )
    session = session[:, session.any(axis=0)]
    *_, of_press, alike, common = covariance.levels
    assert np.array_equal(of_press.directions, press)
    assert np.array_equal(common.directions, np.column_stack([seen.flat(law), alike.directions, session]))


# ------------------------------------------------------------------------------------------- what session.yaml says
@pytest.mark.parametrize(
    ("keys", "stated", "press", "session"),
    [
        ({}, None, 0.0, np.nan),
        ({"by": "press"}, None, np.nan, 0.0),
        ({"session_scatter_mm": 0.01}, None, np.nan, 0.01),
        ({"session_scatter_mm": 0.01, "press_scatter_mm": 0.003}, None, 0.003, 0.01),
        ({"by": "press", "session_scatter_mm": 0.01, "press_scatter_mm": 0.003}, None, 0.003, 0.01),
        ({"press_scatter_mm": 0.003}, None, 0.003, np.nan),
        ({}, 0.005, 0.0, 0.005),
        ({"by": "press", "press_scatter_mm": 0.01, "session_scatter_mm": 0.0}, 0.005, 0.005, 0.0),
        ({"session_scatter_mm": 0.01, "press_scatter_mm": 0.003}, 0.005, 0.003, 0.005),
    ],
)
def test_who_has_which_error(keys, stated, press, session):
    assert depth_scatter(DepthZero(**keys), stated) == pytest.approx((press, session), nan_ok=True)


def unsaid(found, press, session):
    n = len(found.force)
    return replace(found, press_depth_mm=np.full(n, press), session_depth_mm=np.full(n, session))


def test_repeats_show_the_stage_beside_a_stated_contact_point_and_noise_is_stated_by_axis():
    # Repeats show the stage next to a stated contact point. 400 presses of 4 places know the scatter to 4 %; that of
    # the session is not in it
    off = np.random.default_rng(8).normal(0, 0.02, 400) + 0.05
    found = pressed("press", off, (0.5, 0.6, 0.7, 0.8), 0.002, sites=4)
    found = with_contact_point(unsaid(found, np.nan, 0.05))
    assert found.press_depth_mm == pytest.approx(np.full(1600, 0.02), rel=0.15)
    assert (found.session_depth_mm == 0.05).all() and not found.cannot_know

    # A stage that nothing tells of is reported
    found = with_contact_point(unsaid(pressed("press", [0.0, 0.01]), np.nan, 0.05))
    assert not found.press_depth_mm.any() and (found.session_depth_mm == 0.05).all()
    assert len(found.cannot_know) == 1 and "depth_zero.press_scatter_mm" in found.cannot_know[0]

    # Noise is stated by axis
    from gelforge.mismatch.readings.errors import reading_noise
    from gelforge.recording.readings import FORCE

    recording = SimpleNamespace(
        readings=pressed("press", [0.0]).table.assign(
            time_s=0.0, phase="load", **dict.fromkeys([*FORCE, "fx_raw_N", "fy_raw_N", "fz_raw_N"], 0.0)
        ),
        session=SimpleNamespace(
            session="s",
            force=SimpleNamespace(resolution_N=[0.1] * 3, repeatability_N=[0.01, 0.0, 0.03], axes=np.eye(3)),
        ),
    )
    noise, _, _, said = reading_noise(recording)
    assert noise == pytest.approx([0.01, 0.1, 0.03]) and "stated repeatability" in said[0]


@pytest.mark.parametrize(("by", "key"), [("press", "press_scatter_mm"), ("session", "session_scatter_mm")])
def test_what_is_assumed_is_told_by_its_key(by, key):
    found = with_contact_point(pressed(by, [0.0, 0.01]))
    assert (found.press_depth_mm + found.session_depth_mm == CONTACT_POINT_MM).all()
    assert f"(depth_zero.{key})" in found.cannot_know[0]


# ------------------------------------------------------------------------------------------------------- with images
@pytest.mark.parametrize(
    ("press_mm", "session_mm"), [(STAGE_MM, CONTACT_MM), (STAGE_MM, 0.0), (0.0, CONTACT_MM), (0.0, 0.0)]
)
def test_force_and_flow_of_a_press_share_its_depth_and_its_session_s(press_mm, session_mm):
    """What the columns give forces and flow in common is slope times slope times each variance of the depth."""
    found, covariance = allowed(
        press_mm, session_mm, 2, 2, trend=0.01
    )  # the trend's columns come after the depth's
    seen, labels = found.observations, found.observations.labels()
    pressed_at = [int(np.flatnonzero(seen.table["press"] == press)[-1]) for press in (0, 5, 20)]
    slope = np.random.default_rng(0).normal(size=(3, 4, 2))  # px/mm of four regions of three presses
    problem = SimpleNamespace(covariance=covariance, labels=labels, observations=seen)
    flow = seen.table.loc[np.repeat(pressed_at, 8)]
    depths = np.full(24, press_mm), np.full(24, session_mm)
    by_press, by_session = contact_points(problem, flow, depths, slope.ravel())
    *_, press, alike, common = covariance.levels
    sessions = common.directions[:, alike.directions.shape[1] :][:, : by_session.shape[1]]
    together = labels["press"].to_numpy()[:, None] == flow["press"].to_numpy()
    # (n, 24): forces with flow
    both = together * (press.directions @ by_press.T) + sessions @ by_session.T
    own = seen.flat(found.slope())
    for k, at in enumerate(pressed_at):
        row = seen.table.loc[at]
        mine = press_mm**2 * (labels["press"] == row["press"]) + session_mm**2 * (
            labels["session"] == row["session"]
        )
        expected = np.outer(own * mine, slope[k])
        assert both.reshape(len(labels), 3, 8)[:, k] == pytest.approx(expected, abs=1e-12)
