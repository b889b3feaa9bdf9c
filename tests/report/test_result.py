"""The opening of the report: at most five sentences and a table with the numbers of the study's own files."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import fake_results
import fake_verdict
import pandas as pd
import pytest
from test_page import parsed

from gelforge.mismatch.result.verdict import Verdict
from gelforge.report.chapters.chapter import Chapter
from gelforge.report.chapters.learning_chapters import _tell_onnx
from gelforge.report.chapters.recording_chapter import kinds_table
from gelforge.report.chapters.results_reader import StudyResults
from gelforge.report.chapters.table_units import in_units_of_the_page
from gelforge.report.page import CHAPTERS
from gelforge.report.result import result
from gelforge.report.verdict.mismatch_words import answer_text


def sentences(text: str) -> list[str]:
    return re.split(r"(?<=\.)\s+(?=[A-Z0-9])", text)


def test_the_page_opens_with_five_sentences_in_mN_and_N(whole):
    # The page opens with five sentences and a table
    assert CHAPTERS[0] is result
    words, table = result(StudyResults(*whole)).blocks
    assert len(sentences(words.words)) == 5
    value = {row[0]: row[1].replace("\u00a0", " ") for row in table.rows}
    # fake_results: 1 % and 0.4 % of 1.09 to 1.46 N at 2 mm; errors 0.01 N per bin and 0.03 N in total
    assert value["error of the network per pressed bin"] == "10 mN"
    assert value["error of the network in total"] == "0.03 N"
    assert value["network against force sensor, total force"] == "0.12 N"
    assert value["verdict"] == "identified"
    assert "known to 1.1 %" in words.words and "3 times less than the best baseline (ridge)" in words.words
    assert "differ by 11 %" in words.words  # readings are 1.12 of the simulated force
    assert "1 of 25 sites failed" in words.words

    # Forces of bins are in mN and totals in N
    results = StudyResults(*whole)
    table = lambda name: in_units_of_the_page(name, results.table(name))  # noqa: E731
    rmse = table("rmse").set_index("error")
    assert list(rmse["unit"]) == ["mN", "mN", "mN", "N", "N"]
    assert rmse.loc["RMSES", "z"] == pytest.approx(36) and rmse.loc["RMSET_FT", "z"] == pytest.approx(0.12)
    ranges = table("force_ranges").set_index("quantity")
    assert ranges.loc["force per bin", "z_min"] == pytest.approx(-140)
    assert ranges.loc["total force", "z_min"] == pytest.approx(-1.46)
    assert {"RMSES_z_mN", "total_Fz_rms_N"} <= set(table("baselines").columns)
    assert {"bins_z_mN", "total_z_N"} <= set(table("error_budget").columns)
    rows = pd.DataFrame(
        {"quantity": ["bins, z: mean half width", "totals, z: mean half width"], "value": [0.004, 0.03]}
    )
    shown = in_units_of_the_page("reliability", rows.assign(unit="N"))
    assert list(shown["value"]) == [4.0, 0.03] and list(shown["unit"]) == ["mN", "N"]


def test_what_a_study_does_not_have_is_named_and_without_result_there_is_no_table(tmp_path):
    # What a study does not have is named in one sentence
    study = fake_results.fake_study(tmp_path, sessions=False)
    fake_results.write_cells(study, tmp_path / "results")
    words, table = result(StudyResults(study, tmp_path / "results", None)).blocks
    assert len(sentences(words.words)) == 2
    assert "not in this study: a network, readings of a force sensor, a verdict" in words.words
    assert len(table.rows) == 1

    # A study without any result has no table
    nothing = tmp_path / "nothing"
    nothing.mkdir()
    (words,) = result(StudyResults(fake_results.fake_study(nothing), nothing / "nothing", None)).blocks
    assert "25 of 25 sites failed or are missing" in words.words


def test_what_a_study_does_not_have_has_no_row(whole, tmp_path):
    mechanics = whole[0].mechanics.model_copy(update={"error_bars": False})
    results = replace(StudyResults(*whole), study=whole[0].model_copy(update={"mechanics": mechanics}))
    words, table = result(results).blocks
    assert "error bars of labels" in words.words
    assert not any("error bar" in row[0] for row in table.rows)

    # An answer that is none is not named in the opening
    content = fake_verdict.fake_content() | {
        "state": "unexplained",
        "sentence": "No known cause explains it.",
    }
    fake_verdict.write_fake_verdict(tmp_path / "mismatch", content)
    words, table = result(replace(StudyResults(*whole), folder=tmp_path)).blocks[:2]
    assert "No known cause explains it." in words.words
    assert not any("gel stiffness" in cell for row in table.rows for cell in row)


def test_an_answer_has_its_probability_and_findings_of_one_kind_one_row():
    # An answer has probability and the value of its first effect
    said = answer_text(Verdict.model_validate(fake_verdict.fake_content()))
    assert said.startswith(
        "gel stiffness (60 %) or force gain (30 %) or particle settling (10 %): 97 %; gel stiffness scale -9 %"
    )

    # Findings of one kind are one row
    rows = [("day1", "note", "flow_lost", press, "flow", "of a.png fits", "press less") for press in "abc"]
    rows += [("day1", "note", "axes", "", "axes", "never change", "")]
    found = pd.DataFrame(rows, columns=["session", "level", "test", "press", "channel", "found", "remedy"])
    table = kinds_table(found)
    assert list(table["indentations"]) == [3, 0]


def test_bins_are_in_mN_and_caveats_folded_on_the_page(page):
    text = " ".join(parsed(page[0].split("<body>")[1]).text)
    assert "RMSES z [N]" not in text and "bins z [N]" not in text

    # Caveats of material tests are folded
    chapter = page[0].split('<section id="materials">')[1].split("</section>")[0]
    folds = re.findall(r"<details>.*?</details>", chapter, re.DOTALL)
    assert len(folds) == 3  # a material each, and the sites beyond the tested range
    for words in ("tests cannot show", "constitutive models compared", "significant stiffening"):
        assert all(words in fold for fold in folds[:2])
        assert words not in re.sub(r"<details>.*?</details>", "", chapter, flags=re.DOTALL)


def test_a_fold_without_blocks_is_not_shown_and_onnx_is_one_line(tmp_path):
    from gelforge.report.page import write_page

    chapter = Chapter("key", "Title")
    chapter.fold("nothing in it")
    page = write_page(tmp_path / "page.html", "base.html", [chapter])
    assert "<details>" not in page.read_text()

    # A comparison with onnx runtime is one line
    results = SimpleNamespace(folder=tmp_path)
    chapter = Chapter("predictions", "Predictions")
    _tell_onnx(chapter, results)
    assert chapter.blocks == []
    (tmp_path / "model").mkdir()
    found = {"images": 40, "largest_N": 0.14, "largest_difference_N": 5e-8}
    (tmp_path / "model" / "onnx_check.json").write_text(json.dumps(found))
    _tell_onnx(chapter, results)
    assert "40 held-out images: bins differ by 5e-05 mN at most, of up to 140 mN" in chapter.blocks[0].words
