"""Logs in MCAP files, ROS bags and G-code, and images in messages, read like those of CSV files and videos."""

import base64
import json
import sys

import cv2
import numpy as np
import pytest

from gelforge.config import ConfigError
from gelforge.config.foreign.importing import CameraSource, ForceSource, GCode, StageSource
from gelforge.config.studies.files import section_from
from gelforge.importing import camera, message_images
from gelforge.importing.camera import read_film, write_frames
from gelforge.importing.gcode import gcode_table
from gelforge.importing.message_images import message_images as images_of
from gelforge.importing.public import layout_of
from gelforge.importing.public.labelled import Options, write_labelled
from gelforge.importing.refusals import ImportingError
from gelforge.importing.streams import read_force, read_stage

EPOCH = 1_700_000_000
FORCE = {"file": "run.mcap", "topic": "/ft", "unit": "N", "time": {"column": "header.stamp", "unit": "s"},
         "columns": ["wrench.force.x", "wrench.force.y", "wrench.force.z"]}  # fmt: skip
STAGE = {"file": "run.mcap", "topic": "/pose", "unit": "m", "time": {"column": "received", "unit": "s"}, "pressing": "-z",
         "x": "pose.position.x", "y": 2.0, "z": "pose.position.z"}  # fmt: skip


def mcap(path, topics, rate=50.0):
    """Write messages in JSON: topics: by name a list of dictionaries, evenly in time."""
    writer_of = pytest.importorskip("mcap.writer").Writer
    with open(path, "wb") as file:
        writer = writer_of(file)
        writer.start()
        for topic, content in topics.items():
            channel = writer.register_channel(topic, "json", 0)
            for k, message in enumerate(content):
                at = EPOCH * 10**9 + round(k / rate * 1e9)
                writer.add_message(channel, at, json.dumps(message).encode(), at)
        writer.finish()


def header(k, frame="ft", rate=50.0):
    return {"frame_id": frame, "stamp": {"sec": EPOCH, "nanosec": round((k / rate + 0.25) * 1e9)}}


def wrench(k, frame="ft"):
    force = {"x": 0.1 * k, "y": 0.0, "z": -k}
    return {"header": header(k, frame), "wrench": {"force": force, "torque": {"x": 0, "y": 0, "z": 0}}}


def pose(k, frame="base"):
    return {"header": {"frame_id": frame}, "pose": {"position": {"x": 0.01, "y": 0.0, "z": 0.03 - k * 1e-4}}}


def test_fields_of_mcap_messages_are_read_and_spoiled_files_refused(tmp_path, monkeypatch):
    # Fields of mcap messages
    mcap(
        tmp_path / "run.mcap", {"/ft": [wrench(k) for k in range(30)], "/pose": [pose(k) for k in range(30)]}
    )
    force, stage = ForceSource(**FORCE), StageSource(**STAGE)
    log = read_force(tmp_path, force, stage)
    assert log.values[3] == pytest.approx([0.3, 0, -3])
    assert log.time_s[:3] == pytest.approx([0, 0.02, 0.04], abs=1e-6)
    moves = read_stage(tmp_path, stage, force)
    assert moves.values[2] == pytest.approx([10.0, 2.0, -29.8])
    assert log.start_s - moves.start_s == pytest.approx(0.25, abs=1e-6)

    # Files that cannot be opened
    spoiled = tmp_path / "spoiled"
    spoiled.mkdir()
    mcap(spoiled / "run.mcap", {"/ft": [wrench(k) for k in range(60)]})
    whole = (spoiled / "run.mcap").read_bytes()
    (spoiled / "run.mcap").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ImportingError, match=r"run\.mcap: .*mcap recover"):
        read_force(spoiled, ForceSource(**FORCE), StageSource(**STAGE))

    # A library that is not installed
    (spoiled / "run.bag").write_bytes(b"#ROSBAG V2.0\n")
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    source = ForceSource(**(FORCE | {"file": "run.bag"}))
    with pytest.raises(
        ImportingError, match=r'rosbags is needed and not installed .*pip install "gelforge\[bags\]"'
    ):
        read_force(spoiled, source, StageSource(**STAGE))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"topic": "/wrench"}, r"no topic /wrench, it holds /ft \(\); set force\.topic"),
        ({"topic": None}, r"no topic is named, it holds /ft"),
        (
            {"columns": ["fx", "fy", "fz"]},
            r"has no number 'fx', its fields are header, wrench; name a field with dots",
        ),
        ({}, r"are of the frames ft, tool; choose one by force\.frame_id"),
        ({"frame_id": "base"}, r"no message of /ft is of the frame 'base', there are ft, tool"),
        ({"time": {"column": "header.stamp", "unit": "iso"}}, r"set force\.time\.unit: s"),
    ],
)
def test_messages_that_cannot_be_meant(tmp_path, change, said):
    """Among them two robots' or sensors' frames on one topic."""
    content = [wrench(k, "tool" if k % 2 else "ft") for k in range(60)]
    mcap(tmp_path / "run.mcap", {"/ft": content})
    stage = StageSource(**STAGE)
    with pytest.raises(ImportingError, match=said) as error:
        read_force(tmp_path, ForceSource(**(FORCE | change)), stage)
    assert "\n" not in str(error.value)
    log = read_force(tmp_path, ForceSource(**(FORCE | {"frame_id": "tool"})), stage)
    assert log.values[1] == pytest.approx([0.3, 0, -3])


