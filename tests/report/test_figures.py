"""Figures: scales, units and what they show."""

from __future__ import annotations

from dataclasses import replace

import fake_results
import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text

from gelforge.config import Camera, Indenter, load_session, load_study
from gelforge.indentation.planning.plan import plan_cells
from gelforge.report.figures.learning.training_figure import loss_figure
from gelforge.report.figures.measurements.flow_figure import region_flow
from gelforge.report.figures.simulation.force_depth import ForceDepth, deviation_table, force_depth_figure
from gelforge.report.figures.simulation.force_maps import prediction_figure, total_force_figure
from gelforge.report.figures.simulation.residuals import residual_depth_figure
from gelforge.report.figures.simulation.section import boundary_edges, contact_pressure_kPa, section_figure
from gelforge.report.figures.simulation.sensor_figure import camera_footprint, sensor_figure
from gelforge.report.figures.simulation.silhouette import touched_radius_mm
from gelforge.report.figures.style import region_colours, svg
from gelforge.report.figures.timing import stage_times


def texts(figure) -> str:
    """Return all words of a figure."""
    return "\n".join(artist.get_text() for artist in figure.findobj(Text))


@pytest.fixture(scope="module")
def cell(whole):
    return fake_results.fake_cell(plan_cells(whole[0])["x4_y2"])


@pytest.fixture(scope="module")
def maps(cell):
    true = cell.arrays["bin_force_N"][-1]
    return 1.3 * true + 0.001, true


def test_maps_share_colour_limits_put_bins_at_their_place_and_repeat(maps):
    # Maps share colour limits and put bins at their place
    figure = prediction_figure(*maps, 20, 20, (32.0, 32.0), (27.0, 16.0), 4.0)
    panels = [ax for ax in figure.axes if ax.collections and ax.get_title()]
    assert len(panels) == 9
    for row in range(3):
        limits = {ax.collections[0].get_clim() for ax in panels[3 * row : 3 * row + 3]}
        assert len(limits) == 1
        low, high = limits.pop()
        assert low == -high
        largest = max(1e3 * np.abs(m[:, row]).max() for m in maps)
        assert high >= largest  # nothing is clipped
    assert texts(figure).count("[mN per bin]") == 3

    # Map puts bin k at its place
    force = np.zeros((12, 3))
    force[7, 2] = -1.0  # bin k = nx iy + ix: nx = 4, so ix = 3, iy = 1
    figure = prediction_figure(force, force, 4, 3, (8.0, 6.0), (7.0, 3.0), 1.0)
    mesh = figure.axes[6].collections[0]  # row z, predicted
    values = np.asarray(mesh.get_array()).reshape(3, 4)
    assert values[1, 3] == -1000.0
    corner = mesh.get_coordinates()[1, 3]
    np.testing.assert_allclose(corner, [6.0, 2.0])

    # Figures repeat to the byte
    figures = [prediction_figure(*maps, 20, 20, (32.0, 32.0), (27.0, 16.0), 4.0) for _ in range(2)]
    assert svg(figures[0]) == svg(figures[1])


def test_errors_and_losses_are_drawn_with_their_numbers():
    true = np.zeros((4, 3))
    true[:, 2] = [-1, -2, -3, -4]
    predicted = true + [0.0, 0.0, 0.1]
    assert "rms error 0.100 N" in texts(total_force_figure(predicted, true))

    # Loss figure shows both losses over steps
    loss = pd.DataFrame({"step": [8, 16, 20], "training": [1.0, 0.5, 0.2], "validation": [1.0, 0.6, 0.7]})
    figure = loss_figure(loss)
    for line, name in zip(figure.axes[0].lines, ("training", "validation")):
        np.testing.assert_array_equal(line.get_xydata(), loss[["step", name]])
    assert "optimiser step" in texts(figure)


