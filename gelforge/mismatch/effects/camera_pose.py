"""The camera stands or looks otherwise than described."""

from collections.abc import Sequence

from gelforge.config import Camera, Study
from gelforge.mismatch.model.effect import Effect, Parameter

AXES = ("x", "y", "z")
SOURCE = "width: a camera mounted by hand (judgement); bounds: seen by eye"


def to_camera(study: Study, camera: Camera, theta: Sequence[float]) -> Camera:
    """Return the camera shifted (3) and turned (3) in the sensor's frame."""
    position = [p + a for p, a in zip(camera.position_mm, theta[:3], strict=True)]
    rotation = [r + a for r, a in zip(camera.rotation_deg, theta[3:], strict=True)]
    return Camera(**(camera.model_dump() | {"position_mm": position, "rotation_deg": rotation}))


EFFECT = Effect(
    name="camera_pose",
    family="camera",
    parameters=tuple(Parameter(f"shift_{axis}", "mm", 0.5, (-5.0, 5.0), SOURCE) for axis in AXES)
    + tuple(Parameter(f"turn_{axis}", "deg", 1.0, (-15.0, 15.0), SOURCE) for axis in AXES),
    means=("the camera stands or looks elsewhere than assumed",),
    signature="flow centred elsewhere, turned, or larger on one side; forces clean",
    separated_by="a checkerboard in place of the gel; forces, which do not know the camera",
    to_camera=to_camera,
)
