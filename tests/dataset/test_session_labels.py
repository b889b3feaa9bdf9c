"""Labels that belong to their session: a sensor that ages from one to the next, and one that softens from press to press."""

import numpy as np
import pandas as pd
import pytest
import specimens
from session_folder import HEADER, press_lines, write_session
from small_dataset import write_features

from gelforge.cli.jobs.dataset import agreement
from gelforge.cli.jobs.materials import fit_law
from gelforge.cli.jobs.recordings import readings
from gelforge.cli.jobs.sites import simulate
from gelforge.cli.products.laws import read_laws
from gelforge.cli.products.sessions import own_labels
from gelforge.cli.study.cost import JOB_S, Costs, session_costs, steps_in_order
from gelforge.config import Session, session_study, write_yaml
from gelforge.dataset import presses_in_order
from gelforge.dataset.agreement import agreement_table
from gelforge.dataset.join import join_shard
from gelforge.dataset.manifest import make_manifest
from gelforge.dataset.recorded_presses import pressed_cells, read_presses, recorded_presses
from gelforge.dataset.schema import DatasetError
from gelforge.dataset.session_labels import OwnPresses
from gelforge.dataset.shard import ShardDataset, lineage, shard_attributes
from gelforge.files import write_product_table
from gelforge.indentation.cells.cell_file import CellError
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.indentation.planning.plan import plan_cells
from gelforge.laws_of_study import law_path

LAWS = specimens.STUDY_LAWS
RATE, AGE = 0.002, 100.0  # per day of both layers; of a session whose study is 10 days old, as the laws are
AGEING = {
    "ageing_per_day": {"gel": RATE, "skin": RATE},
    "age_days": 10.0,
    "reference_age_days": 10.0,
    "stiffening_per_K": {"gel": 0.01},
}
SOFT = {"amount": 0.5, "m_kPa": 1.0, "beta": 0.5}
FOUR = {"grid": {"spacing_mm": 3.0, "margin_mm": 6.5}, "depths_mm": [0.25, 0.5]}  # mirror images of one


def study_here(folder, sessions, symmetry="none", friction=0.45, history=None, **circumstances):
    """Return a study of four places whose sessions and results lie in a folder."""
    plain = specimens.study(plan=FOUR | {"symmetry": symmetry}, error_bars=False, friction=friction)
    changed = with_keys(plain, material={"circumstances": circumstances}, history=history or {})
    return changed.model_copy(update={"sessions": sessions, "data": folder / "data"})


def record(study, session, presses, stated=""):
    """Write a session's folder, presses as (cell, depth) in the order recorded."""
    cells = plan_cells(study)
    lines = [
        line
        for order, (cell, depth) in enumerate(presses)
        for line in press_lines(f"p{order}", order, cells[cell].x_mm, cells[cell].y_mm, depth, images=False)
    ]
    return write_session(study.session_folder(session), extra=stated, lines=[HEADER, *lines])


def features_of(study, folder, session, presses):
    """Write the features of a session: a zero image and one at depth of each press."""
    cells = plan_cells(study)
    rows = [
        (
            session,
            f"p{order}",
            cell,
            order,
            phase,
            cells[cell].x_mm,
            cells[cell].y_mm,
            d,
            f"{order}_{index}.png",
            index,
        )
        for order, (cell, depth) in enumerate(presses)
        for index, (phase, d) in enumerate((("zero", 0.0), ("dwell", depth)))
    ]
    names = ["session", "press", "cell", "order", "phase", "x_mm", "y_mm", "depth_mm", "image", "image_index"]
    return write_features(folder / f"{session}.h5", study, pd.DataFrame(rows, columns=names))


