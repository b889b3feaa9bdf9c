"""The camera's scale is off: focal length, or millimetres per pixel."""

from collections.abc import Sequence

from gelforge.config import Camera, Study, given
from gelforge.mismatch.model.effect import Effect, Parameter


def to_camera(study: Study, camera: Camera, theta: Sequence[float]) -> Camera:
    """Return the camera with everything seen larger."""
    (a,) = theta
    if camera.focal_px is not None:
        grown = {"focal_px": camera.focal_px * (1 + a)}
        if camera.focal_y_px is not None:
            grown["focal_y_px"] = camera.focal_y_px * (1 + a)
        return Camera(**(camera.model_dump() | grown))
    flat = given(camera.mm_per_px, "camera.mm_per_px")
    return Camera(**(camera.model_dump() | {"mm_per_px": flat / (1 + a)}))


SOURCE = "width: a scale read off one known length in the image (judgement); bounds: another lens"
EFFECT = Effect(
    name="camera_scale",
    family="camera",
    parameters=(Parameter("growth", "1", 0.02, (-0.3, 0.3), SOURCE),),
    means=("the camera's scale is off",),
    signature="all flow in proportion, along its own direction; forces clean",
    separated_by="a ruler or a checkerboard at the gel's height",
    to_camera=to_camera,
)
