"""A camera's pose from indentations at known places: the stage moves the target, the flow shows where it is in the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from gelforge.config import Camera, Sensor
from gelforge.recording.imaging.flow import Flow, read_grey
from gelforge.recording.imaging.image_measures import PRESET
from gelforge.recording.imaging.images import image_path, reference_path
from gelforge.recording.optics.calibration import OUTLIER
from gelforge.recording.optics.camera import CameraError, image_axes, project
from gelforge.recording.optics.expansion import centre_of_expansion
from gelforge.recording.readings import Recording, at_commanded_depth

# Poses of drawn presses and their errors: `python benchmarks/cameras.py`:
LEAST_POSITIONS = 4  # three determine the four unknowns twice over only with a fourth's residual
# Spread of the positions across their line, over that along it: positions on a line are refused
# (tests/recording/test_camera_pose.py).
LEAST_WIDTH = 0.1
# Errors fall with the root of the number: 40 have 0.16 of that of one, and cost some seconds (benchmarks/cameras.py).
MOST_PRESSES = 40
UNKNOWNS = ("x", "y", "z", "turn about z")
UNITS = ("mm", "mm", "mm", "deg")


@dataclass(frozen=True)
class Pose:
    """A camera whose position and turn about z were fitted; the rest is as it was given."""

    camera: Camera
    sd: np.ndarray  # (4,) x, y, z [mm], turn about z [deg]; z is 0 for a flat scale, which has none
    rms_px: float
    places_mm: np.ndarray  # (P, 2)
    left_out: dict[str, str]
    per_tilt_mm: float  # by how much a tilt of 1 deg that is not known moves the position found
    per_tilt_px: float  # and by how much it changes the residual, which could show it


def particle_plane_mm(sensor: Sensor) -> float:
    """Return the mean height of the particles: layers by thickness and volume share.

    Parameters
    ----------
    sensor : Sensor
        Layers with `particle_volume_fraction` carry particles.

    Returns
    -------
    float
        z [mm] in the sensor frame; 0 is the top surface, negative is below.

    Raises
    ------
    CameraError
        For a sensor whose layers carry none.
    """
    z, weights, heights = -sensor.height_mm, [], []
    for layer in sensor.layers:
        weights.append(layer.particle_volume_fraction * layer.thickness_mm)
        heights.append(z + layer.thickness_mm / 2)
        z += layer.thickness_mm
    if not sum(weights):
        raise CameraError(
            "no layer has particle_volume_fraction above 0, so that the plane of the particles is not known; state it, "
            "or give --plane-z-mm"
        )
    return float(np.average(heights, weights=weights))


def press_centres(recording: Recording, camera: Camera) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Return the names, places and centres of indentations whose images show where they are.

    Each indentation's last image at its depth, of those at least half as deep as the deepest; at most MOST_PRESSES, evenly
    taken.

    Parameters
    ----------
    recording : Recording
        With images.
    camera : Camera
        That took them; its focal length, where known, gives the vanishing point of the vertical.

    Returns
    -------
    list of str
        Names of P indentations.
    numpy.ndarray
        Places (P, 2) on the sensor [mm].
    numpy.ndarray
        Centres (P, 2) in the image [px].

    Raises
    ------
    CameraError
        Where the session's images are of another size than the camera's.
    """
    rows = recording.readings
    rows = rows[at_commanded_depth(rows) & (rows["image"] != "").to_numpy()]
    rows = rows[rows["depth_mm"] >= 0.5 * rows["depth_mm"].max()].groupby("press", sort=False).last()
    if len(rows) > MOST_PRESSES:
        rows = rows.iloc[np.linspace(0, len(rows) - 1, MOST_PRESSES).round().astype(int)]
    if rows.empty:
        return [], np.empty((0, 2)), np.empty((0, 2))
    reference = read_grey(reference_path(recording.folder))
    if reference.shape != (camera.height_px, camera.width_px):
        raise CameraError(
            f"{reference_path(recording.folder)}: {reference.shape[1]} x {reference.shape[0]} px, but the camera has "
            f"{camera.width_px} x {camera.height_px} px; calibrate with images of the session's size"
        )
    search = Flow(reference, PRESET)
    axes = image_axes(camera)
    e = None
    if camera.focal_px is not None:
        up = axes[:, 2]  # the sensor's z along u, v and the view
        e = np.asarray(camera.centre_px) + camera.focals_px * up[:2] / up[2]
    names, places, centres = [], [], []
    for name, row in rows.iterrows():
        centre = centre_of_expansion(search(read_grey(image_path(recording.folder, row["image"]))), e)
        if centre is not None:
            names.append(str(name))
            places.append([row["x_mm"], row["y_mm"]])
            centres.append(centre)
    return names, np.reshape(places, (-1, 2)), np.reshape(centres, (-1, 2))


