"""The page: complete, offline, and honest about what is missing or synthetic."""

from __future__ import annotations

import base64
import re
from datetime import UTC, datetime
from html.parser import HTMLParser
from types import SimpleNamespace

import fake_results
import fake_tables
import numpy as np
import pytest

from gelforge.report.chapters.beside_paper import beside_paper
from gelforge.report.chapters.chapter import Chapter, cell_text, heading
from gelforge.report.chapters.learning_chapters import TABLES
from gelforge.report.chapters.material_chapter import _unstable
from gelforge.report.chapters.results_reader import StudyResults
from gelforge.report.page import CHAPTERS, code, write_report

FETCHING = {"src", "href", "srcset", "data", "poster", "action"}


class Links(HTMLParser):
    """Collects what a browser would fetch, the headings and the chapters of a page."""

    def __init__(self):
        super().__init__()
        self.targets, self.pictures, self.ids, self.text = [], [], [], []

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.targets += [value for key, value in attrs if key in FETCHING]
        self.ids += [attributes["id"]] if "id" in attributes else []
        self.pictures += [attributes] if tag == "img" else []

    def handle_data(self, data):
        self.text.append(data)


def parsed(html: str) -> Links:
    links = Links()
    links.feed(html)
    return links


def test_page_fetches_nothing_has_every_chapter_and_pictures_under_sentences(page):
    # Page fetches nothing and has every chapter
    links = parsed(page[0])
    assert links.pictures
    followed = {"mismatch/report.html", "verification.html"}  # by a click, to files of the same results
    for target in set(links.targets) - followed:
        assert target.startswith(("#", "data:")), target
    assert not re.search(r"@import|url\(|<script", page[0])

    # Every chapter is in the contents
    anchors = [target[1:] for target in links.targets if target.startswith("#")]
    assert len(links.ids) == len(CHAPTERS)
    assert set(links.ids) <= set(anchors)

    # Whole study misses nothing
    assert page[1] == []

    # Every figure is a picture under a sentence
    pictures = parsed(page[0]).pictures
    # sensor, two materials, force-depth, error bars, section, flow, flow over depth, residual, errors, their budget, loss,
    # two force maps, totals, verdict
    assert len(pictures) == 16
    for picture in pictures:
        head, _, content = picture["src"].partition("base64,")
        assert head == "data:image/svg+xml;"
        assert b"<svg" in base64.b64decode(content)
        assert len(picture["alt"].split()) >= 8
    assert page[0].count("<figcaption>") >= len(pictures)


def test_the_page_shows_materials_variants_failures_rows_and_time(page):
    # Materials show effects laws and the cells beyond the tested range
    text = " ".join(parsed(page[0]).text)
    assert "significant stiffening with age" in text
    assert "friction: no friction.csv" in text
    assert "constitutive models compared" in text and "12.5" in text
    assert (
        "tested at stretches 1 to 1.8 in equibiaxial" in text
        and "Drucker-stable in all of the tested range" in text
    )
    assert "leave the range in which a constitutive model was tested" in text and "share of volume" in text

    # Variants stand next to the study
    chapter = page[0].split('<section id="force-depth">')[1].split("</section>")[0]
    assert "Variant flange: with a flange." in chapter
    assert "variant flange Fz [N]" in chapter

    # What failed or was left out is named with its reason
    failed = page[0].split('<section id="failed">')[1].split("</section>")[0]
    assert fake_results.FAILED in failed
    assert "no equilibrium at 1 mm after 4 halvings" in failed
    assert "0.5" in failed  # the last good depth [mm]

    # What was left out of a recording is listed
    assert "Left out: force of 1 indentation" in page[0] and "No image is left out" in page[0]
    assert "p00003" in page[0] and "record without gaps" in page[0]

    # Glance and time count rows and seconds
    assert "124 rows (100 for training, 24 held out) in 1 shard" in page[0]

    # Time per stage names stages and units
    time = page[0].split('<section id="time">')[1].split("</section>")[0]
    assert re.search(r">cells</td>\s*<td[^>]*>25<", time)
    assert {"all jobs [s]", "largest memory [MB]"} <= set(re.findall(r"<th[^>]*>([^<]*)</th>", time))


