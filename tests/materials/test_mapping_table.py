"""docs/material-mappings.md follows the mapping's sections, and its examples are values that they accept."""

import pytest
import yaml
from pydantic import TypeAdapter

from docs.mapping_table import EXAMPLES, PAGE, keys, page


def test_the_page_is_that_of_the_sections():
    assert PAGE.read_text(encoding="utf-8") == page(), "python docs/mapping_table.py"
    assert set(EXAMPLES) == {key for key, _ in keys()}
    assert all(field.description for _, field in keys())


@pytest.mark.parametrize(
    ("key", "field"), [one for one in keys() if one[0] != "tests"], ids=lambda one: str(one)[:40]
)
def test_an_example_is_a_value_of_its_key(key, field):
    TypeAdapter(field.rebuild_annotation()).validate_python(yaml.safe_load(EXAMPLES[key]))
