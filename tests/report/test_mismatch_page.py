"""The verdict's page: one sentence first, one colour scale, and nothing said that its folder does not hold."""

from __future__ import annotations

import base64
import re
from datetime import UTC, datetime
from pathlib import Path

import fake_results
import fake_verdict
import numpy as np
import pandas as pd
import pytest
from matplotlib.collections import PatchCollection
from numpy.testing import assert_allclose
from test_page import parsed

from gelforge.mismatch.result.verdict import Verdict, VerdictError
from gelforge.report.chapters.results_reader import StudyResults
from gelforge.report.mismatch_page import write_mismatch_page
from gelforge.report.verdict import mismatch_curves, mismatch_maps
from gelforge.report.verdict.mismatch_chapters import CHAPTERS, answer, limits, mismatch
from gelforge.report.verdict.mismatch_reader import MismatchResults
from gelforge.report.verdict.mismatch_words import (
    chance_text,
    hyperparameters_text,
    in_unit,
    p_text,
    unbroken,
    values_text,
)


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


def test_the_sentence_stands_first_and_the_page_fetches_nothing(html):
    # The sentence stands first under the synthetic banner
    text = [words.strip() for words in parsed(html.split("<body>")[1]).text if words.strip()]
    sentence = text.index(fake_verdict.fake_content()["sentence"])
    assert sentence <= 6  # after the line of the title, the banner and the state
    assert text.index("SYNTHETIC DATA.") < sentence
    assert "identified: a known cause explains the difference" in text[sentence - 1]
    following = Verdict.model_validate(fake_verdict.fake_content()).next_step
    assert text[sentence + 1 : sentence + 3] == ["Next:", following]

    # Articles fit the words that are put in after them
    text = " ".join(parsed(html.split("<body>")[1]).text)
    assert re.findall(r"\b(?:[Aa]n [b-df-hj-np-tv-z]\w+|[Aa] [aeio]\w+)", text) == []

    # Page fetches nothing and every figure is a picture under a sentence
    links = parsed(html)
    assert all(target.startswith(("#", "data:")) for target in links.targets)
    assert not re.search(r"@import|url\(|<script", html)
    assert len(links.ids) == len(CHAPTERS)
    assert {f"#{key}" for key in links.ids} <= set(links.targets)

    # Every figure is a picture under a sentence
    pictures = parsed(html).pictures
    assert len(pictures) == 4  # maps, depth; in folds time and body
    for picture in pictures:
        assert b"<svg" in base64.b64decode(picture["src"].partition("base64,")[2])
        assert len(picture["alt"].split()) >= 8


def test_what_people_want_to_read_is_there_with_shares(html):
    assert "held out" in section(html, "answer") and "grows with depth" in section(html, "where")
    answer = section(html, "answer").replace("\u00a0", " ")
    assert answer.index("gel stiffness") < answer.index("force gain") < answer.index("layer thickness")
    assert "scale -9 % (-10 to -7.8)" in answer
    names = [effect["name"].replace("_", " ") for effect in fake_verdict.fake_content()["effects"]]
    assert not [name for name in names if name not in answer]
    assert "gel stiffness, force gain, particle settling: Put dead weights" in answer
    assert "dead weights" in answer and "10 min" in answer
    unknown = section(html, "cannot-know")
    assert "No site was pressed twice" in unknown and "Of 4 plausible values 2 would stay hidden" in unknown
    assert "far from its neighbours over depth" in unknown
    assert "SYNTHETIC: made by" in section(html, "origin")

    # Members have their share and no probability of their own
    assert "62 %" not in answer  # of gel stiffness over all sets of effects
    assert "60 % of 97 %" in answer and "30 % of 97 %" in answer


