"""verdict.json: its schema, and that it cannot say more than its numbers."""

import json
from pathlib import Path

import pandas as pd
import pytest
from pydantic import ValidationError

from gelforge.files import write_product_json
from gelforge.mismatch.result.verdict import (
    DetectionLimit,
    Verdict,
    VerdictError,
    read_verdict,
    schema,
    write_verdict,
)
from gelforge.mismatch.result.verdict_tables import (
    BODY_MAP,
    LIMITS,
    READINGS,
    check_tables,
    limits_table,
    read_table,
    write_tables,
)


def score(rmse_z: float) -> dict:
    return {"readings": 48, "rmse_N": [None, 0.01, rmse_z]}


def effect(name: str, probability: float, **keys) -> dict:
    return {
        "name": name,
        "family": "material",
        "probability": probability,
        "log_bayes_factor": 12.0,
        "parameters": [{"name": "scale", "unit": "-", "value": 0.05, "interval_90": [0.04, 0.06]}],
        "in_range": True,
    } | keys


def content(**keys) -> dict:
    """Return what an `identified` verdict needs, with other keys."""
    held_out = {
        "block": "all",
        "before": score(0.1),
        "after": score(0.02),
        "gain": 30.0,
        "standard_error": 4.0,
    }
    return {
        "title": "a made-up press",
        "synthetic": True,
        "state": "identified",
        "sentence": "The gel is softer than the study says.",
        "mismatch": {"chi2": 100.0, "degrees": 48, "p": 1e-5, "scan_p": 0.001},
        "answer": [{"members": ["gel_stiffness"], "probability": 0.97}],
        "effects": [effect("gel_stiffness", 0.97), effect("friction", 0.01)],
        "null_probability": 1e-4,
        "fit": {"before": score(0.1), "after": score(0.02), "held_out": held_out},
        "adequacy": {"p": 0.4, "scan_p": 0.3},
        "noise": {
            "stated_N": [0.01, 0.01, 0.02],
            "zero_N": [0, 0, 0],
            "floor_N": [0, 0, 0.001],
            "law_N": [0, 0, 0.002],
        },
        "provenance": {
            "sessions": {"day1": "0" * 64},
            "base": "a made-up study",
            "base_sha256": "1" * 64,
            "seed": 1,
            "draws": 1000,
            "versions": {"gelforge": "0.0.0"},
        },
    } | keys


def test_the_schema_is_current_and_each_state_has_its_form():
    # The schema is current and says what every key is
    assert json.loads(Path("config/verdict_schema.json").read_text()) == schema()

    # Every key says what it is and numbers their unit
    definitions = schema()["$defs"] | {"Verdict": schema()}
    for name, definition in definitions.items():
        for key, described in definition["properties"].items():
            assert described.get("description"), f"{name}.{key} has no description"
            kinds = {described.get("type")} | {option.get("type") for option in described.get("anyOf", [])}
            if kinds & {"number", "integer"} and key != "seed":
                assert "[" in described["description"], f"{name}.{key} names no unit"

    # Each state has its form and no further condition
    for state in ("consistent", "inconclusive", "unexplained"):
        assert Verdict.model_validate(content(state=state, answer=[])).state == state
    unsure = [{"members": ["gel_stiffness"], "alternatives": ["friction"], "probability": 0.6}]
    assert Verdict.model_validate(content(state="ambiguous", answer=unsure)).answer[0].names == [
        "gel_stiffness",
        "friction",
    ]
    for state in ("unexplained", "inconclusive"):
        assert Verdict.model_validate(content(state=state)).answer  # the leading explanation is kept

    # What is consistent asks for more where one test differs
    plain = content(state="consistent", answer=[])
    tests = plain["mismatch"] | {"p": 0.5, "scan_p": 0.5, "unknown_p": None, "known_p": None}
    steps = [
        Verdict.model_validate(plain | {"mismatch": tests | {name: 0.005}}).next_step
        for name in ("p", "scan_p", "unknown_p", "known_p")
    ]
    calm = Verdict.model_validate(plain | {"mismatch": tests})
    assert not calm.mismatch.differs and len(set(steps)) == 1 and calm.next_step not in steps

    # Neither odds within a group nor the held out gain is a condition of a name
    both = [{"members": ["gel_stiffness", "friction"], "probability": 0.95}]
    fit = content()["fit"] | {"held_out": None}
    assert Verdict.model_validate(content(answer=both, fit=fit)).identified

    # What is not sure may stand next to what is
    found = content(
        answer=[
            {"members": [name], "probability": p} for name, p in (("gel_stiffness", 0.97), ("friction", 0.6))
        ]
    )
    assert [group.members for group in Verdict.model_validate(found).sure] == [["gel_stiffness"]]