# --------------------------------------------------------------------------------- age and temperature
def test_a_session_changes_what_the_study_feels_and_keeps_its_time_stamps(tmp_path):
    # A session changes the study only by what it states and the study feels
    ageing = study_here(tmp_path, [], **AGEING)

    def stated(study, **keys):
        return session_study(study, Session(session="one", **keys))

    assert stated(ageing) is ageing
    assert stated(ageing, sensor_age_days=10.0, temperature_C=23.0) is ageing
    own = stated(ageing, sensor_age_days=AGE, temperature_C=30.0).mechanics.effects.material.circumstances
    assert (own.age_days, own.temperature_C) == (AGE, 30.0)
    assert own.ageing_per_day == AGEING["ageing_per_day"]
    plain = study_here(tmp_path, [], ageing_per_day={"gel": 0.0})
    assert stated(plain, sensor_age_days=AGE, temperature_C=30.0) is plain

    # Time stamps are kept where materials relax. Rows of a press: load at 2 s, dwell at 3 and 4 s at 0.5 mm; the
    # loading at 0.5 mm/s is before the first of them
    branch = {"relative_moduli": [0.5], "times_s": [1.0]}
    timing = {"speed_mm_per_s": 0.5, "step_mm": 0.25}
    history = {"mullins": {"gel": SOFT}, "viscoelastic": {"gel": branch}, "timing": timing}
    study = study_here(tmp_path, ["one"], history=history)
    first, second = presses_of(study, tmp_path, "one", [("x1_y0", 0.5), ("x0_y0", 0.25)])
    assert (first.name, first.cell, first.depth_mm) == ("p0", "x1_y0", 0.5)
    assert first.path.depths_mm == (0.25, 0.5, 0.5, 0.5)
    assert first.path.phases == ("load", "load", "dwell", "dwell")
    assert first.path.times_s == pytest.approx((0.5, 1.0, 2.0, 3.0))
    assert second.path.times_s == pytest.approx((0.5, 1.5, 2.5))
    assert (second.path.x_mm, second.path.y_mm) == (6.5, 6.5)


def test_labels_of_a_session_are_those_of_its_age(tmp_path, monkeypatch):
    """March states the study's own age, undated none, june 100 days: its forces are 1 + 0.002 x 90 times theirs."""
    monkeypatch.chdir(tmp_path)
    study = study_here(tmp_path, ["march", "june", "undated"], "d4", friction=0.0, **AGEING)
    write_yaml("study.yaml", study)
    for material in study.materials:
        fit_law("study.yaml", material, study.results_folder / "materials" / material)
    law_files = [law_path(study, material) for material in study.materials]
    for session, stated in (
        ("march", "sensor_age_days: 10\n"),
        ("june", f"sensor_age_days: {AGE:g}\n"),
        ("undated", ""),
    ):
        folder = record(study, session, [("x1_y0", 0.5)], stated)
    needed = pressed_cells(folder, plan_cells(study))
    assert needed == ["x0_y0", "x1_y0"]  # the pressed one mirrors the other
    # June's one solved cell of two depths at 8 s for eight, a mirrored one at 1 s, and two jobs
    costs = Costs(study, plan_cells(study))
    costs.solved, costs.mirrored = 8.0, 1.0
    seconds, lines = session_costs(costs)
    assert seconds == pytest.approx(3.0 + 2 * JOB_S)
    assert lines == ["session    june: 2 cells at its own age and temperature, 1 solved"]
    cells = study.results_folder / "cells"
    for session, where in ((None, cells), ("june", study.results_folder / "sessions/june/cells")):
        for cell in needed:
            simulate("study.yaml", cell, law_files, None, session, where / f"{cell}.h5")

    features = {name: features_of(study, tmp_path, name, [("x1_y0", 0.5)]) for name in study.sessions}
    laws = read_laws(study)
    own = own_labels(study, plan_cells(study), laws)
    assert set(own) == {"june"}
    files = {"x1_y0": cells / "x1_y0.h5"}
    join_shard(study, ["x1_y0"], files, features, "shard.h5", None, None, own)
    rows = ShardDataset(["shard.h5"]).read(
        np.arange(6), ["session", "force_distribution_N", "total_force_fem_N"]
    )
    by_session = {name: rows["total_force_fem_N"][2 * k + 1] for k, name in enumerate(rows["session"][::2])}
    assert by_session["june"][2] < -1e-3
    # All moduli grow alike, so do the forces without friction, whose elastic slip has a stiffness of its own; what is left
    # is where the iterations stop.
    np.testing.assert_allclose(by_session["june"], (1 + RATE * (AGE - 10)) * by_session["march"], rtol=1e-5)
    np.testing.assert_array_equal(by_session["undated"], by_session["march"])
    labels = [lineage("shard.h5", row)["label"]["file"] for row in (1, 3, 5)]
    assert labels == [f"results/small/{where}cells/x1_y0.h5" for where in ("sessions/june/", "", "")]

    for name in study.sessions:
        readings("study.yaml", name, study.results_folder / "recordings" / f"{name}.csv")
    agreement("study.yaml", tmp_path / "agreement.csv")
    table = pd.read_csv("agreement.csv").set_index("session")
    assert table.loc["june", "fem_z_N"] == pytest.approx(by_session["june"][2], rel=1e-8)
    assert table.loc["march", "fem_z_N"] == pytest.approx(by_session["march"][2], rel=1e-8)

    younger = study_here(tmp_path, study.sessions, "d4", **AGEING | {"ageing_per_day": {"gel": 0.001}})
    stale = own_labels(younger, plan_cells(younger), laws)
    with pytest.raises(DatasetError, match=r"sessions/june/cells/x1_y0\.h5.*other settings"):
        join_shard(study, ["x1_y0"], files, features, "shard.h5", None, None, stale)


