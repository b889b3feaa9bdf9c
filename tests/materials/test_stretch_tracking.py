"""Stretches tracked in pictures, against films whose deformation is known exactly and against independent software."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from shared_data import SHARED, needs_shared
from stretch_tracking import drawn_points
from synthetic_pictures.membrane_views import MembraneFilm
from synthetic_pictures.speckle import Camera, Speckle, TensileFilm

from gelforge.materials.imaging.plane_stretch import principal_stretches_2d
from gelforge.materials.imaging.stretch_tracking import (
    TrackingError,
    TrackingSettings,
    flow_at_points,
    read_grey,
    textured_window,
    track_stretches,
)

TO_REACH = 0.005  # of both stretches, at every frame (issue: local stretch from pictures)
DRIFTING = Camera(gain_drift=-0.3, gradient_drift=0.3, offset_drift_grey=15)
TO_THREE = np.linspace(1, 3, 101)
FILMS = {
    "steady light": TensileFilm(TO_THREE),
    "slip, drift, turn": TensileFilm(TO_THREE, slip=0.05, camera=DRIFTING, turn_rad=0.05),
    "pure shear, slip, drift": TensileFilm(TO_THREE, "pure_shear", slip=0.05, camera=DRIFTING),
    "slip, drift, ink that wears off": TensileFilm(TO_THREE, slip=0.05, camera=DRIFTING, wear=0.9),
}


def errors(film, track):
    return track.stretch / film.principal_stretches - 1


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize("name", FILMS)
def test_both_stretches_hold_at_every_frame_to_three(name):
    film = FILMS[name]
    track = track_stretches(film.frames(), film.window)
    assert track.lost == ()
    assert np.abs(errors(film, track)).max() < TO_REACH
    if film.slip:  # what the clamps say is wrong by far more than the tracker may be
        assert film.slipped[-1] > 20 * TO_REACH
    where = film.points(track.window_px[:2] + np.array(track.window_px[2:]) / 2, 100)
    assert np.linalg.norm(track.centre_px[-1] - where) < 0.5  # px: the centre is the same material point
    # with ink that stays, every frame is compared with the first one; with ink that goes, with later key frames
    assert (set(track.anchor) == {0}) == (film.wear == 0)


def test_the_window_is_found_and_stretch_may_return_or_be_compression():
    # The window is found by texture and stretch may return
    lam = np.concatenate([np.linspace(1, 1.8, 9), np.linspace(1.8, 1.02, 9)])
    film = TensileFilm(lam, slip=0.0)
    track = track_stretches(film.frames())
    assert_allclose(track.window_px, film.window, atol=0.15 * film.length_px)
    assert np.abs(errors(film, track)).max() < TO_REACH

    # Compression gives the loads direction first
    film = TensileFilm(np.linspace(1, 0.7, 11))
    track = track_stretches(film.frames(), film.window)
    assert np.abs(errors(film, track)).max() < TO_REACH


def test_lost_texture_is_reported_before_it_misleads():
    # Lost texture is reported frame by frame and found again
    contrast = np.ones(26)
    contrast[12:15] = 0
    film = TensileFilm(np.linspace(1, 1.5, 26), contrast=contrast)
    track = track_stretches(film.frames(), film.window)
    assert [lost.frame for lost in track.lost] == [12, 13, 14]
    assert all("texture lost" in lost.reason for lost in track.lost)
    assert np.isnan(track.stretch[12:15]).all()
    assert (track.points[12:15] == 0).all()
    assert np.abs(errors(film, track)[contrast > 0]).max() < TO_REACH

    # Texture that fades is given up before it misleads
    film = TensileFilm(
        np.linspace(1, 2, 25), camera=DRIFTING, contrast=np.clip(np.linspace(1.1, -0.1, 25), 0, 1)
    )
    track = track_stretches(film.frames(), film.window)
    assert {lost.frame for lost in track.lost} >= set(np.flatnonzero(film.contrast == 0))
    assert np.nanmax(np.abs(errors(film, track))) < 2 * TO_REACH  # of what is not reported as lost


def test_what_leaves_the_picture_or_covers_background_is_reported():
    # What leaves the picture or steps too far is reported
    film = TensileFilm(np.linspace(1, 3, 25), shape=(200, 300))
    track = track_stretches(film.frames(), film.window)
    assert "lie in the picture" in track.lost[-1].reason
    assert np.nanmax(np.abs(errors(film, track))) < TO_REACH

    # Too large a step is reported not guessed
    film = TensileFilm(np.linspace(1, 3, 5))
    track = track_stretches(film.frames(), film.window)
    assert len(track.lost) == 4

    # A window over piece and still background is not trusted
    film = TensileFilm(np.linspace(1, 1.6, 13))
    still = Speckle(9).reflectance(np.stack(np.meshgrid(np.arange(660.0), np.arange(200.0)), axis=-1))
    still = film.camera.picture(still, 0, np.random.default_rng(1))

    def frames():
        for number in range(13):
            off = np.abs(film.reference_points(number)[..., 1] - 99.5) > film.width_px / 2
            yield np.where(off, still, film.frame(number))

    track = track_stretches(frames(), (99.5, 115.0, 81.0, 58.0))  # half of it shows the background
    assert len(track.lost) == 12


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_pictures_without_texture_have_no_stretch(noise):
    rng = np.random.default_rng(0)
    pictures = [np.rint(120 + noise * rng.standard_normal((200, 300))).astype(np.uint8) for _ in range(4)]
    track = track_stretches(pictures, (100, 60, 80, 60))
    assert [lost.frame for lost in track.lost] == [1, 2, 3]


def test_apex_of_a_membrane_and_its_texture_from_above():
    # Apex of a membrane from above
    film = MembraneFilm(np.linspace(1, 2.0, 21), camera_distance_mm=150.0)
    frames = [film.top_view(number) for number in range(21)]
    track = track_stretches(frames, (150, 130, 100, 100), TrackingSettings(degree=3))
    assert track.lost == ()
    # 0.5 %: a cubic map of a window of a third of the diameter is off by 0.3 % at this stretch and camera distance
    assert np.abs(track.stretch / film.apparent_stretch[:, None] - 1).max() < TO_REACH
    flat_map = track_stretches(frames, (150, 130, 100, 100))  # why the cubic map is there
    assert np.nanmax(np.abs(flat_map.stretch / film.apparent_stretch[:, None] - 1)) > 10 * TO_REACH

    # Texture is found on a membrane
    film = MembraneFilm(np.array([1.0]))
    x, y, width, height = textured_window(film.top_view(0), (1 / 3, 1 / 3))
    assert_allclose(
        [x + width / 2, y + height / 2], [199.5, 179.5], atol=10
    )  # px; a window need not be centred
    assert 80 < width < 130 and 80 < height < 130


def test_frames_are_drawn_lost_ones_named_and_nothing_to_read_is_said(tmp_path):
    # Frames are drawn and lost ones named
    film = TensileFilm(np.array([1.0, 1.02, 1.04]), contrast=np.array([1.0, 1.0, 0.0]))
    frames = list(film.frames())
    track = track_stretches(frames, film.window)
    coloured = [
        np.ptp(drawn_points(f, track, k)[30:].astype(int), axis=-1).max() > 100 for k, f in enumerate(frames)
    ]
    assert coloured == [True, True, False]

    # Nothing to read is said
    with pytest.raises(TrackingError, match="no frames"):
        track_stretches([])
    (tmp_path / "text.png").write_text("no picture")
    for name in ("absent.png", "text.png"):
        with pytest.raises(TrackingError, match=f"{name}: no readable picture"):
            read_grey(tmp_path / name)


@pytest.mark.parametrize(
    ("window", "words"),
    [
        ((10, 10, 20, 60), "20 x 60 px; patches of 21 px need"),
        ((600, 60, 80, 60), "leaves the picture of 660 x 200"),
    ],
)
def test_a_window_that_cannot_be_used_is_refused(window, words):
    with pytest.raises(TrackingError, match=words):
        track_stretches(TensileFilm(np.array([1.0, 1.1])).frames(), window)


def test_the_films_and_principal_stretches_are_what_they_say():
    # The film shows the texture where it says. Truth of the films: a pixel shows the reflectance of its material
    # point, and points() inverts its place
    film = TensileFilm(np.linspace(1, 2, 5), slip=0.05, turn_rad=0.1, camera=Camera(blur_px=0, noise_grey=0))
    for number in (0, 3):
        X = film.reference_points(number)
        y, x = np.mgrid[:200, :660]
        assert_allclose(film.points(X, number), np.stack([x, y], axis=-1), atol=1e-9)
        at = np.array([[100, 160], [95, 180], [104, 150]])
        shown = film.frame(number)[at[:, 0], at[:, 1]]
        assert_allclose(
            shown, 20 + 190 * film.speckle.reflectance(X[at[:, 0], at[:, 1]]), atol=0.51
        )  # rounding
    assert (np.diff(film.slipped) >= 0).all() and film.slipped[-1] > 0

    # Principal stretches know nothing of rotation and follow the direction
    rng = np.random.default_rng(5)
    lam = rng.uniform(0.5, 3, (20, 2))
    angle, turn = rng.uniform(-0.7, 0.7, (2, 20))

    def rotation(a):
        return np.moveaxis(np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]), -1, 0)

    N = rotation(angle)
    U = N @ (lam[:, :, None] * np.swapaxes(N, 1, 2))
    assert_allclose(principal_stretches_2d(rotation(turn) @ U, [1.0, 0.0]), lam, rtol=1e-12)


# The independent solution is itself a measurement; both use patches of 27 px.
DIC_PATCH = 27


def dice(number):
    folder = SHARED / "dic_speckle"
    table = pd.read_csv(folder / f"DICe_solution_{number}.txt", comment="*")
    points = table[["COORDINATE_X", "COORDINATE_Y"]].to_numpy()
    moved = table[["DISPLACEMENT_X", "DISPLACEMENT_Y"]].to_numpy()
    return points, moved


@needs_shared
def test_real_speckle_agrees_with_an_independent_solution():
    frames = {k: read_grey(SHARED / "dic_speckle" / f"oht_cfrp_{k}.tiff") for k in ("00", "02", "04")}
    for number in ("02", "04"):
        points, moved = dice(number)
        found, back, ok = flow_at_points(frames["00"], frames[number], points, DIC_PATCH)
        distance = np.linalg.norm(found - moved, axis=1)
        assert ok.all() and back.max() < 0.02
        assert np.sqrt(np.mean(distance**2)) < 0.02  # px, both components together
        assert np.quantile(distance, 0.95) < 0.02
        assert distance.max() < 0.04
    # the stretch of a field away from the hole: tracked map against a plane through the independent points
    window = (80.0, 60.0, 240.0, 300.0)
    track = track_stretches(frames.values(), window)
    for k, number in ((1, "02"), (2, "04")):
        points, moved = dice(number)
        lo, size = np.array(window[:2]), np.array(window[2:])
        inside = ((points > lo) & (points < lo + size)).all(1)
        A = np.column_stack([np.ones(inside.sum()), points[inside]])
        F = np.eye(2) + np.linalg.lstsq(A, moved[inside], rcond=None)[0][1:].T
        # 2e-4: 0.02 px over half the window's width
        assert_allclose(np.sort(track.stretch[k]), np.sort(principal_stretches_2d(F, [0, 1])), atol=2e-4)
