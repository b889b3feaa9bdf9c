"""Configurations: what is shipped is valid, what is wrong is refused with key, value and limit."""

import json
import re
from functools import cache
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from gelforge.config import (
    ConfigError,
    load_study,
    load_virtual_lab,
    schema,
    study_from,
    variant_study,
    write_yaml,
)
from gelforge.config import given as needed
from gelforge.indentation.planning.plan import plan_cells

ROOT = Path(__file__).parents[1]
STUDIES = ["config/config.yaml", "config/paper.yaml", "config/test.yaml"]


@pytest.fixture(autouse=True)
def in_repository(monkeypatch):
    monkeypatch.chdir(ROOT)


def paper() -> dict:
    return yaml.safe_load(Path("config/paper.yaml").read_text())


@pytest.mark.parametrize("path", STUDIES)
def test_shipped_studies_are_valid(path):
    study = load_study(path)
    assert plan_cells(study)


def test_paper_has_its_13448_presses():
    study = load_study("config/paper.yaml")
    cells = plan_cells(study)
    assert len(cells) == 1681
    assert sum(len(cell.depths_mm) for cell in cells.values()) == 13448
    solved = [cell for cell in cells.values() if cell.source is None]
    assert len(solved) == 21 * 22 // 2  # one octant of a 41 x 41 grid, diagonal and axes included
    assert (solved[0].x_mm, solved[0].y_mm) == (5.0, 5.0)


@pytest.mark.parametrize(("name", "solved", "depths"), [("config", 15, 5), ("benchmark", 36, 8)])
def test_symmetry_leaves_few_sites_of_the_demo_and_the_benchmark_to_solve(name, solved, depths):
    cells = plan_cells(load_study(f"config/{name}.yaml"))
    assert sum(cell.solved for cell in cells.values()) == solved
    assert {len(cell.depths_mm) for cell in cells.values()} == {depths}


def test_a_part_that_is_needed_and_not_given_is_named():
    study = load_study("config/benchmark.yaml")
    assert needed(study.plan.file, "plan.file") is study.plan.file
    with pytest.raises(ConfigError, match=r"synthesis is required.*add it"):
        needed(None, "synthesis")


def test_the_schema_is_current_and_says_what_every_key_is():
    assert json.loads(Path("config/schema.json").read_text()) == schema()

    # A number's description ends in its unit, written [mm], [-] and the like.
    definitions = schema()["$defs"] | {"Study": schema()}
    for name, definition in definitions.items():
        for key, content in definition.get("properties", {}).items():
            assert content.get("description"), f"{name}.{key} has no description"
            if content.get("type") in ("number", "integer") and key != "seed":
                assert "[" in content["description"], (
                    f"{name}.{key}: {content['description']!r} names no unit"
                )


def with_scatter(tmp_path, section, keys):
    """Return the scatter of the contact point of a study's `mismatch` or a virtual lab's `force` with such keys."""
    if section == "mismatch":
        return study_from(paper() | {"mismatch": keys}).mismatch.contact_point_scatter_mm
    lab = yaml.safe_load(Path("config/virtual_lab/demo.yaml").read_text())
    del lab["force"]["contact_point_scatter_mm"]
    (tmp_path / "lab.yaml").write_text(yaml.safe_dump(lab | {"force": lab["force"] | keys}))
    return load_virtual_lab(tmp_path / "lab.yaml").force.contact_point_scatter_mm


@pytest.mark.parametrize("section", ["mismatch", "force"])
def test_a_former_key_is_refused_with_the_new_one(tmp_path, section):
    assert with_scatter(tmp_path, section, {"contact_point_scatter_mm": 0.004}) == 0.004
    with pytest.raises(ConfigError, match=rf"{section}.*touchdown_mm.*write contact_point_scatter_mm"):
        with_scatter(tmp_path, section, {"touchdown_mm": 0.003})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sede": 1}, ["sede", "unknown key"]),
        ({"mechanics": {"frction": 0.4}}, ["mechanics.frction", "unknown key"]),
        ({"mechanics": {"friction": -0.1}}, ["mechanics.friction", "-0.1", "greater than or equal to 0"]),
        ({"mechanics": {"mesh": {"near_mm": 0}}}, ["mechanics.mesh.near_mm", "0", "greater than 0"]),
        ({"dataset": {"test_fraction": 1.5}}, ["dataset.test_fraction", "1.5", "less than 1"]),
        ({"learning": {"steps": "many"}}, ["learning.steps", "many"]),
        ({"learning": {"epochs": 60}}, ["learning.epochs", "unknown key; the keys here are", "steps"]),
        ({"study": "a b"}, ["study", "a b"]),
        ({"plan": {"grid": {"spacing_mm": 2}, "depths_mm": [1, 0.5]}}, ["plan", "must increase"]),
        ({"plan": {"grid": {"spacing_mm": 2}, "depths_mm": [2000.0]}}, ["2000.0", "press less deep"]),
        ({"plan": {"grid": {"spacing_mm": float("nan")}, "depths_mm": [1]}}, ["plan.grid.spacing_mm", "nan"]),
        ({"materials": {}}, ["ecoflex_gel", "not among"]),
        (
            {"variants": {"v": {"mechanics": {"frction": 0.4}}}},
            ["try.yaml: variants.v: mechanics.frction", "unknown key"],
        ),
        (
            {"variants": {"v": {"sensor": {"flange": {"width_mm": -1, "height_mm": 1.5}}}}},
            ["variants.v: sensor.flange.width_mm", "-1", "greater than 0"],
        ),
        ({"variants": {"v": {"learning": {"steps": 3}}}}, ["variants.v.learning", "unknown key"]),
        ({"sensor": "config/sensors/none.yaml"}, ["config/sensors/none.yaml", "no such file"]),
    ],
)
def test_wrong_keys_are_refused_with_key_value_and_limit(change, words):
    with pytest.raises(ConfigError) as refused:
        study_from(paper() | change, "try.yaml")
    for word in words:
        assert word in str(refused.value)