def test_unstable_laws_are_listed_and_headings_written_as_html():
    # Cells with a law that proved unstable are listed
    cell = SimpleNamespace(name="x1_y1", depths_mm=(0.5, 1.0))
    shares = np.array([[0.0, 0.0], [0.0, 0.03]])
    attributes = {"law_unstable": np.array([0, 1]), "volume_law_unstable": shares, "regions": ["gel", "skin"]}
    older = SimpleNamespace(name="x0_y0", depths_mm=(0.5,))  # a file from before the check
    chapter = Chapter("materials", "Materials")
    cells = {"x1_y1": attributes, "x0_y0": {}}
    _unstable(chapter, SimpleNamespace(converged=lambda: [cell, older], cell_attributes=cells))
    (table,) = chapter.blocks
    assert "1 site reach" in table.words and "not Drucker-stable" in table.words
    assert table.rows == [["x1_y1", "1", "skin", "0.03"]]

    # Headings and code are written as html
    assert heading("x_N") == "x [N]"
    assert heading("low_95") == "low 95"
    assert heading("RMSES_x_N") == "RMSES x [N]"

    # What stands between backticks is code and all else is escaped
    assert code("`a < b` or <i>, 5`") == "<code>a &lt; b</code> or &lt;i&gt;, 5`"
    assert code(3) == "3"


@pytest.mark.usefixtures("undrawn")
def test_an_unsolved_variant_is_named_and_measured_data_not_called_synthetic(tmp_path):
    # A variant that was not solved is named
    study = fake_results.fake_study(tmp_path, sessions=False, variants=["flange"])
    folder = tmp_path / "results"
    fake_results.write_cells(study, folder)
    missing = write_report(study, folder, tmp_path / "page.html", tmp_path / "paper")
    assert any("No curve of variant flange" in words and "variants" in words for words in missing)

    # Measured data is not called synthetic
    measured = tmp_path / "measured"
    measured.mkdir()
    study = fake_results.fake_study(measured)
    folder = measured / "results"
    fake_results.write_cells(study, folder)
    fake_results.write_session(study)
    description = study.session_folder("day1") / "session.yaml"
    description.write_text(description.read_text().replace("synthetic: true", "synthetic: false"))
    write_report(study, folder, measured / "page.html", measured / "paper")
    html = (measured / "page.html").read_text(encoding="utf-8")
    assert "SYNTHETIC" not in html


@pytest.fixture(scope="module")
def not_the_articles(whole, tmp_path_factory):
    """Return the folder of the whole study's pages, made as those of any study but the article's, and what was missing."""
    folder = tmp_path_factory.mktemp("other")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(
            "gelforge.report.chapters.chapter.data_uri", lambda figure: "data:image/svg+xml;base64,"
        )
        return folder, write_report(whole[0], whole[1], folder / "page.html")


def test_verification_is_a_page_of_its_own_without_the_articles_numbers(not_the_articles):
    folder, _ = not_the_articles
    chapter = (
        (folder / "page.html").read_text().split('<section id="verification">')[1].split("</section>")[0]
    )
    assert "1 check of 2 FAILED" in chapter
    assert "Hertz: force [N]" not in chapter
    own = (folder / "verification.html").read_text()
    assert "Hertz: force [N]" in own
    assert {"page.html#verification", "page.html#origin"} <= set(parsed(own).targets)

    # The articles numbers stand in its own study only
    folder, missing = not_the_articles
    body = (folder / "page.html").read_text().split("</style>")[1]
    said = " ".join([*missing, *parsed(body).text])
    assert re.findall(r"published|\b(?:article|paper)\b", said) == []


def test_labels_alone_and_a_study_without_verdict_omit_nothing(tmp_path):
    # Labels alone are not verified and that is no omission
    study = fake_results.fake_study(tmp_path, sessions=False)
    missing = write_report(study, tmp_path / "nothing", tmp_path / "page.html")
    assert not any("verif" in words for words in missing)
    assert "Not run: a study of labels only" in (tmp_path / "page.html").read_text()
    assert not (tmp_path / "verification.html").exists()

    # A study that leaves the verdict out misses none
    unjudged = tmp_path / "unjudged"
    unjudged.mkdir()
    study = fake_results.fake_study(unjudged)
    left_out = study.mismatch.model_copy(update={"judged": False})
    study = study.model_copy(update={"mismatch": left_out})
    missing = write_report(study, unjudged / "nothing", unjudged / "page.html")
    assert not any("verdict" in words for words in missing)
    assert "mismatch.judged: false" in (unjudged / "page.html").read_text()


def test_synthetic_data_is_labelled_loudly(page):
    assert 'role="alert"' in page[0]
    text = " ".join(parsed(page[0]).text)
    assert "SYNTHETIC DATA." in text
    assert "The recordings and material tests of this study were made by a virtual lab" in text
    origin = page[0].split('<section id="origin">')[1]
    assert origin.count("SYNTHETIC tests") == 2
    assert origin.count("SYNTHETIC recording") == 1
    assert {"SYNTHETIC image", "SYNTHETIC readings"} <= set(re.findall(r"SYNTHETIC \w+", page[0]))


