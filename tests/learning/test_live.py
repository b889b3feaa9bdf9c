"""The live path: newest frames, messages of finite numbers, clients that come, lag, vanish or are foreign."""

import json
import shutil
import socket
import time
import urllib.error
import urllib.request

import h5py
import numpy as np
import pytest
from live_browser import Browser
from live_parts import MOVED, STILL, LiveRun, Source, force_of, pattern
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from gelforge.live.capture import Capture, LiveError, Shot, played
from gelforge.live.messages import of_reading, text_of
from gelforge.live.record import Limits
from gelforge.live.server import Server, why_refused
from gelforge.recording.imaging.flow import ImageError
from gelforge.recording.imaging.frames import Frame

WAIT_S = 5  # until a test gives up; what it waits for takes milliseconds


def shot(image, number=0):
    return Shot(number, time.time(), Frame("frame", 0.0, image))


def received(client, kind="force"):
    """Return the next message of a kind."""
    while True:
        message = json.loads(client.recv(timeout=WAIT_S))
        if message["type"] == kind:
            return message


def until(condition):
    end = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


# --------------------------------------------------------------------------------------------- capture
def test_frames_that_come_meanwhile_are_dropped_and_a_silent_camera_waited_for():
    source = Source()
    with Capture(source) as capture:
        source.hand(STILL)
        first = capture.newest(WAIT_S)
        source.hand(*[STILL] * 5, MOVED)
        until(lambda: capture.captured == 7)
        newest = capture.newest(WAIT_S)
        source.hand(None)
        assert capture.newest(WAIT_S) is None
    assert (first.number, newest.number) == (0, 6)
    assert newest.frame.image is MOVED
    assert capture.dropped == 5
    assert capture.ended
    assert capture.error is None

    # A silent camera is waited for a while
    source = Source()
    with Capture(source) as capture:
        assert capture.newest(0.05) is None
        assert not capture.ended
        source.hand(None)


@pytest.mark.parametrize("fps", [0, -1, float("nan"), 1e6])
def test_an_impossible_rate_is_refused(fps):
    with pytest.raises(LiveError, match="--fps"):
        played("7", fps, False)


# ------------------------------------------------------------------------------------------ computation
def test_a_reading_holds_totals_intervals_and_centre_at_any_scale():
    # A reading holds totals intervals and centre if touched
    reading = force_of()(shot(MOVED))
    assert reading.touched
    np.testing.assert_allclose(reading.total_N, reading.force_N.sum(axis=0))
    assert -0.3 < reading.total_N[2] < -0.1  # 2 px of motion, 0.2 px of which do not count
    np.testing.assert_array_equal(reading.total_half_N, [0.02] * 3)
    np.testing.assert_array_equal(reading.half_N[6], [0.003] * 3)
    np.testing.assert_allclose(
        reading.cop_mm, [20.0, 12.0]
    )  # bin 6 of 4 x 5: the third along x, the second along y
    (contact,) = reading.contacts
    np.testing.assert_allclose(contact.centre_mm, reading.cop_mm)
    np.testing.assert_allclose(contact.force_N, reading.total_N)
    assert not reading.warnings

    # An untouched frame has no centre and exact zeros
    reading = force_of()(shot(STILL))
    assert not reading.touched
    assert reading.cop_mm is None
    assert reading.contacts == ()
    assert not reading.force_N.any()

    # Frames are reduced as the images that the model learnt from
    whole, small = force_of()(shot(MOVED)), force_of(scale=0.8)
    assert small.extract.flow.reference.shape == (96, 128)
    # 1.8 px above the model's threshold at either scale; in pixels of the reduced image it would be 1.4
    assert small(shot(MOVED)).force_N[6, 2] == pytest.approx(whole.force_N[6, 2], rel=0.08)
    assert "160 x 120" in small(shot(np.zeros((96, 128), np.uint8))).problem  # frames come as large as ever


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda image: image * 0.8, "mean grey level 102, of the reference 128"),
        (lambda image: (image.astype(float) - 128) * 0.6 + 128, "sharpness 0.6"),
    ],
    ids=["exposure", "focus"],
)
def test_a_camera_that_has_changed_warns_and_goes_on(change, words):
    reading = force_of()(shot(change(STILL).astype(np.uint8)))
    assert reading.force_N is not None
    assert any(words in text for text in reading.warnings)


