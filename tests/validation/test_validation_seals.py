"""What was sealed is what is opened; a changed truth, verdict or recording is found."""

import json
import shutil
import sys

import pytest

pytest.importorskip("felupe", reason="FElupe is not installed: pip install -e .[verification]")
from gelforge.config import load_study
from validation import archive, left_out, sealing, sets

NUMBERS = {"null": 2, "single": 1, "pair": 0, "outside": 1}
FAKE = (  # a judge that always says null
    f'{sys.executable} -c "import json, pathlib, sys; out = pathlib.Path(sys.argv[1]); '
    "(out / 'verdict.json').write_text(json.dumps({{'state': 'null', 'answer': [], 'effects': [], 'where': []}}))\" {out}"
)


@pytest.fixture(scope="module")
def judged_once(library, tmp_path_factory):
    folder = tmp_path_factory.mktemp("once") / "small"
    sets.generate({"small": library}, folder, 3, NUMBERS)
    assert sets.judge(folder, FAKE, say=lambda text: None) == 4
    return folder


@pytest.fixture
def judged(judged_once, tmp_path):
    """Return a copy of a judged set, which a test may spoil."""
    return shutil.copytree(judged_once, tmp_path / "sets" / "small", symlinks=True)


def test_a_sealed_truth_comes_back_and_its_salt_hides_it(tmp_path):
    truth = {"case": "c1", "effects": [{"name": "tilt", "parameters": {"about_x": 0.1}}]}
    published = sealing.seal(tmp_path / "c1.json", truth, sealing.salt_of(1, "c1"))
    assert sealing.opened(tmp_path / "c1.json", published) == truth

    # Salts hide that two truths are equal
    seals = [sealing.seal(tmp_path / c, {"content": "null"}, sealing.salt_of(1, c)) for c in ("a", "b")]
    assert seals[0] != seals[1]


def test_all_seals_of_a_judged_set_hold_and_it_is_not_judged_again(judged):
    found = sets.opened(judged)
    assert [case["verdict"]["state"] for case in found] == ["null"] * 4
    assert sorted(case["truth"]["content"] for case in found) == ["null", "null", "outside", "single"]

    # A judged set is not judged again
    assert sets.judge(judged, FAKE, say=lambda text: None) == 0


def test_the_cases_of_one_base_are_judged_first_where_that_is_asked(library, tmp_path):
    folder = tmp_path / "sets" / "small"
    sets.generate({"small": library}, folder, 3, NUMBERS, bases=("concealed", "rough"))
    bases = {
        name: sets.base_config(folder, name).stem for name in sealing.read(folder / "sealed.json")["cases"]
    }
    others = sum(base != "concealed" for base in bases.values())
    assert 0 < others < 4
    assert sets.judge(folder, FAKE, say=lambda text: None, base="concealed") == 4 - others
    assert {bases[name] for name in sealing.read(folder / "judged.json")} == {"concealed"}
    assert sets.judge(folder, FAKE, say=lambda text: None) == others


def test_verdicts_come_back_into_a_set_that_is_generated_again(library, judged, tmp_path):
    packed, kept = tmp_path / "small.tar.xz", judged.parent / "kept"
    kept.mkdir(exist_ok=True)
    (kept / "press.npz").write_bytes(b"solved")
    assert archive.pack(judged, packed) == 4
    first = packed.read_bytes()
    archive.pack(judged, packed)
    assert packed.read_bytes() == first
    again = tmp_path / "elsewhere" / "again"
    sets.generate({"small": library}, again, 3, NUMBERS)
    assert archive.unpack(packed, again) == 4
    assert [c["verdict"]["state"] for c in sets.opened(again)] == ["null"] * 4
    assert (tmp_path / "elsewhere" / "kept" / "press.npz").read_bytes() == b"solved"
    assert sets.judge(again, FAKE, say=lambda text: None) == 0


def test_a_finished_set_is_packed_and_verdicts_of_another_refused(library, judged, tmp_path):
    # A finished set is packed without solutions
    kept = judged.parent / "kept"
    kept.mkdir(exist_ok=True)
    (kept / "press.npz").write_bytes(b"solved")
    assert archive.pack(judged, tmp_path / "small.tar.xz", finished=True) == 4
    sets.generate({"small": library}, tmp_path / "again", 3, NUMBERS)
    assert archive.unpack(tmp_path / "small.tar.xz", tmp_path / "again") == 4
    assert [c["verdict"]["state"] for c in sets.opened(tmp_path / "again")] == ["null"] * 4
    assert not (tmp_path / "kept").exists()

    # Verdicts of another set are refused
    archive.pack(judged, tmp_path / "small.tar.xz")
    sets.generate({"small": library}, tmp_path / "other", 4, NUMBERS)
    with pytest.raises(sealing.SealBroken, match="seed 3"):
        archive.unpack(tmp_path / "small.tar.xz", tmp_path / "other")


def test_a_single_is_judged_again_without_its_effect(judged, monkeypatch):
    monkeypatch.setattr(left_out, "STRONG", 0.0)
    left_out.judge_left_out(judged, FAKE, say=lambda text: None)
    (single,) = [case for case in sets.opened(judged) if case["truth"]["content"] == "single"]
    study = load_study(judged / "left_out" / single["name"] / "study.yaml")
    assert study.mismatch.leave_out == [single["truth"]["effects"][0]["name"]]
    assert study.mismatch.coarser == load_study(sets.base_config(judged, single["name"])).mismatch.coarser
    told = left_out.table_of_left_out(judged)
    assert "nothing said: 1/1" in told and "no name: 0/1" in told


@pytest.mark.parametrize("what", ["truth", "verdict", "recording"])
def test_what_was_changed_is_refused(judged, what):
    if what == "truth":
        path = judged / "truth" / "c000.json"
        content = json.loads(path.read_text())
        content["truth"]["snr"] += 1.0
        path.write_text(json.dumps(content))
    elif what == "verdict":
        path = judged / "verdicts" / "c000" / "verdict.json"
        path.write_text(path.read_text().replace("null", "open"))
    else:
        path = next((judged / "cases" / "c000").rglob("indentations.csv"))
        path.write_text(path.read_text() + "\n")
    with pytest.raises(sealing.SealBroken, match="c000"):
        sets.opened(judged)


def test_a_seed_repeats_every_byte_and_a_failed_judge_leaves_no_verdict(library, tmp_path):
    # A seed repeats every byte
    first, again = (sets.generate({"small": library}, tmp_path / name, 3, NUMBERS) for name in ("a", "b"))
    assert first == again
    other = sets.generate({"small": library}, tmp_path / "c", 4, NUMBERS)
    assert all(other["cases"][c]["truth"] != first["cases"][c]["truth"] for c in first["cases"])

    # A failed judge leaves no verdict
    folder = tmp_path / "sets" / "small"
    sets.generate({"small": library}, folder, 3, NUMBERS)
    sets.judge(folder, f"{sys.executable} -c 'raise SystemExit(3)'", limit=1, say=lambda text: None)
    (case,) = sets.opened(folder)
    assert case["verdict"] is None and case["code"] == 3
