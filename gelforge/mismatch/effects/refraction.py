"""Light is bent where it leaves the gel: a camera calibrated in air sees particles nearer than they are."""

from collections.abc import Sequence

from gelforge.config import Camera, Study
from gelforge.mismatch.model.effect import Effect, Parameter


def to_camera(study: Study, camera: Camera, theta: Sequence[float]) -> Camera:
    """Return the camera in air that sees what this one sees through the base's lower face, index n = 1 + theta above it.

    A point at height h over the face, Z below it the pinhole: u = f X / (Z + h / n) = (n f) X / (n Z + h), near the axis.
    Parallel rays, as of a flat scale, are not bent; a camera whose port is described has the bending in it already.
    """
    (a,) = theta
    if camera.focal_px is None or camera.port is not None:
        return camera
    x, y, z = camera.position_mm
    below = -study.sensor.height_mm - z
    if below <= 0:
        raise ValueError(
            f"camera.position_mm z = {z:g} mm lies in the gel, whose lower face is at {-study.sensor.height_mm:g} mm;"
            " refraction is known for a camera below it"
        )
    seen = {"focal_px": camera.focal_px * (1 + a), "position_mm": [x, y, z - a * below]}
    if camera.focal_y_px is not None:
        seen["focal_y_px"] = camera.focal_y_px * (1 + a)
    return Camera(**(camera.model_dump() | seen))


SOURCE = "width: silicones have 1.40 to 1.43; bounds: no glass or polymer in use has more"
EFFECT = Effect(
    name="refraction",
    family="camera",
    parameters=(Parameter("index_less_1", "1", 0.4, (0.0, 0.7), SOURCE),),
    means=("the camera looks through more refraction than assumed",),
    signature="flow larger everywhere, and less of it from motion along the view; forces clean",
    separated_by="a checkerboard seen through the gel and without it",
    to_camera=to_camera,
)