# ----------------------------------------------------------------------------------------------- server
def test_two_clients_are_sent_forces_until_one_vanishes_or_the_camera_stops():
    # Two clients are sent forces and one may vanish
    with LiveRun() as run, connect(run.url) as one, connect(run.url + "?field=1") as other:
        assert received(one, "about")["synthetic"] is True
        received(other, "about")
        until(lambda: run.server.clients == 2)
        run.source.hand(MOVED)
        plain, full = received(one), received(other)
        assert plain["state"] == "touched"
        assert plain["t_capture"] <= plain["t_sent"]
        assert plain["latency_ms"] == pytest.approx(1e3 * (plain["t_sent"] - plain["t_capture"]), abs=0.01)
        assert "field_N" not in plain
        np.testing.assert_allclose(np.sum(full["field_N"], axis=0), full["force_N"], atol=1e-5)
        other.socket.shutdown(socket.SHUT_RDWR)  # without a word
        until(lambda: run.server.clients == 1)
        run.source.hand(STILL)
        assert received(one)["state"] == "untouched"

    # A camera that stops ends the run and says so
    run = LiveRun(fails=True)
    with run, connect(run.url) as client:
        until(lambda: run.server.clients == 1)
        run.source.hand(ImageError("camera 0: no frame after 3; is it still connected?"))
        assert "still connected" in received(client, "end")["text"]
    assert isinstance(run.error, ImageError)


def test_a_client_that_reads_nothing_holds_back_nobody():
    """It is sent what its buffers hold, and later the newest: not the hundreds of messages in between."""
    with LiveRun() as run, connect(run.url) as quick, connect(run.url + "?field=1", max_queue=1) as slow:
        until(lambda: run.server.clients == 2)
        message = {"type": "force", "field_N": [[0.123456] * 3] * 2000}
        received(quick, "about")
        for n in range(400):  # 25 MB for the slow one, more than all buffers
            run.server.publish({**message, "n": n})
            assert received(quick)["n"] == n
        numbers = []
        while not numbers or numbers[-1] < 399:
            numbers.append(received(slow)["n"])
        assert len(numbers) < 300
        assert numbers == sorted(set(numbers))


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:1", "null"])
def test_a_foreign_page_may_not_read(origin):
    with LiveRun() as run, pytest.raises(InvalidStatus) as found:
        connect(run.url, origin=origin)
    assert found.value.response.status_code == 403


@pytest.mark.parametrize(
    ("host", "origin", "fine"),
    [
        ("127.0.0.1:8765", None, True),
        ("localhost:9000", "http://localhost:9000", True),  # through a tunnel
        ("[::1]:8765", "http://[::1]:8765", True),
        ("evil.example:8765", "http://evil.example:8765", False),  # a name made to lead here
        ("127.0.0.1:8765", "http://localhost:8765", False),
        (None, None, False),
    ],
)
def test_hosts_and_origins(host, origin, fine):
    assert (why_refused(host, origin) == "") is fine


@pytest.mark.parametrize("name", ["Host", "Origin"])
def test_a_header_sent_twice_is_a_bad_request(name):
    with LiveRun() as run, socket.create_connection(("127.0.0.1", run.server.port), timeout=WAIT_S) as client:
        value = f"127.0.0.1:{run.server.port}"
        lines = [
            "GET / HTTP/1.1",
            f"Host: {value}",
            *[f"{name}: {value}"] * (1 if name == "Host" else 2),
            "",
            "",
        ]
        client.sendall("\r\n".join(lines).encode())
        assert client.recv(1000).startswith(b"HTTP/1.1 400 ")