def test_residuals_are_measured_minus_simulated_and_maps_have_their_own_scales(results):
    # Residuals are measured minus simulated
    z = results.readings[results.readings["axis"] == "z"]
    # pressing gives negative Fz and the made-up sensor is softer: it reads less negative than simulated
    assert z["before"].mean() > 0.03
    assert abs(z["after"].mean()) < 3 * z["sigma_N"].mean() / np.sqrt(len(z))
    assert results.strongest_axis == "z"

    # Maps have scales and frames of their own
    found = maps(mismatch_maps.before_after_figure(results))
    assert len(found) == 12
    means, noise = results.site_means, results.readings.groupby("axis")["sigma_N"].median()
    for unit, axes, ending in (("N", "z", ""), ("N", "xy", ""), ("σ", "xyz", "_sigma")):
        ((low, high),) = {
            found[f"F{axis} {state} {unit}"].get_clim() for axis in axes for state in ("before", "after")
        }
        left = (
            means.loc[means["axis"].isin([*axes]), [f"before{ending}", f"after{ending}"]].abs().max(axis=None)
        )
        errors = 2 if ending else 2 * noise[[*axes]].max()  # of one reading, two sigma
        assert low == -high and high == pytest.approx(max(left, errors))
    assert found["Fx before N"].get_clim() != found["Fz before N"].get_clim()

    # A map in sigma is of the residual over its error
    table = results.readings[(results.readings["axis"] == "z") & (results.readings["phase"] == "load")]
    over = ((table["measured_N"] - table["base_N"]) / table["sigma_N"]).groupby(table["site"]).mean()
    assert_allclose(np.sort(found["Fz before σ"].get_array()), np.sort(over), rtol=1e-12)
    title = mismatch_maps.before_after_figure(results).axes[0].get_title()
    rms = np.sqrt(np.mean(results.readings.query("axis == 'z'")["before"] ** 2))
    assert f"{rms:.2g} N" in title

    # Held out sites have a dark frame
    for shown in maps(mismatch_maps.before_after_figure(results)).values():
        assert (np.asarray(shown.get_linewidths()) > 1).sum() == len(fake_verdict.ASIDE)


def maps(figure):
    """Return the maps of a figure by their titles without the size: "Fz before N"."""
    drawn = [ax for ax in figure.axes if any(isinstance(shown, PatchCollection) for shown in ax.collections)]
    found = {}
    for ax in drawn:
        before, _, unit = ax.get_title().replace("$", "").replace("_", "").rpartition(" ")
        found[f"{before.partition(':')[0]} {unit}"] = ax.collections[0]
    return found


def test_defects_and_patches_are_drawn_and_detection_limits_are_ten_at_most(tmp_path):
    # Defects and patches are drawn where they are
    content = fake_verdict.fake_content()
    defect = {"words": "void", "x_mm": 12.0, "y_mm": 20.0, "radius_mm": 2.0, "layer": "gel"}
    content["where"].append(defect)
    found = MismatchResults(fake_verdict.write_fake_verdict(tmp_path, content))
    (circle,) = mismatch_maps.before_after_figure(found).axes[3].patches
    assert (circle.center, circle.radius) == ((12.0, 20.0), 2.0)

    # Body map puts each patch where it is
    patches = fake_verdict.fake_body_map()
    spot = (patches["x_mm"] == patches["x_mm"].max()) & (patches["y_mm"] == patches["y_mm"].min())
    patches["change"] = np.where(spot & (patches["z_mm"] == -3.0), 0.5, 0.0)
    folder = fake_verdict.write_fake_verdict(tmp_path, patches=patches)
    drawn = mismatch_maps.body_map_figure(MismatchResults(folder)).axes[:3]
    assert [ax.get_title().split(",")[0] for ax in drawn] == ["skin", "gel", "gel"]
    values, framed = (
        np.array([read(ax.collections[0]) for ax in drawn])
        for read in (
            lambda shown: shown.get_array(),
            lambda shown: np.asarray(shown.get_linewidths()) > 1,
        )
    )
    assert_allclose(values[values != 0], [50.0])  # in percent
    assert np.array_equal(framed, values != 0)  # beyond two sigma
    corners = drawn[1].collections[0].get_paths()[int(np.argmax(values[1]))].get_extents()
    assert_allclose(
        [corners.x0, corners.x1, corners.y0, corners.y1], [32 * 5 / 6, 32, 0, 32 / 6], atol=1e-6
    )  # digits of the CSV
    assert mismatch_maps.is_known(patches).sum() == 1

    # Detection limits have an effect a row and ten at most
    limited = tmp_path / "limited"
    limited.mkdir()
    limit = content["detection_limits"][0]
    more = [limit | {"effect": f"effect_{k}"} for k in range(12)]
    axes = [limit | {"effect": "force_gain", "parameter": axis, "value": 1.234} for axis in "xyz"]
    content["detection_limits"] = [*more, *axes, limit]
    folder = fake_verdict.write_fake_verdict(limited, content)
    table = next(b for b in limits(MismatchResults(folder)).blocks if b.kind == "table")
    assert [row[0] for row in table.rows[:2]] == ["gel stiffness", "force gain"] and len(table.rows) == 10
    assert table.rows[1][1:4] == ["x\ny\nz", "\n".join(3 * ["120 %"]), "\n".join(3 * ["10 %"])]


