"""A camera's intrinsics and distortion from images of a flat board (Zhang 2000, doi:10.1109/34.888718, by OpenCV)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from gelforge.config import Camera
from gelforge.config.parts.camera import LENS
from gelforge.recording.optics.boards import Board, CalibrationError, View, Views
from gelforge.recording.optics.camera import CameraError, unproject
from gelforge.recording.optics.remap import places_in

# Drawn boards and what they determine: `python benchmarks/cameras.py`:
LEAST_IMAGES = 5  # three determine the intrinsics of a noiseless board; OpenCV asks for ten
# Corners of drawn boards leave a tenth of a pixel; more is a wrong model, a bent board or motion. Corners that are off by 2
# px are refused (tests/recording/test_calibration.py).
LARGEST_RMS_PX = 1.0
# Of the focal length: parallel boards leave more and are refused, tilted ones leave less than a pixel
# (tests/recording/test_calibration.py).
LARGEST_FOCAL_SD = 0.02
# The image in 5 x 5 parts: a distortion holds where corners were. Corners in the middle of a larger image are refused
# (tests/recording/test_calibration.py).
CELLS, LEAST_COVERED = 5, 0.6
# An error over the median one, beyond which it is left out: of normal errors along both axes one in 2^16 = 65,536 is 4 times
# their median length (Rayleigh 1880).
OUTLIER = 4.0
# An image's error that is left out, at least. Five times the 0.1 px that drawn corners leave
# (tests/recording/test_calibration.py).
LEAST_OUTLIER_PX = 0.5


@dataclass(frozen=True)
class Calibration:
    """What images of a board say of a camera; rows of intrinsics_sd: fx, fy, cx, cy [px], then the coefficients."""

    board: Board
    views: Views
    model: str
    K: np.ndarray  # (3, 3)
    coefficients: np.ndarray
    intrinsics_sd: np.ndarray  # (4 + number of coefficients,)
    poses: list[tuple[np.ndarray, np.ndarray]]  # rotation vector and translation [mm] of the board, by view
    rms_px: float
    view_rms_px: np.ndarray
    covered: float  # share of the image's parts with a corner

    @property
    def keys(self) -> dict:
        """Return what a session's camera takes from it: everything but the pose."""
        return {
            "width_px": self.views.size[0],
            "height_px": self.views.size[1],
            "focal_px": round(float(self.K[0, 0]), 4),
            "focal_y_px": round(float(self.K[1, 1]), 4),
            "centre_px": [round(float(c), 4) for c in self.K[:2, 2]],
            "distortion": {
                "model": self.model,
                "coefficients": [round(float(k), 9) for k in self.coefficients],
            },
        }

    @property
    def camera(self) -> Camera:
        """Return the camera with no pose: at the origin, looking along z."""
        return Camera(**self.keys, position_mm=[0, 0, 0])

    def residuals(self) -> list[np.ndarray]:
        """Return seen less fitted pixels (C, 2) of each view."""
        return [
            view.pixels - _projected(self.model, view.board, *pose, self.K, self.coefficients)
            for view, pose in zip(self.views.seen, self.poses)
        ]

    def tilts_deg(self) -> np.ndarray:
        """Return the angle of each board to the mean of all boards [deg]."""
        normals = np.array([cv2.Rodrigues(rotation)[0][:, 2] for rotation, _ in self.poses])
        mean = normals.mean(axis=0)
        return np.degrees(np.arccos(np.clip(normals @ mean / np.linalg.norm(mean), -1, 1)))


def calibrate(
    views: Views, board: Board, model: str = "pinhole", rms_px: float = LARGEST_RMS_PX
) -> Calibration:
    """Return the lens of a camera by the boards seen.

    An image far worse than the others is left out, with its reason.

    Parameters
    ----------
    views : Views
        As `find_boards` returns them.
    board : Board
        The board that they show.
    model : str
        "pinhole" (five coefficients of distortion) or "fisheye" (four).
    rms_px : float
        Largest accepted error of the corners [px].

    Returns
    -------
    Calibration
        Intrinsics with standard deviations, errors by image and the share of the image covered.

    Raises
    ------
    CalibrationError
        For too few images, too little of the image covered, boards that are nearly parallel, a large error, or a
        distortion that folds. The message gives value, limit and remedy.
    """
    _enough(views)
    calibration = _fitted(views, board, model)
    limit = max(OUTLIER * float(np.median(calibration.view_rms_px)), LEAST_OUTLIER_PX)
    worse = {v.name: e for v, e in zip(views.seen, calibration.view_rms_px) if e > limit}
    if worse:
        reasons = {
            name: f"error {e:.2f} px, limit {limit:.2f} px ({OUTLIER:g} x the median)"
            for name, e in worse.items()
        }
        kept = [v for v in views.seen if v.name not in worse]
        views = replace(views, seen=kept, left_out=views.left_out | reasons)
        _enough(views)
        calibration = _fitted(views, board, model)
    _check(calibration, rms_px)
    return calibration


