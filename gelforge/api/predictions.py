"""Force distributions from images, by a trained model."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from gelforge.api import arguments

if TYPE_CHECKING:
    from gelforge.learning.deployment.predictor import Prediction


def predict(
    model: str | Path, images: str | Path | int, *, reference: str | Path | None = None, threads: int = 1
) -> Iterator[Prediction]:
    """Yield the force distribution of each image.

    Parameters
    ----------
    model : path
        model.onnx, or model.pt, which takes some seconds more to open.
    images : path or int
        A folder of images (in the order of their names), a video, or the number of a camera.
    reference : path, optional
        The image of the untouched sensor; the first image if there is none.
    threads : int
        Of the network.

    Yields
    ------
    Prediction
        `force_N` (B, 3) on the sensor [N], `time_s`, and `disagreement`: beyond 1 the total force is not that of inverse
        elasticity, nan where that is not known.

    Raises
    ------
    ImageError
        Images that are missing or of another size than the model's.
    ConfigError
        An argument of another kind than these.

    Examples
    --------
    A model is made by a study, so that this one is not run with the tests:

    >>> import gelforge as gf
    >>> for frame in gf.predict("results/mine/model/model.onnx", "images"):  # doctest: +SKIP
    ...     print(frame.time_s, frame.force_N.sum(axis=0))
    """
    from gelforge.learning.deployment.predictor import Predictor, predict_frames
    from gelforge.recording.imaging.flow import read_grey
    from gelforge.recording.imaging.frames import frames

    model = arguments.path("model", model, "model.onnx or model.pt")
    if not isinstance(images, int):
        images = arguments.path("images", images, "a folder of images or of a video, or a camera's number")
    untouched = (
        None if reference is None else read_grey(arguments.path("reference", reference, "an untouched image"))
    )
    return predict_frames(Predictor(model, arguments.whole("threads", threads)), frames(images), untouched)
