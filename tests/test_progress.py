"""What a command shows of its progress: lines of a log by time, one rewritten line of a terminal, nothing of workers."""

import io
import os
import sys
from contextlib import suppress

import pytest

from gelforge import progress
from gelforge.progress import Progress, Stages, duration, stage, tracked


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Clock:
    """A clock that is moved by hand [s]."""

    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def shown():
    progress.show()
    yield
    progress._shown_by = 0


def run(clock, count, step_s, **options):
    with Progress("sites", count, clock=clock, **options) as told:
        for _ in range(count - told.done):
            clock.now += step_s
            told.advance()


def test_a_log_says_how_long_it_will_take(shown, capsys):
    run(Clock(), 100, 3.0)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "sites: 2 of 100, about 4 min 50 s left"  # the first step after five seconds
    assert lines[1] == "sites: 12 of 100, about 4 min 20 s left"
    assert lines[-1] == "sites: 100 of 100; took 5 min"
    assert len(lines) == 11

    # A log says each minute where a tenth takes long
    run(Clock(), 1000, 20.0)
    lines = capsys.readouterr().err.splitlines()
    assert lines[:2] == ["sites: 1 of 1000, about 5 h 33 min left", "sites: 4 of 1000, about 5 h 32 min left"]

    # What is done in five seconds leaves no line
    run(Clock(), 4, 1.2)
    assert capsys.readouterr().err == ""

    # What was done before counts and costs nothing
    run(Clock(), 100, 10.0, first=90)
    assert capsys.readouterr().err.splitlines()[0] == "sites: 91 of 100, about 1 min 30 s left"


def test_a_terminal_has_one_line_that_is_cleared(shown, monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    run(Clock(), 3, 1.0)
    printed = sys.stderr.getvalue()
    assert "\n" not in printed
    assert printed.split("\r\033[2K")[1:] == [
        "sites: 0 of 3",
        "sites: 1 of 3, about 2 s left",
        "sites: 2 of 3, about 1 s left",
        "",
    ]

    # Stages on a terminal are one line
    monkeypatch.setattr(sys, "stderr", Terminal())
    staged(Clock(), expected_s=50.0)
    printed = sys.stderr.getvalue()
    assert "\n" not in printed
    shown_lines = printed.split("\r\033[2K")[1:]
    assert shown_lines[:3] == [
        "verdict, about 50 s left: readings",
        "verdict, about 46 s left: fits",
        "sites: 0 of 6",
    ]
    assert shown_lines[-3:] == ["verdict, about 10 s left: fits", "verdict, about 10 s left: tables", ""]


def test_only_the_outermost_is_shown_and_an_error_leaves_what_was_done(shown, capsys):
    # Only the outermost is shown
    clock = Clock()
    with Progress("outer", 2, clock=clock) as outer:
        run(clock, 10, 3.0)
        outer.advance()
        run(clock, 10, 3.0)
        outer.advance()
    assert capsys.readouterr().err.splitlines() == [
        "outer: 1 of 2, about 30 s left",
        "outer: 2 of 2; took 1 min",
    ]

    # Stages within stages are those of the outermost
    with Stages("study", clock=clock):
        clock.now += 6.0
        staged(clock, expected_s=45.0)
    printed = capsys.readouterr().err
    assert printed.startswith("study: readings\n") and "verdict" not in printed

    # An error leaves what was done
    def fails():
        for _ in tracked(range(4), "sites"):
            raise ValueError("no")

    clock = Clock()
    with suppress(ValueError), Progress("sites", 4, clock=clock) as told:
        clock.now += 6.0
        told.advance()
        raise ValueError("no")
    assert capsys.readouterr().err.splitlines()[-1] == "sites: 1 of 4; stopped after 6 s"
    with pytest.raises(ValueError, match="no"):
        fails()
    run(clock, 4, 6.0)
    assert "4 of 4" in capsys.readouterr().err, "the next one is shown again"


def test_unknown_ends_have_no_time_left_and_short_stages_no_line(shown, capsys):
    # Unknown ends have no time left
    clock = Clock()
    with Progress("frames", None, clock=clock) as told:
        for _ in range(10):
            clock.now += 30.0
            told.advance()
    assert capsys.readouterr().err.splitlines()[0] == "frames: 1"

    # Short stages leave no line
    with Stages("adaptation", clock=Clock()):
        stage("gains")
    assert capsys.readouterr().err == ""

    # A stage without stages says nothing
    stage("fits")
    assert capsys.readouterr().err == ""


def test_a_worker_is_silent(shown, capfd):
    child = os.fork()
    if not child:
        run(Clock(), 10, 100.0)
        os._exit(0)
    os.waitpid(child, 0)
    assert capfd.readouterr().err == ""


def staged(clock, **options):
    """Two stages, the second with six counted steps, and a third; four seconds, 36 and ten."""
    with Stages("verdict", clock=clock, **options):
        stage("readings")
        clock.now += 4.0
        stage("fits")
        run(clock, 6, 6.0)
        stage("tables")
        clock.now += 10.0


def test_stages_in_a_log_say_what_runs_and_how_long_all_of_it_takes(shown, capsys):
    staged(Clock(), expected_s=45.0)
    lines = capsys.readouterr().err.splitlines()
    assert lines[:3] == [
        "verdict, about 45 s left: readings",  # at once; another stage within five seconds has no line
        "sites: 1 of 6, about 30 s left",
        "sites: 2 of 6, about 24 s left",
    ]
    assert lines[-3:] == ["sites: 6 of 6; took 36 s", "verdict, about 5 s left: tables", "verdict took 50 s"]

    # Where some may be done already the time left is a bound
    staged(Clock(), expected_s=45.0, at_most=True)
    assert capsys.readouterr().err.startswith("verdict, at most about 45 s left: readings\n")

    # More than was expected is said
    staged(Clock(), expected_s=30.0)
    assert "verdict, 40 s so far, 30 s expected: tables" in capsys.readouterr().err


def test_items_pass_unchanged():
    assert list(tracked(iter("abc"), "letters")) == ["a", "b", "c"]
    assert list(tracked([], "nothing")) == []


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.2, "0 s"),
        (59.4, "59 s"),
        (59.6, "1 min"),
        (204, "3 min 20 s"),
        (599, "10 min"),
        (3570, "1 h"),
        (8100, "2 h 15 min"),
    ],
)
def test_durations_in_words(seconds, words):
    assert duration(seconds) == words
