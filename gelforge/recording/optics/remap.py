"""Images of one camera as another would have taken them: every pixel of the view shows the same point of one plane.

For points of that plane the remap is exact: focal lengths, principal point, distortion, rotation, position and port of both
cameras are in it. A point at another height is seen from another place: where the pinholes stand apart it is off by about
focal length x distance between the pinholes x height over the plane / distance^2 (parallax). With the pinholes in one place
nothing is off but for ports, whatever the heights.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np

from gelforge.config import Camera, Session, given
from gelforge.recording.imaging.flow import ImageError, crop, read_grey, reduced
from gelforge.recording.optics.camera import CameraError, project, unproject

# Errors of remapped images: `python benchmarks/cameras.py`:
# share of the view that the camera must see; what it does not is made of the border's pixels
LEAST_SEEN = 0.9
# Images closer than this are used as they are: half of what the best flow errs by, 0.043 px (tests/recording/test_flow.py).
SAME_PX = 0.02
Picture = Callable[[np.ndarray], np.ndarray]


def places_in(
    camera: Camera, view: Camera, plane_z_mm: float, crop_px: list[int] | None = None, scale: float = 1.0
) -> np.ndarray:
    """Return where in the camera's image (H, W, 2) [px] each pixel of the view lies, by way of the plane z = plane_z_mm.

    crop_px: of this part of the view only; scale: of its pixels after `reduced`.
    """
    left, top, width, height = crop_px or (0, 0, view.width_px, view.height_px)
    u, v = (np.arange(round(scale * size)) for size in (width, height))
    middles = np.meshgrid(left + (u + 0.5) / scale - 0.5, top + (v + 0.5) / scale - 0.5)
    return project(camera, unproject(view, np.stack(middles, axis=-1), plane_z_mm))[0]


class Remapper:
    """Images of a camera as a view shows them; the map is made once.

    crop_px: the part of the view that is wanted; scale: it is reduced to this share of its size, in the same step.
    Raises ImageError where the camera sees too little of the view, or an
    image is not of the camera's size.
    """

    def __init__(
        self,
        camera: Camera,
        view: Camera,
        plane_z_mm: float,
        crop_px: list[int] | None = None,
        scale: float = 1.0,
    ) -> None:
        places = places_in(camera, view, plane_z_mm, crop_px, scale)
        size = np.array([camera.width_px, camera.height_px])
        self.seen = float(np.mean(np.all((places > -0.5) & (places < size - 0.5), axis=-1)))
        if self.seen < LEAST_SEEN:
            raise ImageError(
                f"the camera sees {self.seen:.0%} of the reference view at z = {plane_z_mm:g} mm, limit {LEAST_SEEN:.0%}; "
                "give remap.view fewer pixels or a shorter focal length, or correct the camera's pose"
            )
        self.size = (camera.height_px, camera.width_px)
        no_second = np.empty(0, np.float32)
        self.maps = cv2.convertMaps(places.astype(np.float32), no_second, cv2.CV_16SC2)

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """Return an image (H, W) or (H, W, 3) of the camera as the view shows it; outside it the border is continued."""
        if image.shape[:2] != self.size:
            raise ImageError(
                f"image of {image.shape[1]} x {image.shape[0]} px, but its camera is described with {self.size[1]} x "
                f"{self.size[0]} px; calibrate at the size that is recorded"
            )
        return cv2.remap(image, self.maps[0], self.maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def picture_of(session: Session, scale: float = 1.0) -> Picture:
    """Return the function that makes of a session's image as recorded the one whose flow is searched.

    Parameters
    ----------
    session : Session
        It says whether images are remapped, cropped or taken as they are.
    scale : float
        `features.image_scale`: images are reduced to this share of their size.

    Returns
    -------
    callable
        (H, W) uint8 to (h, w) uint8.

    Raises
    ------
    ConfigError
        For a session that is remapped and describes no camera.
    """
    if session.remap:
        return Remapper(
            given(session.camera, "camera"), session.remap.view, session.remap.plane_z_mm, scale=scale
        )
    return lambda image: reduced(crop(image, session.crop_px), scale)


def read_as(picture: Picture, path: str | Path) -> np.ndarray:
    """Return an image file as grey levels (H, W) uint8, remapped or cropped. Raises ImageError naming the file."""
    image = read_grey(path)
    try:
        return picture(image)
    except ImageError as error:
        raise ImageError(f"{path}: {error}") from None


def seen_by(session: Session) -> Camera | None:
    """Return the camera that sees what `picture_of` shows, before any cropping.

    Parameters
    ----------
    session : Session
        Its keys `remap` and `camera`.

    Returns
    -------
    Camera or None
        None where the session names no camera.
    """
    return session.remap.view if session.remap else session.camera


def view_of(session: Session, scale: float = 1.0) -> dict:
    """Return what the images are whose flow is searched: size [px], the part that is used, and the camera.

    Of a remapped session the reference view, with the plane on which it is exact. Size and part are those before images are
    reduced; `image_scale` is there where they are.
    """
    camera = seen_by(session)
    view = {
        "image_px": [camera.width_px, camera.height_px] if camera else None,
        "crop_px": session.crop_px,
        "camera": camera.model_dump(mode="json") if camera else None,
    }
    plane = {"plane_z_mm": session.remap.plane_z_mm} if session.remap else {}
    return view | plane | scale_of_view(scale)


def scale_of_view(scale: float) -> dict:
    """Return the key of a view that says to which share of their size its images are reduced; none where they are not.

    Parameters
    ----------
    scale : float
        The share [-], at most 1.

    Returns
    -------
    dict
        `image_scale`, or empty.
    """
    return {"image_scale": scale} if scale < 1 else {}


def remap_to(
    views: Mapping[str, dict],
    camera: Camera | None,
    plane_z_mm: float | None,
    crop_px: list[int] | None,
    scale: float = 1.0,
) -> Remapper | None:
    """Return what makes a camera's images those that a model learnt from.

    Parameters
    ----------
    views : mapping of str to dict
        By session, as `view_of` returns them: what the model learnt from.
    camera : Camera or None
        The camera that takes the images; None where it is not known.
    plane_z_mm : float or None
        Height of the plane [mm, sensor frame] that both views show at one scale.
    crop_px : list of int or None
        Left, top, width and height [px] that images are cropped to.
    scale : float
        What is remapped is reduced to this share of its size too.

    Returns
    -------
    Remapper or None
        None where images are as the model's.

    Raises
    ------
    ImageError
        Where the camera must be known and is not, or differs from the model's with no way to remap.
    """
    remapped = {name: view for name, view in views.items() if view.get("plane_z_mm") is not None}
    if camera is None:
        if remapped:
            raise ImageError(
                f"the model learnt from images remapped to a reference view (session {next(iter(remapped))}); give --camera "
                "with the calibration and pose of the camera that takes these frames"
            )
        return None
    cameras = {name: Camera.model_validate(view["camera"]) for name, view in views.items() if view["camera"]}
    if not cameras:
        raise ImageError(
            "the model knows no camera of the images that it learnt from, so that nothing can be remapped to it; leave out "
            "--camera, or train on sessions whose session.yaml describes the camera"
        )
    if camera in cameras.values():
        return None
    name, view = next(iter(cameras.items()))
    differs = f"the frames' camera differs from the model's (session {name}): {differences(camera, view)}"
    if any(other != view for other in cameras.values()):
        raise ImageError(
            f"{differs}; the model learnt from {len(cameras)} sessions with several cameras and no one view to remap to; "
            "train it on sessions with one `remap`"
        )
    z = views[name].get("plane_z_mm", plane_z_mm)
    if z is None:
        raise ImageError(
            f"{differs}; to remap the frames say at which height the particles are, --plane-z-mm (mean, sensor frame)"
        )
    if crop_px is not None:
        raise ImageError(
            f"--crop {crop_px} and --camera are both given: {differs}, and remapped frames show the model's view; leave out"
            " --crop"
        )
    pixels = np.stack(np.meshgrid(np.arange(view.width_px), np.arange(view.height_px)), axis=-1)
    same_size = (camera.width_px, camera.height_px) == (view.width_px, view.height_px)
    if same_size and np.abs(places_in(camera, view, z) - pixels).max() < SAME_PX:
        return None
    try:
        return Remapper(camera, view, z, views[name]["crop_px"], scale)
    except (ImageError, CameraError) as error:
        raise ImageError(f"{differs}; {error}") from None


def differences(camera: Camera, view: Camera) -> str:
    """Return what differs between two cameras, a few words per key."""
    described, known = camera.model_dump(), view.model_dump()
    keys = [key for key in {**known, **described} if described.get(key) != known.get(key)]
    return ", ".join(f"{key} {described.get(key)} instead of {known.get(key)}" for key in keys)
