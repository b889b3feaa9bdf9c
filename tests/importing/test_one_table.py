"""One table holds stage and force: presses without waits, in polar positions, logged only while they last."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import yaml

from gelforge.config import ConfigError
from gelforge.config.foreign.importing import load_import
from gelforge.importing.contact import Contact
from gelforge.importing.importer import _depth_zero, import_logs, write_imported
from gelforge.importing.presses import Presses
from gelforge.importing.refusals import ImportingError
from gelforge.recording.readings import read_recording

PLACES = ((2.0, 30.0), (6.0, 200.0), (4.0, 90.0), (5.0, 310.0))  # radius [mm], angle [deg]
SPEED, TOP, RATE = 2.0, 3.0, 25.0  # mm/s, mm, rows per second
CONTACT = 320.0  # mm of the stage, which falls while pressing
DEPTHS = [1.0, 1.5, 2.0]
SESSION = {"force": {"acts_on": "sensor", "tared": False}}


def force(depth, loading):
    """Return the force towards the gel [N]: a loop of a fifth."""
    return 1.5 * np.maximum(depth, 0) ** 1.3 * np.where(loading, 1.0, 0.8)


def write(folder, noise=0.002, scatter=0.0, seed=0, lost=()):
    """Write a table without a header, its rows only from 1 mm above the surface on; two kinds of presses in it."""
    rng = np.random.default_rng(seed)
    rows, clock = [], 1.6e9
    for kind, places in ((1, PLACES), (2, PLACES[:2])):
        for number, (radius, angle) in enumerate(places):
            way = TOP + 1.0
            time = np.arange(0, 2 * way / SPEED, 1 / RATE)
            depth = TOP - np.abs(SPEED * time - way)
            push = force(depth, time < way / SPEED) + rng.normal(0, noise, len(time))
            stage = CONTACT - depth + rng.normal(0, scatter)
            for k, (t, z, f) in enumerate(zip(time, stage, push)):
                if (kind, number, k) not in lost:
                    s, ns = divmod(clock + t, 1.0)
                    rows.append(
                        [kind, int(s), round(ns * 1e9), radius / 1e3, angle, z / 1e3, 0.01, 0.0, 0.4 - f]
                    )
            clock += time[-1] + 7.0
    pd.DataFrame(rows).to_csv(folder / "log.csv", header=False, index=False, float_format="%.9g")


def mapping(folder, **changes):
    table = {
        "file": "log.csv",
        "table": {"header": False, "columns": 9},
        "rows": [{"column": "1", "equals": [1]}],
    }
    table["time"] = {"column": ["2", "3"], "unit": ["s", "ns"]}
    content = {
        "describes": "one table",
        "force": {**table, "columns": ["7", "8", "9"], "unit": "N", "lag_s": 0.0},
        "stage": {**table, "polar": {"radius": "4", "angle": "5"}, "z": "6", "unit": "m", "pressing": "-z"},
        "depth_zero": "session",
        "ramp_depths_mm": DEPTHS,
        "session": SESSION,
        **changes,
    }
    (folder / "log.yaml").write_text(yaml.safe_dump(content))
    return folder / "log.yaml"


def test_ramps_are_read_at_the_depths_of_the_mapping_wherever_the_log_lies(tmp_path):
    # Ramps are read at the depths of the mapping
    write(tmp_path)
    found = import_logs(mapping(tmp_path), "s1")
    (tmp_path / "s1").mkdir()
    write_imported(tmp_path / "s1", found)
    table = read_recording(tmp_path / "s1").readings
    assert table["press"].nunique() == len(PLACES)  # those of the other kind are not read
    contact = float(np.median(found.contacts["contact_mm"]))
    assert contact == pytest.approx(CONTACT, abs=0.03)
    for (radius, angle), (_, own) in zip(PLACES, table.groupby("press", sort=False)):
        at = radius * np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
        np.testing.assert_allclose(own[["x_mm", "y_mm"]].to_numpy(), np.tile(at, (len(own), 1)), atol=2e-3)
        loading, unloading = (own[own["phase"] == phase] for phase in ("load", "unload"))
        np.testing.assert_allclose(loading["depth_mm"][:-1], DEPTHS)
        assert loading["depth_mm"].iloc[-1] == pytest.approx(TOP, abs=0.1)
        np.testing.assert_allclose(unloading["depth_mm"], DEPTHS[::-1])
        for phase, down in ((loading[:-1], True), (unloading, False)):
            true = force(phase["depth_mm"] + CONTACT - contact, down)
            np.testing.assert_allclose(-phase["fz_N"], true, atol=0.02)
            np.testing.assert_allclose(phase["speed_mm_per_s"], SPEED, rtol=0.02)

    # A log elsewhere is named
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "logs").mkdir()
    write(elsewhere / "logs")
    assert len(import_logs(mapping(elsewhere), "s1", elsewhere / "logs").table) == len(import_logs(
        mapping(elsewhere / "logs"), "s1").table)  # fmt: skip


def test_gaps_and_scattered_contact_points_need_a_key(tmp_path):
    # Gaps between presses need a lag and gaps in them are refused
    write(tmp_path)
    whole = yaml.safe_load(mapping(tmp_path).read_text())
    del whole["force"]["lag_s"]
    with pytest.raises(ImportingError, match="no row between .* split the session"):
        import_logs(mapping(tmp_path, force=whole["force"]), "s1")
    write(tmp_path, lost={(1, 2, k) for k in range(45, 65)})
    with pytest.raises(
        ImportingError, match=r"indentation 3 .* no row between .* while it is pressed; .*skip: \[3\]"
    ):
        import_logs(mapping(tmp_path), "s1")
    assert len(import_logs(mapping(tmp_path, skip=[3]), "s1").zero_mm) == 3

    # Contact points of a noisy force are pooled within a stated distance
    scattered = tmp_path / "scattered"
    scattered.mkdir()
    write(scattered, scatter=0.15)
    with pytest.raises(ImportingError, match="contact points lie up to .* the limit is 0.1 mm"):
        import_logs(mapping(scattered), "s1")
    found = import_logs(mapping(scattered, contact_within_mm=0.5), "s1")
    assert found.session.depth_zero.press_scatter_mm == pytest.approx(
        found.contacts["contact_mm"].std(), rel=0.1
    )


@pytest.mark.parametrize("stage_mm", [0.0, 0.2])
def test_the_scatter_of_the_stage_is_not_that_of_the_noise(stage_mm):
    """Contact points that were found with an error of 0.1 mm scatter by it, which is no error of the depths."""
    rng = np.random.default_rng(0)
    travel = rng.normal(0, np.hypot(stage_mm, 0.1), 400)
    points = [Contact(t, t - 1.96 * 0.1, t + 1.96 * 0.1, 0.0, 1.0, 1.5) for t in travel]
    presses = Presses(tuple(SimpleNamespace(contact=point) for point in points), (), (), np.zeros(0))
    keys = _depth_zero(SimpleNamespace(depth_zero="session"), presses)
    assert keys["press_scatter_mm"] == pytest.approx(stage_mm, abs=0.04)
    assert keys["session_scatter_mm"] == pytest.approx(travel.std() / 20, rel=0.01)


@pytest.mark.parametrize(
    "where", [{}, {"x": "4"}, {"x": "4", "y": "5", "polar": {"radius": "4", "angle": "5"}}]
)
def test_a_place_is_said_once(tmp_path, where):
    stage = yaml.safe_load(mapping(tmp_path).read_text())["stage"]
    del stage["polar"]
    with pytest.raises(ConfigError, match="give x and y, or polar"):
        load_import(mapping(tmp_path, stage={**stage, **where}))