def _enough(views: Views) -> None:
    if len(views.seen) < LEAST_IMAGES:
        why = "; ".join(f"{name}: {reason}" for name, reason in list(views.left_out.items())[:3])
        raise CalibrationError(
            f"{len(views.seen)} image(s) show the board, limit {LEAST_IMAGES}; take some 15 with the board tilted by 20 to "
            "40 degrees in all directions" + (f" (left out: {why})" if why else "")
        )
    covered = coverage(views)
    if covered < LEAST_COVERED:
        raise CalibrationError(
            f"corners cover {covered:.0%} of the image ({CELLS} x {CELLS} parts), limit {LEAST_COVERED:.0%}; bring the board"
            " into the corners and along the borders of the image"
        )


def _check(lens: Calibration, rms_px: float) -> None:
    if lens.rms_px > rms_px:
        worst = int(lens.view_rms_px.argmax())
        raise CalibrationError(
            f"reprojection error {lens.rms_px:.2f} px rms, limit {rms_px:g} px (worst {lens.views.seen[worst].name}: "
            f"{lens.view_rms_px[worst]:.2f} px); check --board, flatness and motion blur, or try the other --model"
        )
    tilts = lens.tilts_deg()
    sd = lens.intrinsics_sd[:2] / np.diag(lens.K)[:2]
    if not np.all(sd <= LARGEST_FOCAL_SD):
        raise CalibrationError(
            f"the focal length is {lens.K[0, 0]:.4g} px with a standard deviation of {max(sd):.1%}, limit "
            f"{LARGEST_FOCAL_SD:.0%}: the boards are too nearly parallel (within {tilts.max():.1f} degrees of their mean); "
            "tilt the board by 20 to 40 degrees in all directions"
        )
    width, height = lens.views.size
    # between borders of the outermost pixels
    u, v = np.linspace(-0.5, width - 0.5, 21), np.linspace(-0.5, height - 0.5, 21)
    border = [(a, b) for a in u for b in v[[0, -1]]] + [(a, b) for a in u[[0, -1]] for b in v]
    try:
        unproject(lens.camera, border, 1.0)
    except CameraError as error:
        raise CalibrationError(f"the distortion found does not hold for the whole image: {error}") from None


def coverage(views: Views) -> float:
    """Return the share of the image's CELLS x CELLS parts in which a corner was seen."""
    pixels = np.concatenate([view.pixels for view in views.seen])
    part = np.clip((pixels + 0.5) / views.size * CELLS, 0, CELLS - 1).astype(int)
    return len(np.unique(part, axis=0)) / CELLS**2


def _fitted(views: Views, board: Board, model: str) -> Calibration:
    objects = [view.board.astype(np.float32) for view in views.seen]
    images = [view.pixels.astype(np.float32) for view in views.seen]
    try:
        if model == "pinhole":
            # OpenCV takes None as "to be found", which its types do not say
            rms, K, k, turns, shifts, *_ = cv2.calibrateCameraExtended(  # type: ignore[call-overload]
                objects, images, views.size, None, None
            )
        else:
            rms, K, k, turns, shifts = cv2.fisheye.calibrate(
                [o[None] for o in objects], [i[None] for i in images], views.size, np.eye(3), np.zeros(4),
                flags=cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW,
            )  # fmt: skip
    except cv2.error as error:
        raise CalibrationError(
            f"OpenCV finds no {model} camera for {len(views.seen)} images ({error.err or 'no reason given'}); take more, "
            "with other tilts, or try the other --model"
        ) from None
    k = np.asarray(k).ravel()[: len(LENS[model])]
    poses = [(np.asarray(r).reshape(3), np.asarray(t).reshape(3)) for r, t in zip(turns, shifts)]
    seen = views.seen
    errors = [v.pixels - _projected(model, v.board, *pose, K, k) for v, pose in zip(seen, poses)]
    view_rms = np.array([np.sqrt((e**2).sum(axis=1).mean()) for e in errors])
    sd = intrinsics_sd(model, seen, poses, K, k, errors)
    return Calibration(board, views, model, K, k, sd, poses, float(rms), view_rms, coverage(views))


