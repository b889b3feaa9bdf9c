"""Pooled scores: an archive whose answers are known, seals that are checked, intervals of items that are not independent."""

import io
import json
import tarfile
from pathlib import Path

import numpy as np
import pytest

from validation import sealing
from validation.archive import ARCHIVES
from validation.claims import by_exponent
from validation.pooled import archived, clustered, report, scores, table
from validation.score import Rate
from validation.trust import PAGE, page
from validation.truths import read_truths

SAID = {  # state, groups; what is hidden
    "c0": ("null", [], None),
    "c1": ("named", [(["yaw"], 0.95)], None),
    "c2": ("named", [(["tilt"], 0.97)], "tilt"),
    "c3": ("group", [(["wedge", "tilt"], 0.93)], "tilt"),
    "c4": ("open", [(["tilt"], 0.99)], "tilt"),
    "c5": ("group", [(["tilt", "wedge"], 0.7)], "tilt"),
}


def truth_of(case: str, hidden: str | None) -> dict:
    effects = [{"name": hidden, "form": "turned body", "snr": 10.0, "parameters": {}}] if hidden else []
    content, snr = ("single", 10.0) if hidden else ("null", 0.0)
    return {"case": case, "sealed": f"seal of {case}", "content": content, "snr": snr, "effects": effects}


def write_archive(folder: Path, spoilt: str = "") -> Path:
    files, register = {}, {}
    for case, (state, groups, _) in SAID.items():
        answer = [{"members": members, "probability": p} for members, p in groups]
        verdict = json.dumps(
            {"state": state, "answer": answer, "effects": [], "mismatch": {"p": 0.5}}
        ).encode()
        register[case] = {"sha256": sealing.digest(verdict, b""), "seconds": 2.0, "code": 0}
        files[f"verdicts/{case}/verdict.json"] = verdict + b" " * (case == spoilt)
    published = {"cases": {case: {"truth": f"seal of {case}"} for case in SAID}}
    files |= {sealing.SEALED: json.dumps(published).encode(), sealing.REGISTER: json.dumps(register).encode()}
    path = folder / "twelfth.tar.xz"
    with tarfile.open(path, "w:xz") as packed:
        for name, data in files.items():
            entry = tarfile.TarInfo(f"set/{name}")
            entry.size = len(data)
            packed.addfile(entry, io.BytesIO(data))
    return path


TRUTHS = {case: truth_of(case, hidden) for case, (*_, hidden) in SAID.items()}


def test_an_archive_is_scored_as_its_answers_say(tmp_path):
    found = scores(archived(write_archive(tmp_path), TRUTHS))
    assert found["cases"] == "6"
    assert found["nulls: a mismatch is reported"].startswith("1/2 = 50.0 %")
    assert found["wrong with 0.9 and more"].startswith("1/6 = 16.7 %")
    assert found["single, SNR >= 8: identified"].startswith("2/4 = 50.0 %")
    assert found["single, SNR >= 8: identified, first of its group"].startswith("1/4")
    assert found["single, SNR >= 8: identified, or in an ambiguous answer"].startswith("3/4")
    assert found["claims of probability 0.9 and more: right"].startswith("2/3")
    assert found["seconds, single: median; largest"] == "2; 2"
    assert found["pair: both identified"] == ""

    # A table leaves out what no column has
    found = table({"own": archived(write_archive(tmp_path), TRUTHS)})
    assert "pair: both" not in found and "nulls: a mismatch is reported" in found


def test_changed_verdicts_other_truths_and_missing_archives_are_named(tmp_path):
    # A changed verdict and the truth of another set are refused
    with pytest.raises(sealing.SealBroken, match="c3"):
        archived(write_archive(tmp_path, spoilt="c3"), TRUTHS)

    # The truth of another set is refused
    others = TRUTHS | {"c2": TRUTHS["c2"] | {"sealed": "another"}}
    with pytest.raises(sealing.SealBroken, match="c2"):
        archived(write_archive(tmp_path), others)

    # Sets without an archive are named
    write_archive(tmp_path)
    said = report(tmp_path, {"twelfth": TRUTHS})
    assert "thirteenth" in said.splitlines()[0] and "twelfth" not in said.splitlines()[0]


def test_clustered_items_widen_the_interval_and_sure_claims_want_a_smaller_exponent():
    # Items of one case widen the interval. Ten items of a case that are right or wrong together say as much as one:
    # the interval is that of the cases
    cases = [[k % 4 > 0] * 10 for k in range(40)]
    rate, (low, high) = clustered(cases)
    assert rate == Rate(300, 400)
    binomial = 1.96 * np.sqrt(0.75 * 0.25 / 40)
    assert (high - low) / 2 == pytest.approx(
        binomial, rel=0.1
    )  # of 4000 draws; by items it would be a third of it
    assert clustered([[True, True]] * 9)[1] == Rate(9, 9).interval()
    assert clustered([[], []]) == (Rate(0, 0), (0.0, 1.0))

    # Claims that are too sure score best at a smaller exponent. Of claims of 0.99 eight in ten are right: the best
    # exponent takes the odds of 99 to 4
    p, right = np.full(100, 0.99), np.arange(100) % 5 > 0
    rows = by_exponent(p, right, exponents=(1.0, np.log(4) / np.log(99), 0.1))
    assert rows["log score"].idxmax() == 1
    assert list(rows["claims >= 0.9"]) == [100, 0, 0] and rows["right"][0] == 80


def test_the_seventeenth_set_and_the_page_of_results_are_as_printed():
    # The seventeenth set scores as when it was opened. Of effects outside the catalogue six of six strong ones and
    # seven of all 14 have no name; none is wrong with 0.9
    found = scores(archived(ARCHIVES / "seventeenth.tar.xz", read_truths()["seventeenth"]))
    assert found["outside the catalogue, SNR >= 8: not named"].startswith("6/6")
    assert found["outside the catalogue, all: not named"].startswith("7/14")
    assert found["wrong with 0.9 and more"].startswith("0/14")

    # The page of results is what the command prints
    assert PAGE.read_text(encoding="utf-8") == page(), (
        "docs/results/verdicts.md is old: python -m validation trust"
    )


KEPT = ARCHIVES.parent / "pooled.md"


@pytest.mark.thorough
def test_pooled_md_is_what_the_command_prints():
    assert KEPT.read_text(encoding="utf-8") == report(ARCHIVES)
