"""Images in messages: ROS's Image and CompressedImage, Foxglove's CompressedImage and CompressedVideo."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gelforge.importing.messages import field, messages, seconds
from gelforge.importing.refusals import ImportingError
from gelforge.recording.imaging.frames import decoded

# Of a pixel, by the encodings of sensor_msgs (image_encodings.hpp of ROS 2 Humble, 2022).
CHANNELS = {"mono8": 1, "8UC1": 1, "rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4, "8UC4": 4}
TO_BGR = {"rgb8": cv2.COLOR_RGB2BGR, "rgba8": cv2.COLOR_RGBA2BGR, "bgra8": cv2.COLOR_BGRA2BGR}
VIDEO = {"h264": ".h264", "h265": ".h265"}  # bare streams, which OpenCV reads from a file


def message_images(path: Path, topic: str | None, key: str) -> Iterator[tuple[str, float, np.ndarray]]:
    """Yield name, stamp [s] and image (H, W) or (H, W, 3) BGR uint8 of every message of a topic."""
    records = messages(path, topic, key)
    for number, (received, message) in enumerate(records):
        form = str(_get(message, "format", ""))
        if form in VIDEO:
            yield from _video(path, topic, VIDEO[form], (received, message), records)
            return
        name = f"{topic}#{number}"
        yield name, _stamp(message, received), _image(path, name, message, form)


def _get(message: Any, name: str, default: Any = None) -> Any:
    try:
        return field(message, name)
    except LookupError:
        return default


def _stamp(message: Any, received: float) -> float:
    """Return when an image was taken as its message says [s], or else when it was recorded."""
    stamp = _get(message, "header.stamp", _get(message, "timestamp"))
    return received if stamp is None else seconds(stamp)


def _bytes(message: Any) -> bytes:
    data = _get(message, "data", b"")
    return base64.b64decode(data) if isinstance(data, str) else bytes(data)


def _image(path: Path, name: str, message: Any, form: str) -> np.ndarray:
    data = _bytes(message)
    encoding = _get(message, "encoding")
    if encoding is None:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
        if image is None:
            raise ImportingError(
                f"{path}: {name} has no image that can be decoded (format {form!r}); name a topic of images"
            )
        return image
    height, width, step = (int(_get(message, part, 0)) for part in ("height", "width", "step"))
    channels = CHANNELS.get(encoding, 0)
    if not channels or height * step > len(data) or width * channels > step or not height:
        raise ImportingError(
            f"{path}: {name} is {width} x {height} of encoding {encoding!r} in {len(data)} bytes;"
            f" {', '.join(CHANNELS)} are read, convert the topic"
        )
    rows = np.frombuffer(data, np.uint8)[: height * step].reshape(height, step)[:, : width * channels]
    image = rows.reshape(height, width, channels) if channels > 1 else rows
    return cv2.cvtColor(np.ascontiguousarray(image), TO_BGR[encoding]) if encoding in TO_BGR else image


def _video(
    path: Path, topic: str | None, suffix: str, first, rest
) -> Iterator[tuple[str, float, np.ndarray]]:
    """Yield the frames of a stream of video, one per message. Raises ImportingError where their numbers differ."""
    stamps, number = [], 0
    with tempfile.TemporaryDirectory() as folder:
        stream = Path(folder) / f"stream{suffix}"
        with open(stream, "wb") as file:
            for received, message in chain([first], rest):
                stamps.append(_stamp(message, received))
                file.write(_bytes(message))
        for _, image in decoded(cv2.VideoCapture(str(stream))):
            if number < len(stamps):
                yield f"{topic}#{number}", stamps[number], image
            number += 1
    if number != len(stamps):
        raise ImportingError(
            f"{path}: {topic} decodes to {number} frames of {len(stamps)} messages; its stamps cannot be matched: export the"
            " topic as images"
        )