@pytest.mark.parametrize("kind", ["ros1", "ros2"])
def test_ros_bags(tmp_path, kind):
    """Numbers, stamps and images of a bag that the library itself wrote."""
    typesys = pytest.importorskip("rosbags.typesys")
    ros2 = kind == "ros2"
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE if ros2 else typesys.Stores.ROS1_NOETIC)
    types, path = store.types, tmp_path / ("run" if ros2 else "run.bag")
    if ros2:
        from rosbags.rosbag2 import Writer

        writer, pack = Writer(path, version=8), store.serialize_cdr
    else:
        from rosbags.rosbag1 import Writer

        writer, pack = Writer(path), store.serialize_ros1

    def head(k):
        number = {} if ros2 else {"seq": k}
        stamp = types["builtin_interfaces/msg/Time"](sec=EPOCH, nanosec=20_000_000 * k)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="ft", **number)

    shown = np.zeros((4, 5, 3), np.uint8)
    shown[..., 0] = 200  # red
    with writer as bag:
        wrenches = bag.add_connection("/ft", "geometry_msgs/msg/WrenchStamped", typestore=store)
        images = bag.add_connection("/camera", "sensor_msgs/msg/Image", typestore=store)
        vector = types["geometry_msgs/msg/Vector3"]
        for k in range(25):
            content = types["geometry_msgs/msg/Wrench"](
                vector(x=0.1 * k, y=0.0, z=-1.0 * k), vector(x=0.0, y=0.0, z=0.0)
            )
            message = types["geometry_msgs/msg/WrenchStamped"](header=head(k), wrench=content)
            bag.write(wrenches, 10**9 * EPOCH + k, pack(message, "geometry_msgs/msg/WrenchStamped"))
        image = types["sensor_msgs/msg/Image"](
            header=head(3),
            height=4,
            width=5,
            encoding="rgb8",
            is_bigendian=0,
            step=15,
            data=shown.reshape(-1),
        )
        bag.write(images, 10**9 * EPOCH, pack(image, "sensor_msgs/msg/Image"))
    log = read_force(tmp_path, ForceSource(**(FORCE | {"file": path.name})), StageSource(**STAGE))
    assert log.values[3] == pytest.approx([0.3, 0, -3])
    assert log.time_s[3] == pytest.approx(0.06, abs=1e-6)
    ((_, stamp, found),) = images_of(path, "/camera", "camera")
    assert stamp == pytest.approx(EPOCH + 0.06, abs=1e-6)
    assert (found == shown[..., ::-1]).all()


def encoded(image, kind=".png"):
    return base64.b64encode(cv2.imencode(kind, image)[1].tobytes()).decode()


def compressed(frames, form):
    stamps = [{"sec": EPOCH, "nsec": round(k / 30 * 1e9)} for k in range(len(frames))]
    return [{"timestamp": at, "format": form, "data": data} for at, data in zip(stamps, frames)]


def test_images_in_messages(tmp_path, monkeypatch):
    """The stamps are those in the messages; the chosen frames are the same whether kept or decoded again."""
    shown = [np.full((8, 8), 10 * k, np.uint8) for k in range(24)]
    mcap(tmp_path / "run.mcap", {"/camera": compressed([encoded(image) for image in shown], "png")})
    film = read_film(tmp_path, CameraSource(video="run.mcap", topic="/camera", container=True))
    assert film.time_s == pytest.approx(np.arange(24) / 30, abs=1e-6)
    write_frames(film, {5: [tmp_path / "5.png"]})
    assert (cv2.imread(str(tmp_path / "5.png"), -1) == 50).all()

    # A raw stream of JPEGs takes the place of H.264, which OpenCV's wheels do not write.
    monkeypatch.setitem(message_images.VIDEO, "mjpeg", ".mjpeg")
    shown = [np.full((16, 16, 3), 9 * k, np.uint8) for k in range(22)]
    frames = [encoded(image, ".jpg") for image in shown]
    mcap(tmp_path / "run.mcap", {"/camera": compressed(frames, "mjpeg")})
    found = list(images_of(tmp_path / "run.mcap", "/camera", "camera"))
    assert [round(image.mean() / 9) for *_, image in found] == list(range(22))
    assert found[3][1] == pytest.approx(EPOCH + 0.1, abs=1e-6)
    mcap(tmp_path / "run.mcap", {"/camera": compressed([*frames, ""], "mjpeg")})
    with pytest.raises(ImportingError, match=r"decodes to 22 frames of 23 messages"):
        list(images_of(tmp_path / "run.mcap", "/camera", "camera"))


