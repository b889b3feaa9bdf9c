"""False flow of untouched images next to that of indentations, and what the flow lost."""

import fake_results
import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.report.chapters.chapter import Chapter
from gelforge.report.chapters.flow_floor import false_flow_px, flow_table, tell_flow_floor
from gelforge.report.chapters.results_reader import StudyResults


def columns(**changed):
    return {
        "press": np.array(["a", "a", "b", "b", "c", "c"], object),
        "phase": np.array(["zero", "dwell"] * 3, object),
        "depth_mm": np.array([0, 1, 0, 1, 0, 2.0]),
        "flow_px": np.float32([0.02, 1.0, 0.04, 1.2, 0.03, 9.0]),
        "flow_lost": np.float32([0, 0, 0, 0.01, 0, 0.1]),
    } | changed


def test_false_flow_is_that_of_untouched_images_but_the_reference_itself():
    assert_allclose(false_flow_px(flow_table(columns())), (0.03, 1.4826 * 0.01), rtol=1e-5)
    itself = columns(flow_px=np.float32([0.0, 1.0, 0.04, 1.2, 0.04, 9.0]))
    assert_allclose(false_flow_px(flow_table(itself))[0], 0.04, rtol=1e-5)


@pytest.mark.parametrize("touched_only", [False, True])
def test_a_report_says_false_flow_and_what_was_lost(touched_only, tmp_path):
    study = fake_results.fake_study(tmp_path)
    folder = tmp_path / "results"
    fake_results.write_features(study, folder)
    results = StudyResults(study, folder, tmp_path / "paper")
    if touched_only:
        held = results.features["day1"]["phase"] != "zero"
        results.__dict__["features"] = {"day1": {k: v[held] for k, v in results.features["day1"].items()}}
    chapter = Chapter("images", "Images")
    tell_flow_floor(chapter, results)
    said = " ".join(
        block if isinstance(block, str) else getattr(block, "words", "") for block in chapter.blocks
    )
    assert ("no image before contact" in said) == touched_only
    assert ("before contact move by 0.02 px" in said) != touched_only
    assert "In 25 of 125 indentations the flow does not fit" in said or touched_only
