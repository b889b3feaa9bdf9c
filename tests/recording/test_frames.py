"""Frames from a folder and from a video come in order, grey, with their times."""

import cv2
import numpy as np
import pytest

from gelforge.recording.imaging.flow import ImageError
from gelforge.recording.imaging.frames import frames


def test_a_folder_gives_its_images_by_name_and_a_sessions_folder_names_them(tmp_path):
    # A folder gives its images by name
    for number in (10, 2, 1):
        cv2.imwrite(str(tmp_path / f"{number:02d}.png"), np.full((40, 50), number, np.uint8))
    (tmp_path / "notes.txt").write_text("no image")
    found = list(frames(tmp_path))
    assert [frame.name for frame in found] == ["01.png", "02.png", "10.png"]
    assert [int(frame.image[0, 0]) for frame in found] == [1, 2, 10]
    assert all(np.isnan(frame.time_s) for frame in found)

    # The folder of a session names its images and its reference
    session = tmp_path / "session"
    session.mkdir()
    (session / "images").mkdir()
    for name in ("reference.png", "images/a.png"):
        cv2.imwrite(str(session / name), np.full((40, 50), 7, np.uint8))
    (session / "session.yaml").touch()
    with pytest.raises(ImageError, match=r"images, with --reference .*reference\.png"):
        frames(session)
    assert len(list(frames(session / "images"))) == 1


def test_a_video_gives_grey_frames_with_times(tmp_path):
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 20.0, (64, 48))
    for level in (50, 100, 150):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    found = list(frames(path))
    assert [frame.image.shape for frame in found] == [(48, 64)] * 3
    assert np.allclose([frame.image.mean() for frame in found], [50, 100, 150], atol=3)  # JPEG
    assert np.allclose(np.diff([frame.time_s for frame in found]), 0.05, atol=1e-3)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("absent", "no such folder or video"),
        ("empty", "no images"),
        ("broken.avi", "cannot be opened"),
        ("97", "camera 97"),
    ],
)
def test_sources_that_give_nothing_are_named_at_once(tmp_path, source, message):
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.avi").write_bytes(b"RIFF nothing")
    with pytest.raises(ImageError, match=message):
        frames(source if source.isdecimal() else tmp_path / source)
