"""Images that cannot be true are found, and the honest session that resembles each passes."""

import cv2
import numpy as np
import pandas as pd
import pytest
from drawn import MIDDLE, SIZE, dots, photograph, speckle
from image_session import DEPTHS, PLACES, indentations, write_image_session

from gelforge.recording.imaging.image_measures import RUN_LENGTH, RUNS, sample
from gelforge.recording.imaging.images import image_size
from gelforge.recording.readings import read_recording
from gelforge.recording.tables.checks import RecordingError


def found(folder):
    """Return the image findings of a session as (level, test, press)."""
    return [(f.level, f.test, f.press) for f in read_recording(folder).findings if f.test.startswith("image")]


def refused(folder, message):
    with pytest.raises(RecordingError, match=message) as caught:
        read_recording(folder)
    assert "\n" not in str(caught.value)


def put(**by_name):
    """Return a change of the pictures named (without .png)."""
    return lambda names, pictures: [
        by_name[n[:-4]](p) if n[:-4] in by_name else p for n, p in zip(names, pictures)
    ]


# ------------------------------------------------------------------------------------------ honest sessions
def vignette(depth):
    """Return the light on a dome: bright in the middle, dark at the corners."""
    v, u = np.mgrid[: SIZE[0], : SIZE[1]]
    return np.clip(1.2 - depth * np.hypot(u - MIDDLE[0], v - MIDDLE[1]) / 130, 0.02, 1)


HONEST = {
    "speckle": {},
    "dots": {"pattern": dots()},
    "five images": {"images": 5},
    "none before contact": {"before": False, "images": 2},
    "light drifts by a fifth": {"gain": lambda k: 1 - 0.2 * k / 18},
    "lamp switched between indentations": {"gain": lambda k: 1.0 if k < 8 else 0.6},
    "no noise": {"noise": 0.0},
    "dark corners of a dome": {"finish": lambda p: (p * vignette(1.2)).astype(np.uint8)},
    "saturated spots of lamps": {"finish": lambda p: cv2.circle(p, (30, 30), 18, 255, -1)},
    "sixteen bits": {"finish": lambda p: p.astype(np.uint16) * 256},
    "colour": {"finish": lambda p: cv2.cvtColor(p, cv2.COLOR_GRAY2BGR)},
    "dim": {"gain": lambda k: 0.3, "noise": 0.5},
    "one depth": {"presses": [(place, 1.0) for place in PLACES for _ in range(3)]},
    "at rest without noise": {
        "noise": 0.0,
        "images": 3,
        "presses": [(PLACES[0], 1.0), (PLACES[0], 1.0), (PLACES[0], 0.5), (PLACES[0], 0.5001)],
    },
    "one place, deeper each time": {"presses": [(PLACES[0], 0.2 * k) for k in range(1, 9)]},
}


@pytest.mark.parametrize("name", HONEST)
def test_an_honest_session_passes_without_a_word(name, tmp_path):
    assert found(write_image_session(tmp_path / "s", **HONEST[name])) == []


# ------------------------------------------------------------------------------------------ frames out of step
def late(steps):
    def change(names, pictures):
        first = photograph(speckle(), seed=100)
        return ([first] * steps + pictures)[: len(pictures)]

    return change


@pytest.mark.parametrize(
    ("steps", "images", "words"), [(1, 1, "1 image"), (2, 1, "2 images"), (1, 5, "1 image")]
)
def test_frames_behind_their_readings_are_refused_with_the_lag(steps, images, words, tmp_path):
    folder = write_image_session(tmp_path / "s", images=images, change=late(steps))
    refused(folder, rf"before contact move by .* px: frames lag the readings by {words} \(about .* s\)")


def test_a_session_that_the_laboratory_confirms_passes_with_notes(tmp_path):
    folder = write_image_session(tmp_path / "s", change=late(1), extra="confirmed: [image_in_step]\n")
    levels = {test: level for level, test, _ in found(folder)}
    assert levels["image_in_step"] == "note"


# ------------------------------------------------------------------------------------------ single images
FLAT = {"black": 0.0, "white": 255.0}


@pytest.mark.parametrize(("look", "grey"), FLAT.items())
def test_black_and_white_images_are_left_out_by_name(look, grey, tmp_path):
    flat = np.clip(grey + np.random.default_rng(0).normal(0, 2, SIZE), 0, 255).astype(np.uint8)
    recording = read_recording(write_image_session(tmp_path / "s", change=put(p03_1=lambda p: flat)))
    (line,) = recording.findings.lines("excluded")
    assert f"image p03_1.png is {look}" in line
    assert "indentation p03 at 31 s" in line
    assert "image left out there" in line
    assert recording.readings.loc[recording.readings["excluded"] != "", "image"].to_list() == [""]


def in_place_of(at, source):
    """Return a change: another picture stands in the place of one."""
    return lambda n, p: [*p[:at], p[source], *p[at + 1 :]]