@pytest.mark.usefixtures("undrawn")
def test_labels_only_study_says_what_is_left_out(tmp_path):
    study = fake_results.fake_study(tmp_path, sessions=False)
    folder, paper = tmp_path / "results", tmp_path / "paper"
    fake_results.write_cells(study, folder)
    fake_tables.write_paper(paper)
    missing = write_report(study, folder, tmp_path / "page.html", paper)
    said = "\n".join(missing)
    for what in (
        "No images",
        "No comparison with readings",
        "No network",
        "No network and no readings",
        "No verdict",
    ):
        assert what in said
    assert "it makes force labels only" in said
    html = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert all(words.split(":")[0] in html for words in missing)
    assert len(parsed(html).pictures) == 4  # sensor, force-depth, error bars, section


@pytest.mark.usefixtures("undrawn")
def test_a_plan_without_centre_or_another_sensor_is_not_compared(tmp_path):
    # Plan without centre says so
    study = fake_results.fake_study(
        tmp_path, sessions=False, spacing=6.5
    )  # 4 x 4 positions, none at (16, 16)
    fake_results.write_cells(study, tmp_path / "results")
    fake_tables.write_paper(tmp_path / "paper")
    missing = write_report(study, tmp_path / "results", tmp_path / "page.html", tmp_path / "paper")
    assert any("No curve at the centre" in words for words in missing)
    assert any("No curve at the corner" in words for words in missing)

    # Other sensor is not compared with the paper
    other = tmp_path / "other"
    other.mkdir()
    study = fake_results.fake_study(other, sessions=False)
    study = study.model_copy(update={"indenter": study.indenter.model_copy(update={"radius_mm": 4.0})})
    fake_results.write_cells(study, other / "results")
    fake_tables.write_paper(other / "paper")
    missing = write_report(study, other / "results", other / "page.html", other / "paper")
    assert any("differs from the paper's" in words for words in missing)
    assert "published FEM" not in (other / "page.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("undrawn")
def test_missing_cells_are_listed_and_an_empty_folder_still_gives_a_page(tmp_path):
    # Missing cell file is listed
    study = fake_results.fake_study(tmp_path, sessions=False)
    folder = tmp_path / "results"
    fake_results.write_cells(study, folder)
    (folder / "cells" / "x1_y1.h5").unlink()
    (folder / "cells" / "x3_y3.h5").write_bytes(b"cut short")
    write_report(study, folder, tmp_path / "page.html", tmp_path / "paper")
    html = (tmp_path / "page.html").read_text(encoding="utf-8")
    failed = html.split('<section id="failed">')[1].split("</section>")[0]
    for part in ("x1_y1", "no such file", "x3_y3", "holds no checksum"):
        assert part in failed
    assert "22 converged, 3 failed or missing" in html

    # Empty results folder still gives a page
    empty = tmp_path / "empty"
    empty.mkdir()
    study = fake_results.fake_study(empty)
    missing = write_report(study, empty / "nothing", empty / "page.html", empty / "paper")
    assert len(missing) >= 8
    assert "25 sites failed or missing" in (empty / "page.html").read_text(encoding="utf-8")


def test_same_inputs_give_the_same_bytes(tmp_path):
    study = fake_results.fake_study(tmp_path, sessions=False)
    fake_results.write_cells(study, tmp_path / "results")
    when = datetime(2026, 1, 1, tzinfo=UTC)
    for name in ("a", "b"):
        write_report(study, tmp_path / "results", tmp_path / name, tmp_path / "paper", written=when)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.inf, "∞"),
        (0.123456, "0.1235"),
        (float("nan"), "–"),
        (None, "–"),
        (True, "yes"),
        ("gel", "gel"),
        (7, "7"),
    ],
)
def test_cell_text(value, text):
    assert cell_text(value) == text


def test_tables_have_the_papers_numbers_beside_them(whole):
    results = StudyResults(*whole)
    names = [*TABLES, "material"]
    table = {name: beside_paper(name, results.table(name), results.paper) for name in names}
    rmse = table["rmse"].set_index("error")
    for error, published in fake_tables.PAPER_ERRORS.items():
        for axis, value in published.items():
            assert rmse.loc[error, f"paper_{axis}_N"] == value
    gt = table["rmse_gt"].set_index("axis")
    assert gt["paper_RMSE_GT_N"].to_dict() == {"x": 0.02, "y": 0.02, "z": 0.06}
    ranges = table["force_ranges"].set_index("quantity")
    assert list(ranges.index) == [
        "force per bin",
        "force per bin, paper",
        "total force",
        "total force, paper",
    ]
    assert ranges.loc["total force, paper", "z_min_N"] == -1.66
    material = table["material"]
    row = material[(material.material == "elastosil_25_1") & (material.quantity == "alpha_2")]
    assert row["paper"].tolist() == [-8.2915]
    assert material[material.quantity == "E"]["paper"].tolist() == [16.9, 370.2]
    assert material[material.quantity == "R2 uniaxial"]["paper"].isna().all()