def intrinsics_sd(
    model: str, seen: list[View], poses: list, K: np.ndarray, k: np.ndarray, errors: list[np.ndarray]
) -> np.ndarray:
    """Return the standard deviations (4 + coefficients,) of fx, fy, cx, cy [px] and the coefficients.

    sigma^2 N^-1 with the normal matrix of the intrinsics after the boards' poses are eliminated view by view,
    N = sum A'A - A'B (B'B)^-1 B'A, and sigma^2 = sum of squares / (readings - unknowns); derivatives by differences. What
    is not determined at all is infinite.
    """
    of_camera = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *k])
    N = np.zeros((len(of_camera),) * 2)
    for view, pose in zip(seen, poses):
        unknowns = np.concatenate([of_camera, *pose])
        both = _derivatives(partial(_seen_by_unknowns, model, view.board, len(of_camera)), unknowns)
        A, B = both[:, : len(of_camera)], both[:, len(of_camera) :]
        N += A.T @ A - A.T @ B @ np.linalg.solve(B.T @ B, B.T @ A)
    squares = sum(float((e**2).sum()) for e in errors)
    free = 2 * sum(len(e) for e in errors) - len(of_camera) - 6 * len(seen)
    scale = 1 / np.sqrt(np.maximum(np.diag(N), 1e-300))
    values, vectors = np.linalg.eigh(N * np.outer(scale, scale))
    with np.errstate(divide="ignore"):
        spread = np.where(values > 1e-14, 1 / np.where(values > 0, values, 1), np.inf)
    variance = np.einsum("ik,k,ik->i", vectors, np.minimum(spread, 1e300), vectors) * scale**2
    return np.sqrt(variance * squares / max(free, 1))


def _seen_by_unknowns(model: str, board: np.ndarray, count: int, p: np.ndarray) -> np.ndarray:
    """Return pixels (C, 2) by fx, fy, cx, cy and coefficients (count), then the rotation vector and translation."""
    K = np.array([[p[0], 0, p[2]], [0, p[1], p[3]], [0, 0, 1]])
    return _projected(model, board, p[count : count + 3], p[count + 3 :], K, p[4:count])


def _derivatives(f, p: np.ndarray) -> np.ndarray:
    """Return the derivatives (2 C, P) of pixels (C, 2) by central differences."""
    columns = []
    for i in range(len(p)):
        h = np.zeros(len(p))
        h[i] = 1e-5 * max(1.0, abs(p[i]))
        columns.append(((f(p + h) - f(p - h)) / (2 * h[i])).ravel())
    return np.stack(columns, axis=1)


def _projected(model: str, board: np.ndarray, turn, shift, K: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Return the pixels (C, 2) of board points (C, 3) [mm] as OpenCV has them."""
    points, k = np.asarray(board, np.float64)[:, None], np.asarray(k, np.float64)
    if model == "pinhole":
        return cv2.projectPoints(points, turn, shift, K, k)[0].reshape(-1, 2)
    turn, shift = (np.asarray(x, np.float64).reshape(3, 1) for x in (turn, shift))
    return cv2.fisheye.projectPoints(points, turn, shift, K, k)[0].reshape(-1, 2)


def without_distortion(calibration: Calibration, image: np.ndarray) -> np.ndarray:
    """Return an image as a pinhole of the same focal lengths and principal point would show it.

    Parameters
    ----------
    calibration : Calibration
        Of the camera.
    image : numpy.ndarray
        (H, W), of the camera's size.

    Returns
    -------
    numpy.ndarray
        (H, W), the same type.
    """
    straight = calibration.camera.model_copy(update={"distortion": None})
    u, v = np.moveaxis(places_in(calibration.camera, straight, 1.0).astype(np.float32), -1, 0)
    return cv2.remap(image, np.ascontiguousarray(u), np.ascontiguousarray(v), cv2.INTER_LINEAR)
