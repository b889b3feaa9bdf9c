"""The pages of reference are what docs/reference.py writes from the configuration and the commands."""

import re
from pathlib import Path

import pytest

from docs.reference import PAGES, configuration, recording_tests
from gelforge.recording.plausibility.session import TESTS

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", PAGES)
def test_the_page_is_up_to_date(name):
    assert (ROOT / "docs" / name).read_text("utf-8") == PAGES[name](), f"docs/{name} is old: make generated"


def test_pages_hold_every_section_that_a_key_names_and_every_test_of_a_recording():
    page = configuration()
    named = {word.partition(")")[0] for word in page.split("](#")[1:]}
    headings = {line.removeprefix("### ").lower() for line in page.splitlines() if line.startswith("### ")}
    assert named and named <= headings

    # Every test of a recording has a row
    assert set(re.findall(r"^\| `(\w+)`", recording_tests(), re.M)) == {*TESTS, "gap"}
