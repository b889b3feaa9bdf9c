"""What `gelforge live` prints of problems and warnings that come and go."""

import pytest

from gelforge.live.notices import EVERY_S, LASTS_S, Notices

FRAME_S = 0.05


class Printed:
    """Notices with a clock of the test's own; frame() is one frame, with the warnings and the problem given."""

    def __init__(self):
        self.now, self.lines = 0.0, []
        self.notices = Notices(self.lines.append, lambda: self.now)

    def frame(self, *warnings, problem="", name=""):
        self.now += FRAME_S
        self.notices.tell((problem,), warnings, name)


@pytest.fixture
def printed():
    return Printed()


def test_a_warning_that_lasts_is_printed_once(printed):
    for k in range(2000):
        printed.frame(f"unlike, {1 + k / 1000:.1f} times the limit")
        assert len(printed.lines) == (printed.now - FRAME_S >= LASTS_S - 1e-9)


def test_a_problem_is_printed_at_once(printed):
    printed.frame(problem="image of 3 x 3 px")
    assert printed.lines == ["image of 3 x 3 px"]


def test_three_minutes_of_flicker_are_a_few_lines_that_count_it(printed):
    """Each state for 0.45 s, so that none lasts: 200 changes."""
    changes = 0
    while printed.now < 180:
        for warnings in (("unlike",), ()):
            for _ in range(9):
                printed.frame(*warnings)
        changes += 1
    printed.notices.close()
    assert len(printed.lines) <= 180 / EVERY_S + 1
    assert sum(int(line.split()[0]) for line in printed.lines) == changes == 200


def test_a_state_that_lasts_after_flicker_says_how_much_was_left_out(printed):
    for _ in range(8):
        printed.frame("unlike")
        printed.frame()
    while not printed.lines:
        printed.frame("unlike")
    assert printed.lines == ["unlike (8 times more in the last 2 s)"]


def test_lines_of_one_kind_are_apart_and_those_of_others_are_not_held_back(printed):
    for _ in range(10):
        printed.frame(problem="frame of 3 px")
        printed.frame()
    printed.frame(problem="no frame for 2 s")
    assert printed.lines == ["frame of 3 px", "no frame for 2 s"]
    printed.now += EVERY_S
    printed.frame(problem="frame of 4 px")
    assert printed.lines[2:] == ["frame of 4 px (9 times more in the last 31 s)"]


def test_frames_are_not_told_apart_by_their_names(printed):
    for name in ("left.png", "right.png"):
        printed.frame(problem=f"{name}: image of 3 x 3 px", name=name)
    assert printed.lines == ["left.png: image of 3 x 3 px"]


def test_kinds_that_are_gone_are_forgotten(printed):
    for k in range(1000):
        printed.frame(problem=f"{chr(97 + k % 26) * (1 + k // 26)}")
    printed.now += EVERY_S
    printed.frame()
    printed.frame()
    assert not printed.notices._kinds