def test_the_page_and_its_own_stream_may_be_read():
    with LiveRun() as run:
        with urllib.request.urlopen(run.server.url) as answer:
            page = answer.read().decode()
            assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
        assert "http://" not in page  # nothing is loaded from elsewhere
        assert "https://" not in page
        for path, code in (("etc", 404), ("stream", 426)):
            with pytest.raises(urllib.error.HTTPError) as found:
                urllib.request.urlopen(run.server.url + path)
            assert found.value.code == code

    # The servers own page may read
    with LiveRun() as run, connect(run.url, origin=run.server.url.rstrip("/")) as client:
        received(client, "about")


@pytest.mark.parametrize("text", ["", "[1]", '"zero"', '{"do": "format"}', "{" * 500, b"\xff\x00"])
def test_what_is_no_command_is_refused_and_the_stream_goes_on(text):
    with LiveRun() as run, connect(run.url) as client:
        client.send(text)
        assert "not understood" in received(client, "refused")["text"]
        run.source.hand(STILL)
        assert received(client)["state"] == "untouched"


def test_a_client_that_sends_too_much_is_let_go_and_a_port_in_use_told():
    # A client that sends too much is let go
    with LiveRun() as run, connect(run.url) as client:
        client.send("x" * 2000)
        with pytest.raises(ConnectionClosed) as found:
            received(client)
        assert found.value.rcvd.code == 1009

    # A port in use is reported
    with LiveRun() as run, pytest.raises(LiveError, match="in use; give another --port"):
        with Server("127.0.0.1", run.server.port, {}):
            pass


# ------------------------------------------------------------------------------------------------- runs
def test_frames_of_another_size_are_told_in_finite_numbers():
    # Frames of another size are reported and the stream goes on
    with LiveRun() as run, connect(run.url) as client:
        until(lambda: run.server.clients == 1)
        run.source.hand(pattern(0, (100, 100)))
        message = received(client)
        assert message["state"] == "no force"
        assert message["force_N"] is None
        assert "100 x 100 px, but the model learnt from images of 160 x 120 px" in message["problem"]
        run.source.hand(MOVED)
        assert received(client)["state"] == "touched"

    # No message has a number that is not finite
    for image in (STILL, MOVED, pattern(0, (100, 100))):
        text = text_of(of_reading(force_of()(shot(image)), {}, field=True))
        json.loads(text, parse_constant=lambda name: pytest.fail(name))
    with pytest.raises(ValueError):
        text_of({"force_N": float("nan")})


def test_zero_takes_the_frame_as_reference():
    with LiveRun() as run, connect(run.url) as client:
        until(lambda: run.server.clients == 1)
        run.source.hand(MOVED)
        assert received(client)["state"] == "touched"
        client.send('{"do": "zero"}')
        until(lambda: not run.server.commands.empty())
        run.source.hand(MOVED)
        message = received(client)
        assert (message["state"], message["zero"]) == ("untouched", 1)