def test_curves_over_depth_and_time(results):
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

    # Time figure lays sessions end to end
    table, ends = mismatch_curves._session_time(results.readings)
    assert [name for name, *_ in ends] == ["day1", "day2"]
    assert ends[1][1] > ends[0][2] > ends[0][1] == 0
    day1 = table[table["session"] == "day1"]
    assert day1["minute"].max() == pytest.approx((day1["time_s"].max() - day1["time_s"].min()) / 60)


@pytest.mark.usefixtures("undrawn")
def test_a_null_readings_without_sensor_and_measured_ones_are_said(tmp_path):
    # A null has no after and says so
    folder = fake_verdict.write_fake_verdict(
        tmp_path, fake_verdict.nothing_missing(), patches=pd.DataFrame(), change=0.0, after=False
    )
    html = write_mismatch_page(folder).read_text(encoding="utf-8")
    assert "nothing is missing that they could show" in html.split("<main>")[0]
    assert "Nothing was put into the simulation" in section(html, "answer")
    assert "No pattern stands out" in section(html, "where")
    assert "No body map" in section(html, "where")
    assert "Nothing was put into the simulation" in section(html, "held-out")
    assert "outlier" not in section(html, "cannot-know")
    assert len(maps(mismatch_maps.before_after_figure(MismatchResults(folder)))) == 6  # none after

    # Readings without sensor or measured are said
    bare = tmp_path / "bare"
    bare.mkdir()
    content = fake_verdict.fake_content() | {"sensor": None}
    folder = fake_verdict.write_fake_verdict(bare, content)
    html = write_mismatch_page(folder).read_text(encoding="utf-8")
    assert "No maps" in section(html, "answer")
    assert len(parsed(html).pictures) == 3

    # Measured readings are not called synthetic
    content = fake_verdict.fake_content() | {"synthetic": False, "title": "presses on a sensor"}
    folder = fake_verdict.write_fake_verdict(bare, content)
    assert "SYNTHETIC" not in write_mismatch_page(folder).read_text(encoding="utf-8")


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
    blocks = answer(MismatchResults(folder)).blocks
    one, other = (block for block in blocks if block.kind == "table")
    rows = [[cell.replace("\u00a0", " ") for cell in row] for row in one.rows]
    assert [row[1] for row in rows] == ["70 %", "20 %", "10 %"] and one.minor == [False, True, True]
    assert [row[-1] for row in rows] == ["", "yes", "no"] and "scale -9 %" in rows[0][2]
    assert (
        "99 %" in one.words
        and "60 %" in other.words
        and other.header == ["effect", "value (90 % interval), place"]
    )
    assert any("one patch serves" in block.words for block in blocks if block.kind == "note")
    first["differs_snr"] = 5.0
    folder = fake_verdict.write_fake_verdict(tmp_path / "unlike", content)
    said = [block.words for block in answer(MismatchResults(folder)).blocks if block.kind == "note"]
    assert any("0.0004 N rms at most" in words for words in said)
    assert not any("one patch serves" in words for words in said)


@pytest.mark.usefixtures("undrawn")
def test_what_is_modelled_without_a_cause_is_said_with_its_range(tmp_path):
    content = fake_verdict.fake_content()
    held = content["fit"]["held_out"] | {"gain": 12.0, "standard_error": 3.0}
    content["model"] = {
        "words": "a change of the pressing force with depth",
        "with_effects": ["gel_stiffness"],
        "largest_N": [None, 0.001, 0.05],
        "depth_mm": [0.25, 2.0],
        "sites": 25,
        "corrects_labels": True,
        "held_out": held,
    }
    folder = fake_verdict.write_fake_verdict(tmp_path, content)
    html = write_mismatch_page(folder).read_text(encoding="utf-8")
    assert "identified: a known cause explains the difference" in html
    said = section(html, "answer").replace("\u00a0", " ")
    assert "Modelled without a known cause" in said and "a change of the pressing force with depth" in said
    assert "0.05 N" in said and "0.25 to 2 mm at 25 positions" in said and "+12 ± 3" in said
    assert "correction.csv" in said
    content["model"] |= {"cause": "modulus_map", "probability": 0.97}
    folder = fake_verdict.write_fake_verdict(tmp_path / "of a cause", content)
    said = section(write_mismatch_page(folder).read_text(encoding="utf-8"), "answer")
    assert "Probability 97 %: a cause with a free form" in said and "module.csv" in said
    assert "Modelled without a known cause" not in said


@pytest.mark.parametrize("state", ["unexplained", "ambiguous"])
@pytest.mark.usefixtures("undrawn")
def test_a_discrepancy_is_described_where_no_cause_explains_the_readings(tmp_path, state):
    content = fake_verdict.fake_content() | {"state": state}
    folder = fake_verdict.write_fake_verdict(tmp_path, content)
    said = [block.words for block in answer(MismatchResults(folder)).blocks if block.kind == "note"]
    assert any("changes the pressing force with depth" in words for words in said) == (state == "unexplained")


