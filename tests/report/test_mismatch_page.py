"""The verdict's page: one sentence first, one colour scale, and nothing said that its folder does not hold."""

from __future__ import annotations

import base64
import re
from datetime import UTC, datetime
from pathlib import Path

import fake_results
import fake_verdict
import numpy as np
import pytest
from matplotlib.collections import PatchCollection, QuadMesh
from test_page import parsed

from gelforge.mismatch.result.verdict import NoiseCase, Verdict, VerdictError
from gelforge.report.chapters.results_reader import StudyResults
from gelforge.report.mismatch_page import write_mismatch_page
from gelforge.report.verdict import mismatch_curves, mismatch_maps
from gelforge.report.verdict.mismatch_chapters import CHAPTERS, mismatch
from gelforge.report.verdict.mismatch_reader import MismatchResults
from gelforge.report.verdict.mismatch_words import amounts_text, p_text, shape_text, unbroken


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return fake_verdict.write_fake_verdict(tmp_path_factory.mktemp("verdict"))


@pytest.fixture(scope="module")
def results(folder) -> MismatchResults:
    return MismatchResults(folder)


@pytest.fixture(scope="module")
def html(folder) -> str:
    return write_mismatch_page(folder).read_text(encoding="utf-8")


def section(html: str, key: str) -> str:
    return html.split(f'<section id="{key}">')[1].split("</section>")[0]


def test_the_sentence_stands_first_under_the_synthetic_banner(html):
    text = [words.strip() for words in parsed(html.split("<body>")[1]).text if words.strip()]
    sentence = text.index(fake_verdict.fake_content()["sentence"])
    assert sentence <= 6  # after the line of the title, the banner and the state
    assert text.index("SYNTHETIC DATA.") < sentence
    assert "identified: a known cause explains the difference" in text[sentence - 1]


def test_articles_fit_the_words_that_are_put_in_after_them(html):
    text = " ".join(parsed(html.split("<body>")[1]).text)
    assert re.findall(r"\b(?:[Aa]n [b-df-hj-np-tv-z]\w+|[Aa] [aeio]\w+)", text) == []


def test_page_fetches_nothing_and_has_every_chapter(html):
    links = parsed(html)
    assert all(target.startswith(("#", "data:")) for target in links.targets)
    assert not re.search(r"@import|url\(|<script", html)
    assert len(links.ids) == len(CHAPTERS)
    assert {f"#{key}" for key in links.ids} <= set(links.targets)


def test_every_figure_is_a_picture_under_a_sentence(html):
    pictures = parsed(html).pictures
    # headline, maps, depth, time, body, profiles, held out, noise
    assert len(pictures) == 8
    for picture in pictures:
        assert b"<svg" in base64.b64decode(picture["src"].partition("base64,")[2])
        assert len(picture["alt"].split()) >= 8


def test_what_people_want_to_read_is_there(html):
    assert "held out for the proof" in section(html, "where") and "grows with depth" in section(html, "where")
    effects = section(html, "effects").replace("\u00a0", " ")
    assert effects.index("gel stiffness") < effects.index("force gain") < effects.index("layer thickness")
    assert "scale -0.09 (-0.1 to -0.078)" in effects and "62 %" in effects
    names = [effect["name"].replace("_", " ") for effect in fake_verdict.fake_content()["effects"]]
    assert not [name for name in names if name not in effects]  # the table ends earlier, names do not vanish
    undecided = section(html, "undecided").replace("\u00a0", " ")
    assert "gel stiffness, force gain, particle settling: Put dead weights" in undecided
    assert "dead weights" in undecided and "10 min" in undecided
    unknown = section(html, "cannot-know")
    assert "No site was pressed twice" in unknown and "Of 4 values 2 would stay hidden" in unknown
    assert "far from its neighbours over depth" in section(html, "outliers")
    assert "SYNTHETIC: made by" in section(html, "origin")


def test_residuals_are_measured_minus_simulated(results):
    z = results.readings[results.readings["axis"] == "z"]
    # pressing gives negative Fz and the made-up sensor is softer: it reads less negative than simulated
    assert z["before"].mean() > 0.03
    assert abs(z["after"].mean()) < 3 * z["sigma_N"].mean() / np.sqrt(len(z))
    assert results.strongest_axis == "z"