DEEP = [k for k, (_, depth) in enumerate(indentations()) if depth == max(DEPTHS)][-1]
UNTOUCHED = photograph(speckle(), seed=300)
SHALLOW = [(place, 0.05) for place in PLACES for _ in range(3)]
FOUND = {
    "too shallow to be seen": (
        {"presses": SHALLOW, "px_per_mm": 0.1},
        [("note", "image_in_step", "")],
    ),
    "exposed by itself": (
        {"gain": lambda k: 0.7 if k == 7 else 1.0},
        [("excluded", "image_exposure", "p03")],
    ),
    "frozen at depth": ({"change": in_place_of(9, 8)}, [("excluded", "image_repeats", "p04")]),
    "pressed before touch": (
        {"change": in_place_of(8, 5)},
        [("excluded", "image_repeats", "p04"), ("excluded", "image_before_touch", "p04")],
    ),
    "deep without motion": (
        {"change": put(**{f"p{DEEP:02d}_1": lambda p: UNTOUCHED})},
        [("excluded", "image_grows", f"p{DEEP:02d}")],
    ),
    "late once in five": (
        {
            "images": 5,
            "presses": indentations()[:4],
            "change": lambda n, p: [p[k - (name == "p02_1.png")] for k, name in enumerate(n)],
        },
        [("excluded", "image_repeats", "p02"), ("excluded", "image_alike", "p02")],
    ),
}


@pytest.mark.parametrize("name", FOUND)
def test_a_single_image_that_cannot_be_is_left_out(name, tmp_path):
    traits, findings = FOUND[name]
    assert found(write_image_session(tmp_path / "s", **traits)) == findings


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_images_cut_short_are_named(suffix, tmp_path):
    path = tmp_path / f"a.{suffix}"
    cv2.imwrite(str(path), photograph(speckle()))
    assert image_size(path) == (208, 160)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(RecordingError, match=f"a.{suffix}: .*cut short"):
        image_size(path)


def test_a_flipped_bit_and_a_blank_reference_are_refused(tmp_path):
    # A flipped bit is named
    folder = write_image_session(tmp_path / "s")
    path = folder / "images" / "p02_1.png"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)
    refused(folder, r"p02_1\.png: cannot be decoded")

    # A reference without texture is refused
    blank = tmp_path / "blank"
    folder = write_image_session(blank / "s")
    cv2.imwrite(str(folder / "reference.png"), np.zeros(SIZE, np.uint8))
    refused(folder, "the reference frame shows no texture")


def test_a_long_session_is_sampled_in_runs():
    lines = [f"p{k:02d}" for k in range(40)]
    table = pd.DataFrame({"press": lines, "phase": "dwell", "image": "a.png"})
    rows = sample(table)
    assert len(rows) == RUNS * RUN_LENGTH
    assert rows.groupby("run")["press"].apply(list).to_list()[0] == lines[:RUN_LENGTH]
    assert rows["press"].iloc[-1] == lines[-1]


def banded(amplitude):
    """Return a change of single pictures: bands of light along the rows, elsewhere in each, as of a rolling shutter."""
    rng = np.random.default_rng(3)

    def change(picture):
        rows = np.arange(picture.shape[0])[:, None]
        light = 1 + amplitude * np.sin(2 * np.pi * (3 * rows / len(rows) + rng.uniform()))
        return np.clip(picture * light, 0, 255).astype(np.uint8)

    return change


REFUSED = {
    "frames ahead": ({"change": lambda n, p: p[1:] + p[:1]}, "frames lead the readings by 1 image"),
    "images of other rows": (
        {"change": lambda n, p: [p[k] for k in np.random.default_rng(1).permutation(len(p))]},
        "images belong to other rows, as flow",
    ),
    "a camera that looks elsewhere": (
        {"change": lambda n, p: [photograph(speckle(), seed=200 + k) for k in range(len(p))]},
        "do not respond to the indentations",
    ),
    "black images": (
        {"change": lambda n, p: [p if k < 4 else p // 100 for k, p in enumerate(p)]},
        "is black",
    ),
    "exposure that follows": ({"gain": lambda k: 0.75 if k % 2 else 1.0}, "exposure or gain"),
    "a camera that freezes": (
        {"change": lambda n, p: p[:3] + [p[3]] * (len(p) - 3)},
        "image_repeats|frames|do not respond|before contact move",
    ),
    "twelve bits as sixteen": (
        {"finish": lambda p: p.astype(np.uint16) * 16},
        "image of the reference frame spans 1[0-9] of 256 grey levels .* scale 10 and 12 bits",
    ),
    "bands of a rolling shutter": (
        {"finish": banded(0.5)},
        r"image .*\.png has bands of \+-\d+ % brightness .* rolling shutter .*multiples of 1/100 s",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_images_that_cannot_be_of_the_readings_are_refused(name, tmp_path):
    traits, words = REFUSED[name]
    refused(write_image_session(tmp_path / "s", **traits), words)
