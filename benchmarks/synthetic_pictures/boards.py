"""Images of a calibration board through a known camera: each pixel shows what its rays meet on the board's plane."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from gelforge.config import Camera
from gelforge.recording.optics.boards import Board
from gelforge.recording.optics.camera import unproject

PX_PER_SQUARE, MARGIN = 60, 1.0  # of the drawn board; white around it, in squares
FINER = 2  # rays per pixel along each axis
BLACK, WHITE, GROUND = 30, 220, 128  # grey levels of a print in daylight, of which noise clips none
BLUR_PX, NOISE_GREY = 0.7, 2.0


def draw_flat(board: Board) -> np.ndarray:
    """Return the board (H, W) uint8 with its margin, PX_PER_SQUARE pixels a square."""
    margin = int(MARGIN * PX_PER_SQUARE)
    if board.marker_mm is not None:
        size = (board.columns * PX_PER_SQUARE + 2 * margin, board.rows * PX_PER_SQUARE + 2 * margin)
        flat = board.charuco().generateImage(size, marginSize=margin)
        return (BLACK + flat.astype(float) * (WHITE - BLACK) / 255).astype(np.uint8)
    row, column = np.mgrid[: board.rows + 1, : board.columns + 1]
    squares = np.where((row + column) % 2 == 0, BLACK, WHITE).astype(np.uint8)
    flat = np.kron(squares, np.ones((PX_PER_SQUARE, PX_PER_SQUARE), np.uint8))
    return np.pad(flat, margin, constant_values=WHITE)


class BoardCamera:
    """Draws a board as a camera sees it; the camera's own pose plays no part.

    u, v, w: to the right, down and along the view of the camera, from its pinhole.
    """

    def __init__(self, camera: Camera, board: Board) -> None:
        self.camera, self.board, self.flat = camera, board, draw_flat(board)
        at_origin = {"position_mm": [0, 0, 0], "rotation_deg": [0, 0, 0], "mirrored": True, "port": None}
        at = (np.arange(FINER) + 0.5) / FINER - 0.5
        u = (np.arange(camera.width_px)[:, None] + at).ravel()
        v = (np.arange(camera.height_px)[:, None] + at).ravel()
        rays = unproject(camera.model_copy(update=at_origin), np.stack(np.meshgrid(u, v), -1), 1.0)
        self.rays = rays.reshape(-1, 3) * [1, -1, 1]

    def __call__(self, tilt_deg, middle_mm: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return the image (H, W) uint8 of the board turned about u, v, w by tilt_deg, its middle at middle_mm (3,) [mm]."""
        turn = Rotation.from_euler("xyz", tilt_deg, degrees=True).as_matrix()
        # the plane's homography: a ray r meets the board at (a r, b r) / (c r) from its middle
        normal = turn[:, 2]
        onto = [(normal @ middle_mm) * turn[:, k] - (turn[:, k] @ middle_mm) * normal for k in (0, 1)]
        x, y, c = (self.rays @ np.array([*onto, normal]).T).T
        scale = PX_PER_SQUARE / self.board.square_mm
        ahead = c * (normal @ middle_mm) > 0
        safe = np.where(ahead, c, 1.0)
        middle = (np.array(self.flat.shape[::-1]) - 1) / 2
        places = [np.where(ahead, scale * part / safe + m, -1e4) for part, m in zip((x, y), middle)]
        camera = self.camera
        shape = (camera.height_px * FINER, camera.width_px * FINER)
        map_x, map_y = (np.clip(part, -1e4, 1e4).astype(np.float32).reshape(shape) for part in places)
        seen = cv2.remap(
            self.flat, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=GROUND
        )
        mean = cv2.resize(
            seen.astype(np.float32), (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA
        )
        noisy = cv2.GaussianBlur(mean, (0, 0), BLUR_PX) + rng.normal(0, NOISE_GREY, mean.shape)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def poses(
    count: int, distance_mm: float, width_mm: float, height_mm: float, seed: int, tilt_deg: float = 35.0
):
    """Yield tilts (3,) [deg] and middles (3,) [mm] of a board that goes around the view: to all sides, turned to all sides.

    width_mm, height_mm: how far the middle goes from side to side at that distance.
    """
    rng = np.random.default_rng(seed)
    for number in range(count):
        turn = 2.4 * number  # the golden angle: any first few are spread
        where = np.sqrt((number + 0.5) / count)
        tilt = [tilt_deg * np.cos(1.7 * turn), tilt_deg * np.sin(1.7 * turn), rng.uniform(-15, 15)]
        aside = [width_mm / 2 * where * np.cos(turn), height_mm / 2 * where * np.sin(turn)]
        yield tilt, np.array([*aside, distance_mm * rng.uniform(0.85, 1.15)])