# --------------------------------------------------------------------------------------------- softening
DEEP_FIRST = [("x0_y0", 0.5), ("x0_y0", 0.25), ("x1_y0", 0.25)]
DEEP_LAST = [DEEP_FIRST[2], DEEP_FIRST[1], DEEP_FIRST[0]]


def presses_of(study, folder, session, presses):
    recorded = record(study, session, presses)
    return recorded_presses(read_presses(recorded, plan_cells(study)), plan_cells(study), study)


@pytest.fixture(scope="module")
def pressed(tmp_path_factory):
    """Two sessions of the same three presses in opposite orders, each solved from an untouched sensor."""
    folder = tmp_path_factory.mktemp("pressed")
    softening = {"mullins": {"gel": SOFT, "skin": SOFT}}
    study = study_here(folder, ["deep_first", "deep_last"], history=softening)
    files = {}
    for session, presses in (("deep_first", DEEP_FIRST), ("deep_last", DEEP_LAST)):
        files[session] = folder / session / "presses.h5"
        own = presses_of(study, folder, session, presses)
        assert presses_in_order.press_in_order(study, LAWS, {}, own, session, files[session]) == ""
        assert not files[session].with_name("presses.part").exists()
    return study, files


def force(label):
    return -label.total[2]


@pytest.mark.thorough
def test_a_press_carries_what_those_before_it_left(pressed):
    """The same three presses; what differs is what has been before. As new beyond the depths seen, softer within."""
    study, files = pressed
    assert steps_in_order(study, plan_cells(study), "deep_first") == (3, 4)  # of 0.25 mm
    first, last = (OwnPresses(files[name]) for name in ("deep_first", "deep_last"))
    deep, again, beside = (force(first.label(f"p{k}")) for k in range(3))
    beside_new, shallow_new, deep_later = (force(last.label(f"p{k}")) for k in range(3))
    assert (
        again < 0.9 * shallow_new
    )  # pressed twice as deep before; 22 % in tests/indentation/test_effects_history.py
    assert beside < 0.999 * beside_new  # 3 mm next to a press
    assert deep_later == pytest.approx(deep, rel=0.02)  # its own depth has not been seen before


def test_each_press_has_its_own_row_and_a_failed_one_is_listed(pressed, tmp_path, monkeypatch):
    study, files = pressed
    solved, calls = presses_in_order._solved, []

    def second_fails(*arguments):
        cell, grid = solved(*arguments)
        calls.append(cell)
        if len(calls) == 2:
            cell.attributes.update(status="failed", reason="no equilibrium at 0.25 mm")
        return cell, grid

    monkeypatch.setattr(presses_in_order, "_solved", second_fails)
    failed = tmp_path / "failed" / "presses.h5"
    presses = recorded_presses(
        read_presses(study.session_folder("deep_last"), plan_cells(study)), plan_cells(study), study
    )
    reason = presses_in_order.press_in_order(study, LAWS, {}, presses, "deep_last", failed)
    assert reason == "no equilibrium at 0.25 mm"
    assert len(calls) == 2  # the third is not tried

    features = {
        name: features_of(study, tmp_path, name, recorded)
        for name, recorded in (("deep_first", DEEP_FIRST), ("deep_last", DEEP_LAST))
    }
    own = {"deep_first": OwnPresses(files["deep_first"]), "deep_last": OwnPresses(failed)}
    cells, paths = plan_cells(study), {}
    for name in ("x0_y0", "x1_y0"):  # the plan's cells may fail: they are not where these labels are from
        paths[name] = tmp_path / f"{name}.h5"
        write_failed_cell(paths[name], cells[name])
    shards = [tmp_path / "a.h5", tmp_path / "b.h5"]
    for shard, name in zip(shards, paths):
        join_shard(study, [name], paths, features, shard, None, None, own)
    dataset = ShardDataset(shards)
    rows = dataset.read(np.arange(len(dataset)), ["session", "press", "untouched", "total_force_fem_N"])
    found = {
        (session, press): total
        for session, press, untouched, total in zip(*(rows[k] for k in rows))
        if not untouched
    }
    assert set(found) == {*(("deep_first", f"p{k}") for k in range(3)), ("deep_last", "p0")}
    for (session, press), total in found.items():
        np.testing.assert_array_equal(total, own[session].label(press).total)
    listed = make_manifest(study, shards, {})["sessions"]["deep_last"]["failed_presses"]
    assert listed == {
        "p1": reason,
        "p2": "not solved, because the earlier indentation p1 could not be solved",
    }
    assert shard_attributes(shards[0])["sessions"]["deep_first"]["presses"]["status"] == "converged"

    readings = {}
    for name in study.sessions:
        table = read_presses(study.session_folder(name), cells)
        readings[name] = tmp_path / f"{name}.csv"
        write_product_table(readings[name], table)
    agreed = agreement_table(readings, {}, own)
    assert list(zip(agreed["session"], agreed["press"])) == sorted(found)
    np.testing.assert_allclose(agreed["fem_z_N"], [found[key][2] for key in sorted(found)], rtol=1e-12)