SYMMETRIC = {"grid": {"spacing_mm": 0.55, "margin_mm": 5.0}, "depths_mm": [1.0], "symmetry": "d4"}


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"sensor": {"width_x_mm": 30.0}, "plan": SYMMETRIC}, "square sensor"),
        ({"sensor": {"bins": {"nx": 20, "ny": 10}}, "plan": SYMMETRIC}, "square bins"),
        (
            {
                "plan": {
                    "grid": {"spacing_mm": 2.0, "margin_mm": 16.0},
                    "depths_mm": [1.0],
                    "symmetry": "none",
                }
            },
            None,
        ),
        (
            {"plan": {"grid": {"spacing_mm": 2.0, "margin_mm": 17.0}, "depths_mm": [1.0]}},
            "half the sensor's width",
        ),
    ],
)
def test_plans_that_do_not_fit_the_sensor_are_refused(change, word):
    content = paper()
    sensor = yaml.safe_load(Path(content["sensor"]).read_text())
    content |= {key: value for key, value in change.items() if key != "sensor"}
    content["sensor"] = sensor | change.get("sensor", {})
    study = study_from(content)
    if word is None:
        assert len(plan_cells(study)) == 1
    else:
        with pytest.raises(ConfigError, match=word):
            plan_cells(study)


@pytest.mark.parametrize(
    ("change", "remedy"),
    [
        (
            {"mechanics": {"frction": 0.4}},
            "mechanics.frction, found 0.4: unknown key; did you mean friction?",
        ),
        (
            {"mechanics": {"mesh": {"near": 0.4}}},
            "mechanics.mesh.near, found 0.4: unknown key; did you mean near_mm?",
        ),
        (
            {"materials": {"ecoflex_gel": {"test": "a"}}},
            "materials.ecoflex_gel.test, found 'a': unknown key; did you mean tests?",
        ),
        (
            {"plan": {"grid": {"q": 1, "spacing_mm": 2}, "depths_mm": [1]}},
            "plan.grid.q, found 1: unknown key; the keys here are spacing_mm, margin_mm",
        ),
    ],
)
def test_an_unknown_key_comes_with_the_one_that_was_meant(change, remedy):
    with pytest.raises(ConfigError, match=re.escape(remedy)):
        study_from(paper() | change)


@given(st.text(min_size=1, max_size=12).filter(lambda text: text not in study_keys()))
def test_any_key_that_is_not_named_is_refused(key):
    with pytest.raises(ConfigError, match="unknown key"):
        study_from(paper() | {key: 1})


def test_a_variant_changes_what_it_names_and_nothing_else():
    flange = {"width_mm": 6.5, "height_mm": 1.5}
    change = {"sensor": {"flange": flange}, "mechanics": {"mesh": {"near_mm": 0.6}}}
    study = study_from(paper() | {"variants": {"v": change}})
    varied = variant_study(study, "v")
    base = study.model_dump(mode="json", exclude={"variants"})
    base["sensor"]["flange"], base["mechanics"]["mesh"]["near_mm"] = flange, 0.6
    assert varied.model_dump(mode="json", exclude={"variants"}) == base
    assert study.mechanics.mesh.near_mm == 0.3
    with pytest.raises(ConfigError, match="no variant 'w'"):
        variant_study(study, "w")


@cache
def study_keys() -> set[str]:
    return set(schema()["properties"])


def test_a_study_written_out_reads_back_the_same(tmp_path):
    study = load_study("config/paper.yaml")
    write_yaml(tmp_path / "study.yaml", study)
    assert load_study(tmp_path / "study.yaml") == study