@pytest.mark.parametrize("time_s", [np.nan, 0.0])
def test_a_recording_of_one_axis_and_two_sites_is_drawn(tmp_path, time_s):
    """As the paper's readings: 16 of Fz, at the centre and a corner."""
    table = fake_verdict.fake_readings()
    table["time_s"] = time_s  # nobody wrote them down
    few = table[(table["axis"] == "z") & (table["phase"] == "load") & table["site"].isin([12, 24])]
    fake_verdict.write_fake_verdict(tmp_path, table=few)
    html = write_mismatch_page(tmp_path).read_text(encoding="utf-8")
    assert len(parsed(html).pictures) == 3
    assert "these readings have no times" in section(html, "where")
    assert MismatchResults(tmp_path).axes == ["z"]


@pytest.mark.thorough
def test_same_folder_gives_the_same_bytes(folder):
    when = datetime(2026, 1, 1, tzinfo=UTC)
    pages = [write_mismatch_page(folder, when).read_bytes() for _ in range(2)]
    assert pages[0] == pages[1]


def test_a_folder_without_a_verdict_is_refused(tmp_path):
    with pytest.raises(VerdictError, match=r"verdict.json.*gelforge mismatch"):
        write_mismatch_page(tmp_path)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("name", ["readings.csv", "body_map.csv"])
def test_a_table_that_was_edited_is_refused(tmp_path, name):
    folder = fake_verdict.write_fake_verdict(tmp_path)
    (folder / name).write_text((folder / name).read_text().replace("1", "2", 1))
    with pytest.raises(VerdictError, match=rf"{name}: damaged or edited.*gelforge mismatch"):
        write_mismatch_page(folder)


@pytest.mark.usefixtures("undrawn")
def test_the_studys_report_ends_with_the_verdict_or_what_is_missing(whole, tmp_path):
    chapter = mismatch(StudyResults(*whole))
    kinds = [block.kind for block in chapter.blocks]
    assert kinds == ["note", "picture", "link"]
    assert "The readings are SYNTHETIC." in chapter.blocks[0].words
    assert chapter.blocks[2].target == "mismatch/report.html"

    # The chapter names what is not there
    study = fake_results.fake_study(tmp_path)
    chapter = mismatch(StudyResults(study, tmp_path / "results", tmp_path))
    assert chapter.blocks[0].missing and "verdict.json is not there" in chapter.blocks[0].words
    labels = mismatch(StudyResults(fake_results.fake_study(tmp_path, sessions=False), tmp_path, tmp_path))
    assert labels.blocks[0].missing and "without recording sessions" in labels.blocks[0].words


@pytest.mark.parametrize(
    ("chance", "text"), [(0.0, "< 1 %"), (0.006, "1 %"), (0.62, "62 %"), (0.994, "99 %"), (1.0, "> 99 %")]
)
def test_a_chance_is_never_a_bare_zero_or_one(chance, text):
    assert chance_text(chance) == text


def test_words_for_values_p_and_hyperparameters():
    verdict = Verdict.model_validate(fake_verdict.fake_content())
    assert values_text(verdict.effects[1]) == "z -9 % (-10 to -7.7)"
    assert p_text(3e-9) == "p < 0.0001" and p_text(0.0411) == "p = 0.041"

    # Values stand on lines of their own and break before a bracket only
    assert unbroken("x +0.1 mm (-1 to 2); y 2") == "x\u00a0+0.1\u00a0mm (-1\u00a0to\u00a02)\ny\u00a02"

    # Shapes are reported with their units behind
    assert (
        hyperparameters_text({"x_mm": 9.0662, "y_mm": 13.0, "radius_mm": 1.8})
        == "x 9.07 mm, y 13 mm; radius 1.8 mm"
    )
    assert hyperparameters_text({"part": "gel", "time_s": 69.0}) == "part gel, time 69 s"
    assert hyperparameters_text({}) == ""


@pytest.mark.parametrize(
    ("value", "parameter", "unit", "text"),
    [
        (1.234, "x", "1", "120 %"),
        (0.0321, "scale", "-", "3.2 %"),
        (0.333, "exponent", "1", "0.33"),
        (0.3149, "about_x", "deg", "0.31 deg"),
        (None, "x", "N", "none"),
    ],
)
def test_a_value_has_two_digits_and_its_unit(value, parameter, unit, text):
    assert in_unit(value, parameter, unit) == text