def write_failed_cell(path, planned):
    from small_dataset import cell_of

    from gelforge.indentation.cells.cell_file import write_cell

    write_cell(path, cell_of(planned, failed=True))


def test_a_session_goes_on_where_it_was_broken_off(pressed, tmp_path, monkeypatch):
    """With error bars too, whose coarser sensor softens next to: the second press is solved anew, the first is not."""
    study, files = pressed
    study = study.model_copy(update={"mechanics": study.mechanics.model_copy(update={"error_bars": True})})
    cells = plan_cells(study)
    presses = recorded_presses(read_presses(study.session_folder("deep_first"), cells), cells, study)[:2]
    solved, calls = presses_in_order._solved, []

    def killed(model, laws, press, grid):
        calls.append((press.name, model.mechanics.mesh.near_mm, grid is not None))
        if len(calls) == 3:
            raise KeyboardInterrupt
        return solved(model, laws, press, grid)

    monkeypatch.setattr(presses_in_order, "_solved", killed)
    out = tmp_path / "presses.h5"
    arguments = (study, LAWS, {}, presses, "deep_first", out)
    with pytest.raises(KeyboardInterrupt):
        presses_in_order.press_in_order(*arguments)
    assert not out.exists()
    presses_in_order.press_in_order(*arguments)
    first = [("p0", 1.0, False), ("p0", 2.0, False)]
    second = [("p1", 1.0, True), ("p1", 2.0, True)]
    # broken off in the third; each mesh carries its own softening
    assert calls == [*first, second[0], *second]
    resumed, whole = OwnPresses(out), OwnPresses(files["deep_first"])
    for press in ("p0", "p1"):
        label = resumed.label(press)
        np.testing.assert_allclose(label.total, whole.label(press).total, rtol=1e-12)
        np.testing.assert_array_equal(label.bins.sum(axis=0) != 0, [True] * 3)
        assert 0 < label.total_sigma[2] < 0.25 * force(label)  # elements as large as the skin is thick
        assert (label.bin_sigma[label.bins[:, 2] < 0, 2] > 0).all()


def test_what_is_missing_or_no_number_becomes_no_label(pressed, tmp_path, monkeypatch):
    _, files = pressed
    with pytest.raises(DatasetError, match="deep_first.presses.h5: made with other settings"):
        OwnPresses(files["deep_first"], "another").attributes["status"]
    with pytest.raises(DatasetError, match="none.h5: no such file"):
        OwnPresses(tmp_path / "none.h5").label("p0")
    with pytest.raises(DatasetError, match="no indentation p7"):
        OwnPresses(files["deep_first"]).label("p7")

    # A force that is no number becomes no label
    study, _ = pressed
    cells = plan_cells(study)
    presses = recorded_presses(read_presses(study.session_folder("deep_first"), cells), cells, study)[:1]
    solved = presses_in_order._solved

    def without_a_number(*arguments):
        cell, grid = solved(*arguments)
        cell.arrays["bin_force_N"][0, 7, 2] = np.nan
        return cell, grid

    monkeypatch.setattr(presses_in_order, "_solved", without_a_number)
    with pytest.raises(CellError, match="indentation p0: 1 of 300 numbers of bin_force_N are not finite"):
        presses_in_order.press_in_order(study, LAWS, {}, presses, "deep_first", tmp_path / "presses.h5")
    assert not (tmp_path / "presses.h5").exists()
