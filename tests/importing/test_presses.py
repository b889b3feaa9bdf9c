"""Presses of made raw logs: none lost, none invented, contact points within 0.02 mm or inside their intervals."""

from dataclasses import replace

import numpy as np
import pytest
from raw_logs import MAPPING, Lab, generate

from gelforge.importing.contact import contact_point
from gelforge.importing.importer import import_logs
from gelforge.importing.refusals import ImportingError
from gelforge.importing.stage_motion import excursions

CONTACT_MM = 0.02  # the number
LAB = Lab(presses=6)


def imported(folder, lab, mapping=MAPPING, seed=0):
    truth = generate(folder, lab, seed)
    (folder / "mapping.yaml").write_text(mapping)
    return truth, import_logs(folder / "mapping.yaml", "s1")


@pytest.mark.thorough(but_first=3)
@pytest.mark.parametrize(
    "lab",
    [LAB, replace(LAB, noise_N=0.012), replace(LAB, depths=(0.25, 2.0), relaxes=0.4, noise_N=0.001)],
    ids=["usual", "noisy", "wide"],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_presses_and_contact_points(tmp_path, lab, seed):
    truth, found = imported(tmp_path, lab, MAPPING, seed)
    contacts = found.contacts
    assert len(contacts) == lab.presses
    true = np.array(truth.contact_z_mm)
    inside = (contacts["contact_low_mm"] <= true) & (true <= contacts["contact_high_mm"])
    near = np.abs(contacts["contact_mm"] - true) < CONTACT_MM
    # The interval is of 95 %: of six presses one may lie outside, by less than its half again.
    assert (inside | near).sum() >= lab.presses - 1
    assert (
        np.abs(contacts["contact_mm"] - true) < contacts["contact_high_mm"] - contacts["contact_low_mm"]
    ).all()
    half = (contacts["contact_high_mm"] - contacts["contact_low_mm"]).median() / 2
    assert np.abs(contacts["depth_mm"] - truth.depth_mm).max() < CONTACT_MM + half  # from the median zero
    assert np.abs(contacts["touch_s"] - truth.touch_s).max() < 0.05  # 1 mm/s: 0.05 mm


def test_contact_points_are_as_sure_as_the_force_and_equal_readings_are_one_wait():
    # Intervals are no wider than the force says. A ramp with a hundredth of the noise is known better, and the
    # interval says so
    rng = np.random.default_rng(0)
    travel = np.linspace(-0.6, 1.0, 600)
    force = np.maximum(travel, 0) ** 1.5
    fine, coarse = (contact_point(travel, force + rng.normal(0, noise, 600), 0.1) for noise in (2e-4, 2e-2))
    assert fine.high_mm - fine.low_mm < 0.5 * (coarse.high_mm - coarse.low_mm)
    assert abs(fine.travel_mm) < 0.005
    assert coarse.low_mm <= 0 <= coarse.high_mm

    # Equal readings at depth are one wait. An encoder in steps reads the deepest value twice with another between:
    # one excursion, one wait
    time = np.arange(0, 8, 0.03)
    travel = np.interp(time, [0, 1, 4, 6, 7, 8], [-2, -2, 0.8, 0.8, -2, -2])
    deep = np.flatnonzero(travel == 0.8)
    travel[deep[[10, 30]]] += 0.001
    xyz = np.stack([np.full(len(time), 10.0), np.full(len(time), 12.0), travel], axis=1)
    found = excursions(time, xyz, 0.2, 0.3)
    assert len(found) == 1
    assert [round(wait.travel_mm, 2) for wait in found[0].waits] == [-2.0, 0.8, -2.0]


def test_motions_without_force_are_no_presses_and_unknown_ones_cannot_be_skipped(tmp_path):
    # Motions without force are no presses
    def lifted(table):
        """Add a motion of 1.5 mm towards the gel that ends above it, in the rest at the end."""
        high = table["Z"].max()
        rows = table.index[-40:]
        table.loc[rows, "Z"] = high - 1500 * np.sin(np.linspace(0, np.pi, 40))
        return table

    _, found = imported(tmp_path, replace(LAB, lead_s=3.0, fault={"stage": lifted}))
    assert len(found.presses.kept) == LAB.presses
    assert len(found.presses.untouched_s) == 1

    # An unknown press cannot be skipped
    unknown = tmp_path / "unknown"
    with pytest.raises(ImportingError, match=r"skip names \[9\], there are indentations 1 to 6"):
        imported(unknown, LAB, MAPPING + "skip: [9]\n")


def slipping(t, push, number):
    """Return the force of the third press lost in the middle of its wait."""
    rows = np.flatnonzero((number == 2) & (push > 0))
    top = rows[push[rows].argmax()]
    lost = rows[t[rows] > t[top] + 0.5]
    push = push.copy()
    push[lost] *= 0.1
    return push


FAULTY_PRESS = {
    "the log begins within it": (
        {"cut_force_s": (4.6, 0.0)},
        r"indentation 1 at .* the force log begins within it, .* set incomplete: drop",
        "incomplete: drop\n",
        [2, 3, 4, 5, 6],
    ),
    "the indenter slips off": (
        {"fault": {"push": slipping}},
        r"indentation 3 at .* the indenter slipped off; leave it out with skip: \[3\]",
        "skip: [3]\n",
        [1, 2, 4, 5, 6],
    ),
}


@pytest.mark.parametrize(("traits", "said", "remedy", "kept"), FAULTY_PRESS.values(), ids=FAULTY_PRESS)
def test_a_faulty_press_is_named_and_left_out_by_the_remedy(tmp_path, traits, said, remedy, kept):
    lab = replace(LAB, **traits)
    with pytest.raises(ImportingError, match=said):
        imported(tmp_path, lab)
    _, found = imported(tmp_path, lab, MAPPING + remedy)
    assert [press.number for press in found.presses.kept] == kept


def test_depth_zero_agrees_with_the_force(tmp_path):
    lab = replace(LAB, contact_scatter_mm=0.15)
    with pytest.raises(ImportingError, match=r"contact points lie up to .* set depth_zero: press"):
        imported(tmp_path, lab)
    truth, found = imported(tmp_path, lab, MAPPING.replace("depth_zero: session", "depth_zero: press"))
    assert np.ptp(truth.contact_z_mm) > 0.2
    assert np.abs(found.contacts["contact_mm"] - truth.contact_z_mm).max() < 2 * CONTACT_MM

    # A declared zero that the force denies
    with pytest.raises(ImportingError, match=r"depth_zero\.at_mm is 31\.8 mm, .* 31\.3"):
        imported(tmp_path, LAB, MAPPING.replace("depth_zero: session", "depth_zero: {at_mm: 31.8}"))
    _, found = imported(tmp_path, LAB, MAPPING.replace("depth_zero: session", "depth_zero: {at_mm: 31.37}"))
    assert np.allclose(found.zero_mm, -31.37)