def test_recordings_hold_what_was_sent_up_to_their_size(tmp_path):
    # Recordings hold what was sent
    with LiveRun(tmp_path) as run, connect(run.url) as client:
        until(lambda: run.server.clients == 1)
        sent = []
        for image in (STILL, MOVED, pattern(0, (100, 100))):  # the last has no force and is not recorded
            run.source.hand(image)
            sent.append(received(client))
        client.send('{"do": "stop"}')
        until(lambda: not run.server.commands.empty())
        run.source.hand(STILL)
        assert received(client)["recording"] is None
    path = tmp_path / sent[0]["recording"]
    with h5py.File(path) as file:
        assert file.attrs["synthetic"]
        np.testing.assert_allclose(file["total_force_N"], [m["force_N"] for m in sent[:2]], atol=1e-6)
        np.testing.assert_allclose(file["t_capture"], [m["t_capture"] for m in sent[:2]], atol=1e-5)
        np.testing.assert_allclose(
            np.sum(file["force_distribution_N"], axis=1), file["total_force_N"], atol=1e-6
        )

    # A recording ends at its size and the forces go on
    small = tmp_path / "small"
    small.mkdir()
    with LiveRun(small, limits=Limits(largest_mb=0.001)) as run, connect(run.url) as client:
        until(lambda: run.server.clients == 1)
        for _ in range(6):  # 20 bins: 0.3 kB each
            run.source.hand(MOVED)
            message = received(client)
        while message["recording"]:  # the thread that writes may be a frame behind
            run.source.hand(MOVED)
            message = received(client)
        assert message["state"] == "touched"
        assert "recording ended at 0.00" in message["trouble"] and "--max-recording-mb" in message["trouble"]
    (path,) = small.glob("live-*.h5")
    with h5py.File(path) as file:
        assert 4 <= len(file["number"]) < 20
    assert sum("recording ended" in text for text in run.said) == 1


def test_folders_that_are_full_or_cannot_be_written_do_not_stop_the_forces(tmp_path):
    # A folder that cannot be written does not stop the forces
    (tmp_path / "file").write_text("")
    with LiveRun(tmp_path / "file" / "folder") as run, connect(run.url) as client:
        until(lambda: run.server.clients == 1)
        run.source.hand(MOVED)
        message = received(client)
        assert message["state"] == "touched"
        assert "cannot record" in message["trouble"]

    # A folder with as many recordings as allowed takes no more
    full = tmp_path / "full"
    full.mkdir()
    for number in range(2):
        (full / f"live-{number}.h5").touch()
    with LiveRun(full, limits=Limits(recordings=2)) as run, connect(run.url) as client:
        until(lambda: run.server.clients == 1)
        run.source.hand(MOVED)
        message = received(client)
        assert message["state"] == "touched"
        assert (
            "holds 2 recordings, limit 2" in message["trouble"] and "--max-recordings" in message["trouble"]
        )
    assert len(list(full.iterdir())) == 2


def test_totals_that_flicker_between_agreement_and_none_print_little():
    """300 frames of which the total of every other, the moved one, disagrees."""
    with LiveRun() as run, connect(run.url) as client:
        model = run.force.predictor.model
        model.follow = lambda feature, state: (model.predict(feature), np.array([feature[:16].mean()]), None)
        until(lambda: run.server.clients == 1)
        for _ in range(150):
            for image in (STILL, MOVED):
                run.source.hand(image)
                warned = received(client)["warnings"]
            assert any("not that of inverse elasticity" in text for text in warned)
    said = [text for text in run.said if "not that of inverse elasticity" in text]
    assert len(said) == 1 and "150 times in the last" in said[0]


# ---------------------------------------------------------------------------------------------- browser
def test_the_page_shows_forces_in_a_browser(tmp_path):
    program = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("no Chromium or Chrome here; install one to try the live page in it")
    with LiveRun(tmp_path / "recorded") as run, Browser(program, tmp_path, run.server.url) as browser:
        until(lambda: run.server.clients == 1)
        run.source.hand(MOVED)
        browser.until("document.getElementById('state').textContent", "touched")
        assert browser.value("document.getElementById('synthetic').hidden") is False
        assert browser.value("document.getElementById('f2').textContent").startswith("−0.1")
        browser.value("document.getElementById('zero').click()")
        until(lambda: not run.server.commands.empty())
        run.source.hand(MOVED)
        browser.until("document.getElementById('state').textContent", "untouched")
        browser.screenshot(tmp_path / "page.png")
        assert browser.errors == []


@pytest.mark.parametrize(("host", "origin"), [("[::1", None), ("127.0.0.1:8765", "http://[")])
def test_addresses_that_are_none_are_refused_without_a_traceback(host, origin):
    assert "no address" in why_refused(host, origin)