def test_maps_before_and_after_share_one_colour_scale(results):
    figure = mismatch_maps.residual_maps_figure(results)
    limits = {
        shown.get_clim()
        for ax in figure.axes
        for shown in ax.collections
        if isinstance(shown, PatchCollection)
    }
    assert len(limits) == 1
    low, high = limits.pop()
    assert low == -high and high == pytest.approx(
        results.site_means[["before", "after"]].abs().max(axis=None)
    )
    assert sum(isinstance(s, PatchCollection) for ax in figure.axes for s in ax.collections) == 6
    assert len(figure.axes) == 7  # one colour bar


def test_held_out_sites_have_a_dark_frame(results):
    ax = mismatch_maps.residual_maps_figure(results).axes[0]
    widths = ax.collections[0].get_linewidths()
    assert (np.asarray(widths) > 1).sum() == len(fake_verdict.ASIDE)


def test_a_located_defect_is_circled(tmp_path):
    content = fake_verdict.fake_content()
    defect = {"words": "void", "x_mm": 12.0, "y_mm": 20.0, "radius_mm": 2.0, "layer": "gel"}
    content["where"].append(defect)
    found = MismatchResults(fake_verdict.write_fake_verdict(tmp_path, content))
    (circle,) = mismatch_maps.residual_maps_figure(found).axes[3].patches
    assert (circle.center, circle.radius) == ((12.0, 20.0), 2.0)


def test_body_map_puts_each_patch_where_it_is(tmp_path, results):
    patches = fake_verdict.fake_body_map()
    spot = (patches["x_mm"] == patches["x_mm"].max()) & (patches["y_mm"] == patches["y_mm"].min())
    patches["change"] = np.where(spot & (patches["z_mm"] == -3.0), 0.5, 0.0)
    fake_verdict.write_fake_verdict(tmp_path)
    fake_verdict.write_body_map(tmp_path, patches)
    figure = mismatch_maps.body_map_figure(MismatchResults(tmp_path))
    titles = [ax.get_title() for ax in figure.axes[:3]]
    assert [title.split(",")[0] for title in titles] == ["skin", "gel", "gel"]
    levels = [
        next(c for c in ax.collections if isinstance(c, QuadMesh)).get_array().reshape(6, 6)
        for ax in figure.axes[:3]
    ]
    assert levels[1][0, 5] == 50.0 and np.count_nonzero(levels) == 1  # [row of y, column of x], in percent
    assert [len(ax.lines) for ax in figure.axes[:3]] == [0, 1, 0]  # framed: beyond two sigma
    assert mismatch_maps.known_patches(patches) == 1


def test_depth_figure_shows_loading_unloading_and_bands(results):
    figure = mismatch_curves.depth_figure(results)
    upper, lower = figure.axes[0], figure.axes[3]
    labels = upper.get_legend_handles_labels()[1]
    assert labels == ["simulated before", "simulated after", "measured"]
    before, after = (line.get_ydata() for line in upper.lines[:2])
    assert (
        np.all(before[1:] > after[1:]) and before[0] == 0
    )  # the softer one lies below, from no force at no depth
    assert len(upper.collections) == 2 and len(lower.collections) == 1
    sites = [site for site, _ in results.shown_sites()]
    assert len(set(sites)) == len(sites) == 3
    assert any(results.site_means.set_index("site").loc[[site], "held_out"].all() for site in sites)


def test_time_figure_lays_sessions_end_to_end(results):
    table, ends = mismatch_curves._session_time(results.readings)
    assert [name for name, *_ in ends] == ["day1", "day2"]
    assert ends[1][1] > ends[0][2] > ends[0][1] == 0
    day1 = table[table["session"] == "day1"]
    assert day1["minute"].max() == pytest.approx((day1["time_s"].max() - day1["time_s"].min()) / 60)


@pytest.mark.usefixtures("undrawn")
def test_a_null_has_no_after_and_says_so(tmp_path):
    folder = fake_verdict.write_fake_verdict(
        tmp_path, fake_verdict.nothing_missing(), change=0.0, after=False
    )
    (folder / "body_map.csv").unlink()
    html = write_mismatch_page(folder).read_text(encoding="utf-8")
    assert "nothing is missing that they could show" in html.split("<main>")[0]
    assert "nothing was put into the simulation" in section(html, "short")
    assert "No pattern stands out" in section(html, "where")
    assert "No body map" in section(html, "body")
    assert "Nothing was put into the simulation" in section(html, "held-out")
    assert "every reading was judged" in section(html, "outliers")
    figure = mismatch_maps.residual_maps_figure(MismatchResults(folder))
    assert len(figure.axes) == 4  # one row, one bar