def fit_pose(
    camera: Camera, names: list[str], places: np.ndarray, centres: np.ndarray, plane_z_mm: float
) -> Pose:
    """Return a camera's pose by indentations that it shows on a horizontal plane.

    Fitted are the position and the turn about z. Held are the tilts about x and y, which at one height look like a shift,
    and everything of the lens. Only the distance from the plane to the pinhole shows: z is wrong by what plane_z_mm is.

    Parameters
    ----------
    camera : Camera
        Its lens, and the pose from which the fit starts.
    names : list of str
        P names of the indentations, for what is left out.
    places : numpy.ndarray
        (P, 2) [mm] in the sensor frame.
    centres : numpy.ndarray
        (P, 2) [px] at which they are seen.
    plane_z_mm : float
        Height of the plane in the sensor frame.

    Returns
    -------
    Pose
        Camera, standard deviations, error [px], and indentations left out.

    Raises
    ------
    CameraError
        For fewer than 4 positions, positions on a line, and images mirrored otherwise than described.
    """
    _check_places(places)
    kept, left_out = np.ones(len(places), bool), {}
    fitted = _fit(camera, places, centres, plane_z_mm)
    size = np.linalg.norm(fitted[1], axis=1)
    far = size > max(OUTLIER * float(np.median(size)), 1.0)
    if far.any():
        left_out = {
            names[k]: f"{size[k]:.1f} px off, limit {OUTLIER:g} x the median" for k in np.flatnonzero(far)
        }
        kept = ~far
        _check_places(places[kept])
        fitted = _fit(camera, places[kept], centres[kept], plane_z_mm)
    posed, residual, J = fitted
    free = max(residual.size - J.shape[1], 1)
    covariance = np.linalg.inv(J.T @ J) * float((residual**2).sum()) / free
    sd = np.zeros(4)
    sd[: J.shape[1]] = np.sqrt(np.diag(covariance))
    if J.shape[1] == 3:  # a flat scale: x, y, turn
        sd[2:] = 0.0, sd[2]
    rotation = camera.rotation_deg
    tilted = camera.model_copy(update={"rotation_deg": [rotation[0] + 1, *rotation[1:]]})
    other, its, _ = _fit(tilted, places[kept], centres[kept], plane_z_mm)
    moved = np.linalg.norm(np.subtract(other.position_mm, posed.position_mm))
    rms = [float(np.sqrt((r**2).sum(axis=1).mean())) for r in (residual, its)]
    return Pose(posed, sd, rms[0], places[kept], left_out, float(moved), abs(rms[1] - rms[0]))


def _check_places(places: np.ndarray) -> None:
    distinct = np.unique(np.round(places, 2), axis=0)
    if len(distinct) < LEAST_POSITIONS:
        raise CameraError(
            f"images move at {len(distinct)} position(s), {LEAST_POSITIONS} are needed; press near the corners of what the "
            "camera sees too"
        )
    along, across = np.linalg.svd(distinct - distinct.mean(axis=0), compute_uv=False)
    if across < LEAST_WIDTH * along:
        raise CameraError(
            f"the {len(distinct)} positions lie nearly on a line ({across / along:.3f} as wide as long, limit "
            f"{LEAST_WIDTH:g}); press to its sides too"
        )


def _fit(
    camera: Camera, places: np.ndarray, centres: np.ndarray, z: float
) -> tuple[Camera, np.ndarray, np.ndarray]:
    """Return the camera, the residuals (P, 2) [px] and their derivatives (2 P, 3 or 4) to the unknowns."""
    points = np.column_stack([places, np.full(len(places), z)])
    start = _start(camera, places, centres, z)
    flat = camera.focal_px is None
    highest = min(z, camera.port.z_mm if camera.port else z) - 0.1

    def posed(p: np.ndarray) -> Camera:
        height = camera.position_mm[2] if flat else float(p[2])
        turn = [*camera.rotation_deg[:2], float(p[-1])]
        update = {"position_mm": [float(p[0]), float(p[1]), height], "rotation_deg": turn}
        return camera.model_copy(update=update)

    upper = [np.inf, np.inf, np.inf] if flat else [np.inf, np.inf, highest, np.inf]
    first = start[[0, 1, 3]] if flat else np.minimum(start, [np.inf, np.inf, highest - 0.1, np.inf])
    solution = least_squares(
        lambda p: (project(posed(p), points)[0] - centres).ravel(), first, bounds=(-np.inf, upper), xtol=1e-12
    )
    return posed(solution.x), solution.fun.reshape(-1, 2), solution.jac


def _start(camera: Camera, places: np.ndarray, centres: np.ndarray, z: float) -> np.ndarray:
    """Return x, y, z [mm] and the turn about z [deg] of a camera that looks straight up, by the affine map of places."""
    design = np.column_stack([places, np.ones(len(places))])
    affine = np.linalg.lstsq(design, centres, rcond=None)[0]
    M, offset = affine[:2].T, affine[2]  # centres = M place + offset
    mirrored = bool(np.linalg.det(M) < 0)  # u runs with x and v against y
    if mirrored != camera.mirrored:
        raise CameraError(
            f"the images move as {'mirrored' if mirrored else 'unmirrored'} ones do, but the camera has mirrored: "
            f"{str(camera.mirrored).lower()}; write mirrored: {str(mirrored).lower()}, or correct stage_to_sensor.handedness"
        )
    N = np.diag([1.0 if mirrored else -1.0, -1.0]) @ M  # scale times a turn by minus the camera's
    turn = -np.degrees(np.arctan2(N[1, 0] - N[0, 1], N[0, 0] + N[1, 1]))
    xy = np.linalg.solve(M, np.asarray(camera.centre_px) - offset)
    distance = 0.0 if camera.focal_px is None else camera.focal_px / np.sqrt(abs(np.linalg.det(M)))
    return np.array([*xy, z - distance, turn])