def test_taf(tmp_path):
    shown = [np.full((8, 8), 10 * k, np.uint8) for k in range(4)]
    wrenches = [{"fx": 0.1, "fy": 0.0, "fz": -float(k), "tx": 0.002, "ty": 0, "tz": 0} for k in range(4)]
    topics = {
        "/tactile-camera": compressed([encoded(image) for image in shown], "png"),
        "/force-torque": wrenches,
    }
    mcap(tmp_path / "episode_7.mcap", topics, rate=30.0)
    (tmp_path / "set").mkdir()
    written = write_labelled(layout_of("taf"), tmp_path, tmp_path / "set", Options())
    rows = (tmp_path / "set" / "readings.csv").read_text().splitlines()
    assert written.images == 4
    assert rows[3].split(",")[1:4] == ["episode_7", "", "0.0666666031"]
    assert rows[3].split(",")[7:11] == ["0.1", "0", "-2", "2"]
    mcap(tmp_path / "episode_7.mcap", topics, rate=10.0)
    (tmp_path / "off").mkdir()
    with pytest.raises(ImportingError, match=r"the wrench nearest to the image at 0\.033 s is 0\.033 s off"):
        write_labelled(layout_of("taf"), tmp_path, tmp_path / "off", Options())


@pytest.mark.parametrize("limit", [0, 10**9])
def test_chosen_frames_of_a_video(tmp_path, monkeypatch, limit):
    """A short film is decoded once, a long one a second time, with the same frames."""
    monkeypatch.setattr(camera, "KEPT_BYTES", limit)
    opened, capture = [], cv2.VideoCapture
    monkeypatch.setattr(cv2, "VideoCapture", lambda name: opened.append(name) or capture(name))
    writer = cv2.VideoWriter(str(tmp_path / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30, (32, 32), False)
    for k in range(25):
        writer.write(np.full((32, 32), 8 * k, np.uint8))
    writer.release()
    film = read_film(tmp_path, CameraSource(video="film.avi", rate_hz=30))
    write_frames(film, {3: [tmp_path / "a.png", tmp_path / "b.png"], 20: [tmp_path / "c.png"]})
    assert [round(cv2.imread(str(tmp_path / f"{name}.png"), 0).mean() / 8) for name in "abc"] == [3, 3, 20]
    assert len(opened) == (1 if limit else 2)


GCODE = """\
; two presses
G21 G90
G0 X1 Y2 Z5
G1 Z3 F60 (one millimetre per second)
G4 P500
G91
G1 Z2
G4 S1
"""


def test_gcode_by_time_alone_and_as_the_stage_of_a_mapping(tmp_path):
    (tmp_path / "moves.gcode").write_text(GCODE)
    table = gcode_table(tmp_path / "moves.gcode", ["X", "Z"], GCode(acceleration_mm_s2=10))
    z = table["Z"].to_numpy()
    assert (table["X"] == 1).all()
    # 2 mm at 1 mm/s from and to rest at 10 mm/s2: 2 + 0.1 s; half an acceleration's way after 0.1 s is 0.05 mm
    assert z[[0, 10, 105, 210, 259]] == pytest.approx([5, 4.95, 4.0, 3, 3], abs=1e-9)
    assert z[260 + 105] == pytest.approx(4.0)
    assert len(z) == 210 + 50 + 210 + 100
    (tmp_path / "moves.gcode").write_text(GCODE.replace("G21", "G20"))
    inches = gcode_table(tmp_path / "moves.gcode", ["Z"], GCode())["Z"]
    assert inches[1] == pytest.approx(127.0)
    assert inches[101] == pytest.approx(127.0 - 25.4)  # at once at full speed: an inch per second

    # Gcode as the stage of a mapping
    (tmp_path / "moves.gcode").write_text(GCODE)
    keys = {"file": "moves.gcode", "gcode": {"acceleration_mm_s2": 10}, "x": "X", "y": "Y", "z": "Z", "unit": "mm",
            "pressing": "-z"}  # fmt: skip
    log = read_stage(tmp_path, StageSource(**keys), ForceSource(**FORCE))
    assert log.period_s == pytest.approx(0.01)
    assert log.values[0] == pytest.approx([1, 2, -5])
    with pytest.raises(ConfigError, match=r"gcode makes times from feed rates"):
        section_from(StageSource, keys | {"rate_hz": 10}, "stage")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("G4 S1", "G28", r"row 8: G28 takes a time or a way that the file does not say"),
        ("G1 Z2", "G1 X1 I2", r"row 7: an arc; log the stage's positions instead"),
        (" F60", "", r"row 4: no feed rate F so far; give F"),
        ("G1 Z3 F60 (one millimetre per second)\nG4 P500\nG91\nG1 Z2\nG4 S1\n", "", r"1 motions"),
        ("G0 X1 Y2 Z5\nG1 ", "", r"row 3: a position without G0 or G1"),
    ],
)
def test_gcode_that_says_too_little(tmp_path, old, new, said):
    (tmp_path / "moves.gcode").write_text(GCODE.replace(old, new))
    with pytest.raises(ImportingError, match=said):
        gcode_table(tmp_path / "moves.gcode", ["Z"], GCode())
