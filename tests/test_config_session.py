"""What session.yaml says of what a laboratory knows: dates, noise by axis, and the two errors of the depth."""

import warnings

import pytest
import yaml

from gelforge.cli.study.new_study import new_study_files
from gelforge.config import ConfigError, ForceSensor, load_session, write_yaml


def written(folder, text: str):
    path = folder / "session.yaml"
    path.write_text(f"session: s1\n{text}\n")
    return path


@pytest.mark.parametrize(
    ("date", "read"),
    [
        ("2024-05-14", "2024-05-14"),
        ('"2024-05-14"', "2024-05-14"),
        ("2024-05-14 10:30:00", "2024-05-14 10:30:00"),
        ("20240514", "20240514"),
        ("14 May 2024", "14 May 2024"),
        ('""', ""),
    ],
)
def test_a_date_stands_with_quotes_or_without(tmp_path, date, read):
    path = written(tmp_path, f"date: {date}")
    session = load_session(path)
    assert session.date == read
    write_yaml(path, session)
    assert load_session(path) == session


@pytest.mark.parametrize("date", ["20.5", "[2024, 5]", "{day: 14}"])
def test_what_is_no_date_is_refused_in_one_line(tmp_path, date):
    with pytest.raises(ConfigError) as refused:
        load_session(written(tmp_path, f"date: {date}"))
    assert "session.yaml" in str(refused.value) and "\n" not in str(refused.value)


def test_repeatability_stands_by_axis_and_one_number_for_all():
    assert ForceSensor(repeatability_N=[0.01, 0.01, 0.02]).repeatability_N == [0.01, 0.01, 0.02]
    assert ForceSensor(repeatability_N=0.02).repeatability_N == [0.02] * 3
    assert ForceSensor().repeatability_N is None
    for wrong in ([0.01, 0.02], [0.01, 0.01, -0.02], True, "much"):
        with pytest.raises(ValueError):
            ForceSensor(repeatability_N=wrong)


def test_both_errors_of_the_depth_stand_side_by_side(tmp_path):
    keys = "depth_zero: {by: session, session_scatter_mm: 0.01, press_scatter_mm: 0.004}"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        zero = load_session(written(tmp_path, keys)).depth_zero
    assert (zero.session_scatter_mm, zero.press_scatter_mm) == (0.01, 0.004)

    # A former key is refused with the new ones
    with pytest.raises(
        ConfigError, match="depth_zero.scatter_mm.*write session_scatter_mm or.* press_scatter_mm"
    ):
        load_session(written(tmp_path, "depth_zero: {scatter_mm: 0.01}"))


def test_the_session_of_a_new_study_names_both(tmp_path):
    (text,) = (text for path, text in new_study_files("mine").items() if path.name == "session.yaml")
    (tmp_path / "session.yaml").write_text(text)
    assert load_session(tmp_path / "session.yaml").date == "2024-05-14"
    keys = yaml.safe_load(text)
    assert {"press_scatter_mm", "session_scatter_mm"} <= set(keys["depth_zero"])
    assert "repeatability_N" in keys["force"]


def test_an_image_larger_than_any_camera_takes_is_refused(tmp_path):
    camera = "camera: {{width_px: {}, height_px: 96, focal_px: 80, centre_px: [64, 48], position_mm: [16, 16, -25]}}"
    assert load_session(written(tmp_path, camera.format(14204))).camera.width_px == 14204
    with pytest.raises(ConfigError, match=r"camera\.width_px.*128000.*20000") as refused:
        load_session(written(tmp_path, camera.format(128000)))
    assert "\n" not in str(refused.value)
