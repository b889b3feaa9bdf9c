"""Contacts of a force distribution: two apart are two, a valley divides two that touch; total and centre of each."""

import csv
import json
from types import SimpleNamespace

import numpy as np
from numpy.testing import assert_allclose

from gelforge.cli.model.predict import distribution_table
from gelforge.learning.models.contacts import contacts
from gelforge.learning.models.reliability import centre_of_pressure

NX, NY, WIDTH = 12, 9, np.array([24.0, 27.0])  # bins of 2 x 3 mm


def pressed(*places: tuple[float, float], radius: float = 3.5) -> np.ndarray:
    """Return a distribution with a cone of pressing force and some shear about each place [mm]."""
    x, y = (np.arange(NX * NY) % NX + 0.5) * 2.0, (np.arange(NX * NY) // NX + 0.5) * 3.0
    force = np.zeros((NX * NY, 3))
    for number, (px, py) in enumerate(places, 1):
        size = number * np.maximum(1 - np.hypot(x - px, y - py) / radius, 0)
        force += np.column_stack([0.1 * size, -0.2 * size, -size])
    return force


def test_contacts_are_told_apart_and_add_up_to_the_total():
    left, right = (5.0, 7.5), (19.0, 19.5)  # middles of bins
    found = contacts(pressed(left, right), NX, NY, WIDTH)
    assert len(found) == 2
    assert_allclose([one.centre_mm for one in found], [right, left], atol=1e-12)
    assert_allclose(found[1].force_N, pressed(left).sum(axis=0), atol=1e-12)
    assert_allclose(found[0].force_N, 2 * found[1].force_N, rtol=1e-12)

    # Contacts add up to the total and one alone is at the centre of pressure
    force = pressed((5.0, 7.5), (19.0, 19.5))
    assert_allclose(sum(one.force_N for one in contacts(force, NX, NY, WIDTH)), force.sum(axis=0), atol=1e-12)
    (one,) = contacts(pressed((8.3, 11.9)), NX, NY, WIDTH)
    assert_allclose(one.centre_mm, centre_of_pressure(pressed((8.3, 11.9))[None], NX, NY, WIDTH)[0])

    # What pulls is no contact and an untouched sensor has none
    assert contacts(np.zeros((NX * NY, 3)), NX, NY, WIDTH) == []
    pulled = pressed((5.0, 7.5))
    pulled[-1, 2] = 0.3
    assert len(contacts(pulled, NX, NY, WIDTH)) == 1


def test_contacts_that_touch_are_two_where_a_valley_divides_them():
    one, other = (5.0, 13.5), (17.0, 13.5)
    force = pressed(one, other, radius=6.5)  # between them a quarter of the weaker top
    found = contacts(force, NX, NY, WIDTH)
    assert len(found) == 2
    assert_allclose([one.centre_mm[0] for one in found], [17.0, 5.0], atol=1.0)
    assert_allclose(sum(one.force_N for one in found), force.sum(axis=0), atol=1e-12)
    level = force.copy()
    level[:, 2] = np.where(force[:, 2] < 0, force[:, 2] - 0.8, 0)  # the same hills on a plateau
    assert len(contacts(level, NX, NY, WIDTH)) == 1

    # Bins that share a corner are one contact
    corner = np.zeros((NX * NY, 3))
    corner[[0, NX + 1], 2] = -1.0
    assert len(contacts(corner, NX, NY, WIDTH)) == 1

    # The rim of a punch is no contact of its own
    x, y = (np.arange(NX * NY) % NX + 0.5) * 2.0, (np.arange(NX * NY) // NX + 0.5) * 3.0
    away = np.hypot(x - 12, y - 13.5)
    force = np.zeros((NX * NY, 3))
    force[:, 2] = -np.where(away < 6.5, np.where(away < 3.5, 0.3, 1.0), 0)
    assert len(contacts(force, NX, NY, WIDTH)) == 1


def test_the_table_of_predictions_holds_the_contacts(tmp_path, capsys):
    left, right = (5.0, 7.5), (19.0, 19.5)
    prediction = SimpleNamespace(name="a", time_s=0.0, disagreement=0.5, force_N=pressed(left, right))
    with distribution_table(tmp_path / "p.csv", (NX, NY, WIDTH)) as write:
        write(prediction)
    (row,) = csv.DictReader((tmp_path / "p.csv").open())
    assert [one["cop_mm"] for one in json.loads(row["contacts"])] == [list(right), list(left)]
    assert float(row["fz_N"]) == float(f"{prediction.force_N[:, 2].sum():.6g}")
    assert len(row) == 7 + 3 * NX * NY
    with distribution_table(None, (NX, NY, WIDTH)) as write:
        write(prediction)
    assert "at (19.00, 19.50) mm" in capsys.readouterr().out
