"""Sites of one depth each: their neighbours are pooled in curves and maps, and depths that few rows share are classed."""

import fake_results
import fake_verdict
import numpy as np
import pandas as pd
import pytest

from gelforge.report.chapters.results_reader import StudyResults
from gelforge.report.figures.neighbours import (
    CURVE_SITES,
    depth_classes,
    nearest,
    one_depth_each,
    pooled_means,
)
from gelforge.report.page import write_report
from gelforge.report.verdict.mismatch_curves import depth_figure
from gelforge.report.verdict.mismatch_reader import MismatchResults


@pytest.fixture(scope="module")
def scattered(tmp_path_factory):
    """Return study and results of 36 sites at recorded positions, none at the centre, each pressed to a depth of its own."""
    root = tmp_path_factory.mktemp("scattered")
    rng = np.random.default_rng(1)
    at = np.stack(np.meshgrid(np.linspace(6, 26, 6), np.linspace(6, 26, 6)), -1).reshape(-1, 2)
    plan = pd.DataFrame(at + rng.uniform(-0.3, 0.3, at.shape), columns=["x_mm", "y_mm"]).round(3)
    plan["depth_mm"] = np.round(rng.uniform(0.4, 2.0, len(plan)), 3)
    plan.insert(0, "cell", [f"p{k:02d}" for k in range(len(plan))])
    plan.to_csv(root / "plan.csv", index=False)
    study = fake_results.fake_study(root)
    plan_of = study.plan.model_copy(update={"file": root / "plan.csv", "grid": None, "depths_mm": None})
    study = study.model_copy(update={"plan": plan_of})
    folder = root / "results"
    fake_results.write_cells(study, folder)
    fake_results.write_session(study)
    fake_results.write_features(study, folder)
    fake_results.write_agreement(study, folder)
    return study, folder


def test_curves_at_a_place_are_of_the_nearest_sites_or_the_one_of_several_depths(scattered, whole):
    results = StudyResults(*scattered, None)
    sites, where = results.sites_at("centre")
    far = [np.hypot(c.x_mm - 16, c.y_mm - 16) for c in results.converged()]
    assert len(sites) == CURVE_SITES
    assert f"up to {sorted(far)[CURVE_SITES - 1]:.2g} mm from (16, 16) mm" in where

    # Sites of several depths stand alone
    results = StudyResults(*whole)
    (site,), where = results.sites_at("centre")
    assert (site.x_mm, site.y_mm, where) == (16.0, 16.0, "(16, 16) mm")


def test_a_report_of_such_a_study_has_curves_and_short_tables(scattered, tmp_path, undrawn):
    study, folder = scattered
    missing = write_report(study, folder, tmp_path / "page.html")
    assert not any("No curve" in words for words in missing)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert f"{CURVE_SITES} sites up to" in page


def test_neighbours_are_pooled_in_means_classes_and_verdicts_over_depth(tmp_path):
    # Neighbours means and classes of depth
    at = np.array([[0.0, 0], [1, 0], [2, 0], [3, 0], [4, 0], [10, 0]])
    chosen, distance = nearest(at, np.array([10.0, 0.0]), 2)
    assert (list(chosen), distance) == ([5, 4], 6.0)
    assert pooled_means(at, np.arange(6.0))[0] == 2.0  # of the five on the left

    # One depth each is of most sites
    depth = pd.Series([0.5, 1.0, 0.7, 0.9])
    assert one_depth_each(pd.Series(["a", "b", "c", "d"]), depth)
    assert not one_depth_each(pd.Series(["a", "a", "b", "b"]), depth)
    assert not one_depth_each(
        pd.Series(["a", "a", "a", "a"]), pd.Series([1.0] * 4)
    )  # a single site is its own

    # Depths are classed where few rows share one
    grid = pd.Series(np.tile(np.arange(1, 13) / 10, 20))
    mean, names = depth_classes(grid)
    assert list(mean) == list(grid) and names[0.5] == "0.5"
    mean, names = depth_classes(pd.Series(np.arange(1, 17) / 10))
    assert next(iter(names.values())) == "0.1 to 0.2" and len(names) == 8
    assert mean[0] == mean[1] == pytest.approx(0.15)

    # A verdict over depth is of the sites about the shown one
    fake_verdict.write_fake_verdict(tmp_path)
    whole = MismatchResults(tmp_path)
    site = whole.shown_sites()[0][0]
    assert whole.sites_about(site) == ([site], 0.0)
    table = fake_verdict.fake_readings()
    depths = np.sort(table["depth_mm"].unique())
    own = dict(zip(table["site"].unique(), np.resize(depths, table["site"].nunique())))
    fake_verdict.write_fake_verdict(tmp_path, table=table[table["depth_mm"] == table["site"].map(own)])
    single = MismatchResults(tmp_path)
    assert len(single.sites_about(site)[0]) == CURVE_SITES
    figure = depth_figure(single)
    assert f"and {CURVE_SITES - 1} sites up to" in figure.axes[0].get_title()