def test_radius_pressure_and_boundary_edges_are_those_of_the_ball_and_mesh():
    # Contact radius and pressure are those of the ball
    assert touched_radius_mm(Indenter(), 2.0) == pytest.approx(4.0)  # 3-4-5 triangle
    assert touched_radius_mm(Indenter(), 0.0) == 0.0

    # Contact pressure is in kPa
    force = np.array([[0.0, 0.0, -0.5], [0.3, 0.0, -0.4], [0.0, 0.0, 0.0]])
    pressure = contact_pressure_kPa(force, np.array([1.0, 2.0, 0.0]))
    np.testing.assert_allclose(pressure, [500.0, 250.0, 0.0])  # 1 N/mm2 = 1000 kPa

    # Boundary edges are outline and interface
    quads = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])  # two squares side by side
    xz = np.array([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]], float)
    outline = {(0, 1), (1, 2), (2, 5), (4, 5), (3, 4), (0, 3)}
    same = {tuple(edge) for edge in boundary_edges(xz, quads, np.array([0, 0]))}
    other = {tuple(edge) for edge in boundary_edges(xz, quads, np.array([0, 1]))}
    assert same == outline
    assert other == outline | {(1, 4)}

    # A square of side 2 next to two of side 1: node 4 hangs on its edge (1, 2).
    xz = np.array([[0, 0], [2, 0], [2, 2], [0, 2], [2, 1], [3, 0], [3, 1], [3, 2]], float)
    quads = np.array([[0, 1, 2, 3], [1, 5, 6, 4], [4, 6, 7, 2]])
    outline = {(0, 1), (2, 3), (0, 3), (1, 5), (5, 6), (6, 7), (2, 7)}
    same = {tuple(edge) for edge in boundary_edges(xz, quads, np.array([0, 0, 0]))}
    other = {tuple(edge) for edge in boundary_edges(xz, quads, np.array([0, 1, 1]))}
    assert same == outline
    assert other == outline | {(1, 2), (1, 4), (2, 4)}


def test_section_draws_ball_at_its_depth_and_regions_keep_their_colours(cell):
    # Section draws ball at its depth
    figure = section_figure(cell.arrays, -1, fake_results.REGION_NAMES, (27.0, 16.0), Indenter())
    side, top = figure.axes[:2]
    (ball,) = side.patches
    low, high = ball.get_xy().min(axis=0), ball.get_xy().max(axis=0)
    np.testing.assert_allclose((low + high) / 2, [27.0, 3.0], atol=0.01)  # lowest point 2 mm below z = 0
    np.testing.assert_allclose(high - low, 10.0, atol=0.02)  # of a polygon's corners on the circle
    assert side.get_aspect() == 1
    assert "contact pressure [kPa]" in texts(figure)
    colours = top.collections[0]
    assert colours.get_clim()[0] == 0
    words = texts(figure)
    assert all(name in words for name in (*fake_results.REGION_NAMES, "before the indentation"))
    figure.draw_without_rendering()
    titles = [axes.title.get_window_extent() for axes in (side, top)]
    assert max(title.y1 for title in titles) <= figure.bbox.y1  # no title is cut

    # Regions keep their colours
    assert region_colours(["gel", "skin", "wall"])[2] == region_colours(["wall", "gel"])[0]
    assert len(set(region_colours(["gel", "skin", "wall", "flange"]))) == 4


def test_force_depth_figure_has_all_curves_and_deviations_are_relative_to_the_published(whole):
    # Force depth figure has all curves and units
    published = pd.read_csv(whole[2] / "force_depth.csv")
    depth = np.array([0.5, 1.0])
    curve = ForceDepth(
        "centre", depth, np.array([-0.1, -0.3]), depth, np.array([-0.11, -0.31]), published.iloc[:8]
    )
    words = texts(force_depth_figure([curve, curve]))
    for label in (
        "paper: FEM",
        "paper: linear FEM",
        "paper: F/T",
        "this study: FEM",
        "this study: F/T",
        "[N]",
        "[mm]",
    ):
        assert label in words
    varied = replace(curve, variants={"flange": (depth, np.array([-0.2, -0.4]))})
    figure = force_depth_figure([varied])
    assert "variant: flange" in texts(figure)
    line = next(line for line in figure.axes[0].lines if line.get_label() == "variant: flange")
    assert list(line.get_ydata()) == [0.2, 0.4]
    bare = ForceDepth("centre", depth, np.array([-0.1, -0.3]), np.array([]), np.array([]), None)
    assert "paper" not in texts(force_depth_figure([bare]))

    # Deviation is relative to the published force
    published = pd.DataFrame(
        {"depth_mm": [0.25, 0.5], "fem_N": [-0.1, -0.2], "fem_linear_N": 0.0, "ft_sensor_N": 0.0}
    )
    curve = ForceDepth(
        "", np.array([0.5, 1.0]), np.array([-0.19, -0.5]), np.array([]), np.array([]), published
    )
    table = deviation_table(curve)
    assert len(table) == 1
    assert table["deviation [%]"][0] == pytest.approx(-5.0)
    varied = replace(curve, variants={"flange": (np.array([0.25, 0.5]), np.array([-0.11, -0.21]))})
    assert list(deviation_table(varied)["variant flange Fz [N]"]) == [-0.21]
    stopped = replace(curve, variants={"flange": (np.array([0.25]), np.array([-0.11]))})
    assert np.isnan(deviation_table(stopped)["variant flange Fz [N]"][0])