@pytest.mark.usefixtures("undrawn")
def test_each_effect_of_a_credible_set_has_its_share_and_value(tmp_path):
    content = fake_verdict.fake_content()
    first = content["answer"][0]
    first |= {
        "members": ["gel_stiffness", "force_gain"],
        "alternatives": ["layer_thickness"],
        "set_probability": 0.99,
    }
    first["shares"] = {"gel_stiffness": 0.7, "force_gain": 0.2, "layer_thickness": 0.1}
    content["answer"].append({"members": ["tilt"], "probability": 0.6})
    folder = fake_verdict.write_fake_verdict(tmp_path, content)
    short = section(write_mismatch_page(folder).read_text(encoding="utf-8"), "short").replace("\u00a0", " ")
    for share in ("70 %", "20 %", "10 %", "99 %", "60 %"):
        assert share in short
    assert short.count("same as the first") == 1 and "scale -0.09" in short and "one patch serves" in short
    first["differs_snr"] = 5.0
    folder = fake_verdict.write_fake_verdict(tmp_path / "unlike", content)
    short = section(write_mismatch_page(folder).read_text(encoding="utf-8"), "short")
    assert "predict readings that differ by 0.0004 N rms at most" in short


@pytest.mark.usefixtures("undrawn")
def test_what_is_modelled_without_a_cause_is_said_with_its_range(tmp_path):
    content = fake_verdict.fake_content()
    held = content["fit"]["held_out"] | {"gain": 12.0, "standard_error": 3.0}
    content["model"] = {
        "words": "a change of the pressing force with depth",
        "beside": ["gel_stiffness"],
        "largest_N": [None, 0.001, 0.05],
        "depth_mm": [0.25, 2.0],
        "sites": 25,
        "corrects_labels": True,
        "held_out": held,
    }
    folder = fake_verdict.write_fake_verdict(tmp_path, content)
    html = write_mismatch_page(folder).read_text(encoding="utf-8")
    assert "identified: a known cause explains the difference" in html
    effects = section(html, "effects")
    assert (
        "Modelled without a known cause together with gel stiffness: a change of the pressing force with depth"
        in effects
    )
    assert "0.05 N at most" in effects and "0.25 to 2 mm at 25 positions" in effects and "+12 ± 3" in effects
    assert "correction.csv" in effects
    content["model"] |= {"cause": "modulus_map", "probability": 0.97}
    folder = fake_verdict.write_fake_verdict(tmp_path / "of a cause", content)
    effects = section(write_mismatch_page(folder).read_text(encoding="utf-8"), "effects")
    assert (
        "A cause with a free form, of probability 0.97; module.csv has its map together with gel stiffness"
        in effects
    )
    assert "Modelled without a known cause" not in effects


@pytest.mark.parametrize("state", ["unexplained", "ambiguous"])
@pytest.mark.usefixtures("undrawn")
def test_a_discrepancy_is_described_where_no_cause_explains_the_readings(tmp_path, state):
    content = fake_verdict.fake_content() | {"state": state}
    folder = fake_verdict.write_fake_verdict(tmp_path, content)
    short = section(write_mismatch_page(folder).read_text(encoding="utf-8"), "short")
    assert ("would change the pressing force with depth" in short) == (state == "unexplained")


@pytest.mark.parametrize("time_s", [np.nan, 0.0])
def test_a_recording_of_one_axis_and_two_sites_is_drawn(tmp_path, time_s):
    """As the paper's readings: 16 of Fz, at the centre and a corner."""
    fake_verdict.write_fake_verdict(tmp_path)
    table = fake_verdict.fake_readings()
    table["time_s"] = time_s  # nobody wrote them down
    few = table[(table["axis"] == "z") & (table["phase"] == "load") & table["site"].isin([12, 24])]
    fake_verdict.write_readings(tmp_path, few)
    html = write_mismatch_page(tmp_path).read_text(encoding="utf-8")
    assert len(parsed(html).pictures) == 7
    assert "these readings have no times" in section(html, "time")
    assert MismatchResults(tmp_path).axes == ["z"]