def test_a_verdict_comes_back_and_the_same_content_gives_the_same_bytes(tmp_path):
    verdict = Verdict.model_validate(content())
    for folder in ("a", "b"):
        write_verdict(tmp_path / folder, verdict)
    assert read_verdict(tmp_path / "a") == verdict
    files = [(tmp_path / folder / "verdict.json").read_bytes() for folder in ("a", "b")]
    assert files[0] == files[1]
    assert set(json.loads(files[0])) == set(schema()["properties"])


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"answer": [{"members": ["gel_stiffness"], "probability": 0.89}]}, "the largest is 0.89"),
        ({"answer": [{"members": ["friction"], "probability": 0.1, "set_probability": 1}]}, "but no line"),
        ({"effects": [effect("gel_stiffness", 0.97, in_range=False)]}, "outside its physical range"),
        ({"adequacy": {"p": 0.4, "scan_p": 0.0019}}, "adequacy p > 0.002"),
        ({"adequacy": None}, "adequacy p > 0.002"),
        ({"fit": content()["fit"] | {"after": None}}, "give fit.after"),
        ({"answer": []}, "identified without an answer"),
        ({"state": "ambiguous", "answer": []}, "ambiguous without an answer"),
        ({"state": "consistent"}, "leave the answer out"),
        (
            {"answer": [{"members": ["friction"], "alternatives": ["yaw"], "probability": 1}]},
            "['yaw'], which are not among the effects",
        ),
        ({"answer": [{"members": ["tilt"], "probability": 1}]}, "['tilt'], which are not among the effects"),
        ({"effects": [effect("gel_stiffness", 1, family="magic")]}, "effects.0.family"),
        ({"null_probability": float("nan")}, "null_probability"),
        ({"state": "certain"}, "state"),
        ({"confidence": 1}, "confidence"),
    ],
)
def test_a_verdict_cannot_say_more_than_its_numbers(keys, words):
    with pytest.raises(ValidationError) as refused:
        Verdict.model_validate(content(**keys))
    where = ".".join(str(part) for part in refused.value.errors()[0]["loc"])
    assert words in f"{where} {refused.value}"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "no such file"),
        ("{", "holds no checksum"),
        (content(state="sure"), "state: Input should be"),
        (content(format="gelforge-verdict-4"), "format: Input should be 'gelforge-verdict-5'"),
    ],
)
def test_a_file_that_is_no_verdict_is_refused_with_its_remedy(tmp_path, text, words):
    if isinstance(text, str):
        (tmp_path / "verdict.json").write_text(text)
    elif text:
        write_product_json(tmp_path / "verdict.json", text)
    with pytest.raises(VerdictError, match=words) as refused:
        read_verdict(tmp_path)
    assert "verdict.json" in str(refused.value) and "gelforge mismatch" in str(refused.value)


def readings() -> pd.DataFrame:
    row = {"session": "day1", "press": 7, "site": 0, "phase": "load", "axis": "z", "held_out": "no"}
    row |= {"x_mm": 16.0, "y_mm": 16.0, "depth_mm": 1.0, "time_s": 3.5}
    return pd.DataFrame(
        [row | {"measured_N": -0.4, "base_N": -0.5, "after_N": float("nan"), "sigma_N": 0.02}]
    )


def written(folder: Path, tables: dict) -> Verdict:
    """Write tables and a verdict that has their SHA-256; return it."""
    verdict = Verdict.model_validate(content(tables=write_tables(folder, tables)))
    write_verdict(folder, verdict)
    return verdict


def flipped(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def of_another_verdict(path: Path) -> None:
    write_tables(path.parent, {READINGS: readings().assign(measured_N=-0.41)})


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (flipped, "damaged or edited: its bytes have the SHA-256"),
        (lambda path: path.write_bytes(path.read_bytes()[:-1]), "damaged or edited"),
        (of_another_verdict, "damaged or edited"),
        (Path.unlink, "no such file"),
    ],
)
def test_a_table_that_is_not_the_verdicts_is_refused_with_its_remedy(tmp_path, damage, words):
    verdict = written(tmp_path, {READINGS: readings()})
    check_tables(tmp_path, verdict)
    damage(tmp_path / READINGS)
    for read in (lambda: read_table(tmp_path, READINGS), lambda: check_tables(tmp_path, verdict)):
        with pytest.raises(VerdictError, match=rf"readings.csv: {words}.*; write it anew") as refused:
            read()
        if "damaged" in words:
            assert verdict.tables[READINGS][:12] in str(refused.value)


def test_tables_come_back_with_their_columns(tmp_path):
    with pytest.raises(VerdictError, match=r"sigma_N.*missing"):
        write_tables(tmp_path, {READINGS: readings().drop(columns="sigma_N")})
    assert not (tmp_path / "readings.csv").exists()

    # Tables come back
    patches = pd.DataFrame({"x_mm": [3.0], "y_mm": [3.0], "z_mm": [-1.0], "change": [0.1], "sigma": [0.3]})
    written(tmp_path, {READINGS: readings(), BODY_MAP: None})
    found = read_table(tmp_path, READINGS)
    assert found.loc[0, ["press", "axis", "measured_N"]].tolist() == ["7", "z", -0.4]
    assert found[["after_N", "after_sigma_N"]].isna().all(axis=None)
    assert read_table(tmp_path, BODY_MAP) is None
    verdict = written(tmp_path, {READINGS: readings(), BODY_MAP: patches})
    pd.testing.assert_frame_equal(read_table(tmp_path, BODY_MAP), patches)
    assert set(verdict.tables) == {READINGS, BODY_MAP}
    written(tmp_path, {READINGS: readings(), BODY_MAP: None})
    assert not (tmp_path / BODY_MAP).exists()  # of the verdict before

    # A detection limit that nothing reaches is an empty cell
    limit = {"effect": "refraction", "parameter": "index", "unit": "-", "plausible": 0.05}
    limits = [DetectionLimit(**limit, value=None), DetectionLimit(**limit, value=0.0312)]
    written(tmp_path, {LIMITS: limits_table(limits)})
    assert (tmp_path / LIMITS).read_text().splitlines()[1] == "refraction,index,-,,0.05"
    assert read_table(tmp_path, LIMITS)["value"].isna().tolist() == [True, False]

    # A table has the columns that are documented and no other
    write_tables(tmp_path, {READINGS: readings().assign(own=1)})
    plain = pd.read_csv(tmp_path / READINGS)
    assert list(plain) == [
        *("session", "press", "site", "phase", "axis", "held_out"),
        *("x_mm", "y_mm", "depth_mm", "measured_N", "base_N", "sigma_N", "time_s", "after_N"),
    ]