def test_residual_over_depth_shows_sign_and_band(whole):
    agreement = pd.read_csv(whole[1] / "agreement.csv")
    figure = residual_depth_figure(agreement, [0.03, 0.03, 0.06])
    ax = figure.axes[2]
    mean = next(line for line in ax.lines if line.get_label() == "mean")
    assert (np.diff(mean.get_ydata()) < 0).all()  # readings 12 % stronger, negative Fz: F/T - FEM falls
    band = ax.patches[0].get_extents().transformed(ax.transData.inverted())
    assert band.height == pytest.approx(0.12)  # twice 0.06 N
    assert "F/T − FEM [N]" in texts(figure)


def test_region_flow_and_camera_footprint_lie_as_the_image_does():
    feature = np.zeros(8)  # 2 x 2 regions
    feature[1], feature[5] = 2.0, np.pi / 2  # region of row 0, column 1: 2 px downwards
    u, v, du, dv = region_flow(feature, (100, 200))
    assert (u[1], v[1]) == (149.5, 24.5)  # centre of the right upper quarter of 200 x 100 px
    np.testing.assert_allclose([du[1], dv[1]], [0.0, 2.0], atol=1e-12)  # cos(pi/2) in rounding

    # Camera footprint
    corners = camera_footprint(fake_results.CAMERA)
    np.testing.assert_allclose(corners.mean(axis=0), [16.0, 16.0])
    np.testing.assert_allclose(np.ptp(corners, axis=0), 420 * 32 / 400)  # width_px z / f
    assert (corners[0] == corners.min(axis=0)).tolist() == [
        True,
        False,
    ]  # mirrored: top left is small x, large y
    seen = Camera(**(fake_results.CAMERA.model_dump() | {"mirrored": False}))
    assert camera_footprint(seen)[0, 0] == corners[:, 0].max()
    cropped = camera_footprint(fake_results.CAMERA, [0, 0, 210, 420])
    np.testing.assert_allclose(np.ptp(cropped, axis=0), [210 * 32 / 400, 420 * 32 / 400])


def test_sensor_figure_shows_plan_bins_camera_and_dome(whole):
    study = whole[0]
    session = load_session(study.session_folder("day1") / "session.yaml")
    words = texts(sensor_figure(study, plan_cells(study), session))
    expected = (
        "25 positions",
        "20 x 20 bins of 1.6 x 1.6 mm",
        "camera at z = -32 mm",
        "gel: 4.5 mm",
        "ball of radius 5 mm",
    )
    for part in expected:
        assert part in words
    assert "camera" not in texts(sensor_figure(study, plan_cells(study)))

    # Sensor figure of a dome shows the dome
    sensor = load_study("config/smoke/dome.yaml").sensor
    study = whole[0].model_copy(update={"sensor": sensor})
    figure = sensor_figure(study, plan_cells(whole[0]))
    words = texts(figure)
    assert "outer surface, a dome" in words
    assert "wall" not in words
    above, side = figure.axes
    reach = np.concatenate([path.vertices for path in above.collections[0].get_paths()]) - 12.0
    assert np.linalg.norm(reach, axis=1).max() == pytest.approx(12.0)  # a disc, no square
    low, high = (np.array(side.dataLim.get_points())[k, 0] for k in (0, 1))
    assert low < 1.0
    assert high > 23.0


def test_stage_times_group_cells(tmp_path):
    for name, seconds in (("cells/a", 2.0), ("cells/b", 3.0), ("train", 9.0)):
        path = tmp_path / f"benchmarks/{name}.tsv"
        path.parent.mkdir(parents=True, exist_ok=True)
        memory = 12.5 if name == "cells/a" else 250.0
        path.write_text(f"s\th:m:s\tmax_rss\n{seconds}\t0:00:02\t{memory}\n")
    timings = tmp_path / "cells/a.timings.json"
    timings.parent.mkdir()
    timings.write_text('{"peak_memory_MB": 300.0}')
    stages = stage_times(tmp_path, {"a", "b"}).set_index("stage")
    assert stages["memory_MB"].to_dict() == {"train": 250.0, "cells": 300.0}  # of a fork, its own word
    assert stages.loc["cells", ["jobs", "total_s", "longest_s"]].tolist() == [2, 5.0, 3.0]
    (tmp_path / "benchmarks/train.tsv").write_text("s\th:m:s\tmax_rss\n9.0\t0:00:09\t13.9\n")
    assert np.isnan(stage_times(tmp_path, {"a", "b"}).set_index("stage").memory_MB["train"])  # it waited
    assert list(stages.index) == ["train", "cells"]  # longest first