@pytest.mark.usefixtures("undrawn")
def test_readings_of_no_sensor_have_no_maps(tmp_path):
    content = fake_verdict.fake_content() | {"sensor": None}
    folder = fake_verdict.write_fake_verdict(tmp_path, content)
    html = write_mismatch_page(folder).read_text(encoding="utf-8")
    assert "No maps" in section(html, "where")
    assert len(parsed(html).pictures) == 7


@pytest.mark.usefixtures("undrawn")
def test_measured_readings_are_not_called_synthetic(tmp_path):
    content = fake_verdict.fake_content() | {"synthetic": False, "title": "presses on a sensor"}
    folder = fake_verdict.write_fake_verdict(tmp_path, content)
    assert "SYNTHETIC" not in write_mismatch_page(folder).read_text(encoding="utf-8")


@pytest.mark.thorough
def test_same_folder_gives_the_same_bytes(folder):
    when = datetime(2026, 1, 1, tzinfo=UTC)
    pages = [write_mismatch_page(folder, when).read_bytes() for _ in range(2)]
    assert pages[0] == pages[1]


def test_a_folder_without_a_verdict_is_refused(tmp_path):
    with pytest.raises(VerdictError, match=r"verdict.json.*gelforge mismatch"):
        write_mismatch_page(tmp_path)


@pytest.mark.usefixtures("undrawn")
def test_the_studys_report_ends_with_the_verdict_and_the_way_to_its_page(whole):
    chapter = mismatch(StudyResults(*whole))
    kinds = [block.kind for block in chapter.blocks]
    assert kinds == ["note", "picture", "link"]
    assert "The readings are SYNTHETIC." in chapter.blocks[0].words
    assert chapter.blocks[2].target == "mismatch/report.html"


@pytest.mark.usefixtures("undrawn")
def test_the_chapter_names_what_is_not_there(tmp_path):
    study = fake_results.fake_study(tmp_path)
    chapter = mismatch(StudyResults(study, tmp_path / "results", tmp_path))
    assert chapter.blocks[0].missing and "verdict.json is not there" in chapter.blocks[0].words
    labels = mismatch(StudyResults(fake_results.fake_study(tmp_path, sessions=False), tmp_path, tmp_path))
    assert labels.blocks[0].missing and "without recording sessions" in labels.blocks[0].words


@pytest.mark.parametrize(
    ("chance", "text"), [(0.0, "< 1 %"), (0.006, "1 %"), (0.62, "62 %"), (0.994, "99 %"), (1.0, "> 99 %")]
)
def test_a_chance_is_never_a_bare_zero_or_one(chance, text):
    assert mismatch_maps.chance_text(chance) == text


def test_words_for_amounts_and_p():
    verdict = Verdict.model_validate(fake_verdict.fake_content())
    assert amounts_text(verdict.effects[1]) == "z -0.09 (-0.1 to -0.077)"
    assert p_text(3e-9) == "p < 0.0001" and p_text(0.0411) == "p = 0.041"


def test_amounts_stand_on_lines_of_their_own_and_break_before_a_bracket_only():
    assert unbroken("x +0.1 mm (-1 to 2); y 2") == "x\u00a0+0.1\u00a0mm (-1\u00a0to\u00a02)\ny\u00a02"


def test_the_verdict_over_noise_keeps_its_words():
    case = {
        "scale": 1.0,
        "sigma_z_N": 0.02,
        "state": "identified",
        "answer": [["small_strain", "tilt"], ["void"]],
    }
    named = NoiseCase.model_validate(case)
    assert mismatch_curves.answer_text(named) == "identified: small strain or tilt and void"
    figure = mismatch_curves.noise_figure([named, NoiseCase(scale=2.0, sigma_z_N=0.04, state="consistent")])
    rows = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert rows == ["identified: small strain or tilt and void", "consistent"]
    assert "as stated" in [t.get_text() for t in figure.axes[0].texts]


def test_shapes_are_told_with_their_units_behind():
    assert shape_text({"x_mm": 9.0662, "y_mm": 13.0, "radius_mm": 1.8}) == "x 9.07 mm, y 13 mm; radius 1.8 mm"
    assert shape_text({"part": "gel", "time_s": 69.0}) == "part gel, time 69 s"
    assert shape_text({}) == ""
