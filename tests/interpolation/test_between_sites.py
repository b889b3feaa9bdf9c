"""Forces between solved sites against closed forms, their error bars, and what is never guessed."""

from dataclasses import replace

import numpy as np
import pytest
from closed_form import DEPTHS, LATTICE, LAWS, STUDY, anew, pull, site, solved

from gelforge.config import Interpolation
from gelforge.indentation.cells.cell_file import read_cell, write_cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.lattice import lattice_digest, name_of
from gelforge.indentation.sensor.symmetry import D4, transform_bins, transform_points
from gelforge.indentation.solving.mirror import mirror_cell
from gelforge.interpolation import levels, solved_sites
from gelforge.interpolation.labels import Labels
from gelforge.interpolation.nodal_forces import NodalForces
from gelforge.interpolation.weights import depth_weights, nearest, place_weights, positive_weights
from gelforge.report.figures.simulation.label_figure import read_label

PLACES = [(9.3, 11.7), (14.2, 15.1), (16.0, 7.1), (24.9, 25.3), (6.4, 6.2)]


def labels(sites=None, own=None):
    return Labels(STUDY, LAWS, sites or solved(), own or {})


def planned(position, name="p", **fields):
    return PlannedCell(name, *map(float, position), DEPTHS, between=lattice_digest(STUDY, LATTICE), **fields)


@pytest.mark.parametrize("place", PLACES)
def test_a_smooth_field_is_met(place):
    """Cubic radial functions on a spacing of 2.5 mm; the field changes by a fifth of itself over the region."""
    true = site("true", place)
    found = solved().at(np.array(place), DEPTHS)
    assert found.force == pytest.approx(
        true.arrays["bin_force_N"], abs=2e-3 * np.abs(true.arrays["bin_force_N"]).max()
    )
    assert found.force.sum(axis=1) == pytest.approx(
        true.arrays["total_force_N"], abs=1e-3 * np.abs(true.arrays["total_force_N"]).max()
    )


def test_halved_spacing_quarters_the_error_and_normal_forces_stay_apart():
    # Halving the spacing quarters the error at least
    def worst(level):
        sites = solved(level)
        errors = [
            sites.at(np.array(place), DEPTHS).force.sum(axis=1) - site("true", place).arrays["total_force_N"]
            for place in PLACES
        ]
        return np.abs(errors).max()

    assert worst(1) < worst(0) / 4

    # Normal and friction forces stay apart
    found = solved().at(np.array(PLACES[0]), DEPTHS)
    normal, friction = found.bins[..., :3].sum(axis=1), found.bins[..., 3:].sum(axis=1)
    assert friction[:, :2] == pytest.approx(-0.3 * normal[:, 2:] * pull(PLACES[0]), rel=1e-2)
    assert friction[:, 2] == pytest.approx(np.zeros(len(DEPTHS)), abs=1e-15)

    # Moved forces are those of nodes that lie elsewhere. A shift by whole bins moves the bins; one by a part of a
    # bin keeps total and first moment
    here = NodalForces.of(site("here", (16.0, 16.0)))
    at = here.binned(np.array([16.0, 16.0]), STUDY.sensor)
    moved = here.binned(np.array([17.6, 14.4]), STUDY.sensor)
    assert moved == pytest.approx(np.roll(at, (-1, 1), axis=(1, 2)), abs=1e-15)
    part = here.binned(np.array([16.3, 16.0]), STUDY.sensor)
    assert part.sum(axis=(1, 2)) == pytest.approx(at.sum(axis=(1, 2)), rel=1e-12)


@pytest.mark.parametrize("place", PLACES)
def test_bins_add_up_to_the_weighted_totals(place):
    sites = solved()
    found = sites.at(np.array(place), DEPTHS)
    by_name = {name_of(at): cell for at, cell in sites.cells.items()}
    fz = sum(w * by_name[name].arrays["total_force_N"][:, 2] for name, w in zip(found.names, found.weights))
    assert sum(found.weights) == pytest.approx(1, abs=1e-9)
    assert found.force[..., 2].sum(axis=1) == pytest.approx(fz, rel=1e-11)


@pytest.mark.parametrize("symmetry", ["mirror_x", "swap_xy", "rotate_90"])
def test_an_image_of_a_place_has_the_image_of_its_forces(symmetry):
    sites = solved()
    place = np.array(PLACES[0])
    image = transform_points(symmetry, place, 32.0)
    here, there = sites.at(place, DEPTHS).force, sites.at(image, DEPTHS).force
    scale = np.abs(here).max()
    assert there == pytest.approx(transform_bins(symmetry, here, 20), abs=1e-6 * scale)
    assert symmetry in D4


@pytest.mark.parametrize("depth", [0.65, 1.0])
def test_between_depths_the_contact_grows_as_a_ball_s(depth, monkeypatch):
    """Nodes 0.25 mm apart show a contact of 2 mm with an error of some per cent; without growth the rim's bins err more."""
    place = np.array(PLACES[1])
    true = site("true", place, (depth,)).arrays["bin_force_N"]

    def worst():
        found = solved().at(place, (depth,)).force
        total = true.sum(axis=1)
        assert found.sum(axis=1) == pytest.approx(total, abs=1e-2 * np.abs(total).max())
        return np.abs(found - true).max() / np.abs(true).max()

    growing = worst()
    monkeypatch.setattr(solved_sites, "contact_width", lambda ball, depth: 1.0)
    assert growing < 0.03 and (depth > 0.8 or growing < worst() / 1.5)


@pytest.mark.parametrize("place", [(5.9, 16.0), (16.0, 26.1)])
def test_nothing_is_extrapolated_beyond_the_places(place):
    with pytest.raises(ValueError, match="outside the solved"):
        solved(0).at(np.array(place), DEPTHS)


@pytest.mark.parametrize("depth", [0.4, 2.1])
def test_nothing_is_extrapolated_beyond_the_depths(depth):
    with pytest.raises(ValueError, match="outside the solved"):
        solved(0).at(np.array([16.0, 16.0]), (depth,))


def test_weights_reproduce_planes_and_cubics():
    rng = np.random.default_rng(1)
    places, at = rng.uniform(0, 10, (30, 2)), np.array([4.0, 5.0])
    chosen = nearest(places, at)
    weights = place_weights(places[chosen], at)
    assert weights @ (2 + 3 * places[chosen, 0] - places[chosen, 1]) == pytest.approx(2 + 12 - 5, rel=1e-9)
    line = np.column_stack([np.arange(5.0), np.full(5, 7.0)])
    assert place_weights(line, np.array([2.5, 7.0])) @ line[:, 0] == pytest.approx(2.5, rel=1e-9)

    # A cubic over depth is met
    depths = np.array([0.2, 0.5, 0.9, 1.4, 2.0])
    numbers, weights = depth_weights(depths, 0.7)
    assert weights @ depths[numbers] ** 3 == pytest.approx(0.7**3, rel=1e-12)


def test_weights_of_error_bars_are_shares_and_most_to_the_nearest():
    places = np.random.default_rng(2).uniform(0, 10, (12, 2))
    weights = positive_weights(places, np.array([4.0, 6.0]))
    assert weights.sum() == pytest.approx(1.0)
    assert (weights > 0).all()
    away = np.linalg.norm(places - [4.0, 6.0], axis=1)
    assert (np.argsort(-weights) == np.argsort(away)).all()


def test_error_bars_hold_what_a_label_is_wrong_by():
    """Every site is a little wrong by itself, as by its mesh: bars hold that, and are not far wider than it."""
    rng = np.random.default_rng(5)
    sites = anew()
    for cell in sites.cells.values():
        factor = 1 + 0.01 * rng.standard_normal()
        for name in ("node_normal_N", "node_shear_N", "bin_force_N", "total_force_N"):
            cell.arrays[name] *= factor
    errors, bars = [], []
    for place in rng.uniform(7, 25, (40, 2)):
        true = site("true", place).arrays["total_force_N"] * (1 + 0.01 * rng.standard_normal())
        errors.append((sites.at(place, DEPTHS).force.sum(axis=1) - true)[:, 2])
        bars.append(sites.bars_at(place, DEPTHS)["total_interpolation"][:, 2])
    assert np.mean(np.abs(errors) <= 2 * np.array(bars)) > 0.9
    assert np.sqrt(np.mean(np.square(bars))) < 3 * np.sqrt(np.mean(np.square(errors)))


def test_a_label_and_its_image_say_where_they_are_interpolated_from(tmp_path):
    cell = labels().cell(planned(PLACES[0]))
    path = tmp_path / "p.h5"
    write_cell(path, cell)
    back = read_cell(path)
    names, weights = back.attributes["interpolated_from"], back.attributes["interpolation_weights"]
    assert sum(weights) == pytest.approx(1) and names[0] == name_of((8, 16))  # (8.5, 11) mm, the nearest
    assert (back.arrays["bin_sigma_interpolation_N"] >= 0).all()
    assert back.arrays["total_force_N"] == pytest.approx(back.arrays["bin_force_N"].sum(axis=1), abs=1e-6)
    assert "node_xy_mm" not in back.arrays
    assert read_label(path).position_mm == pytest.approx(
        PLACES[0]
    )  # it says of which sensor it is, so it can be drawn

    # Its image is made by the same mirroring as a solved one s
    image = planned(
        transform_points("mirror_x", np.array(PLACES[0]), 32.0), "q", source="p", symmetry="mirror_x"
    )
    mirrored = mirror_cell(cell, STUDY, LAWS, image)
    write_cell(tmp_path / "q.h5", mirrored)
    assert read_cell(tmp_path / "q.h5").attributes["source"] == "p"
    expected = transform_bins("mirror_x", cell.arrays["bin_force_N"], 20)
    assert mirrored.arrays["bin_force_N"] == pytest.approx(expected)
    assert list(mirrored.attributes["interpolated_from"]) == list(cell.attributes["interpolated_from"])


def test_at_a_solved_site_the_label_is_the_solved_one():
    sites = solved()
    at = next(iter(sites.cells))
    cell = labels(sites).cell(planned(LATTICE.place(at)))
    assert cell.attributes["solved_as"] == name_of(at) and "interpolated_from" not in cell.attributes
    assert np.array_equal(cell.arrays["bin_force_N"], sites.cells[at].arrays["bin_force_N"])
    image = LATTICE.images((8, 16))[1]
    moved = labels(sites).cell(planned(LATTICE.place(image)))
    assert moved.attributes["solved_as"] == name_of(LATTICE.images((8, 16))[0])
    true = site("true", LATTICE.place(image)).arrays["bin_force_N"]
    assert moved.arrays["bin_force_N"] == pytest.approx(true, abs=1e-9)


def test_beside_a_failed_site_labels_have_failed_and_elsewhere_they_have_not(tmp_path):
    failed = LATTICE.representatives([(32, 32)])[0]  # the middle
    made = labels(anew(failed=[failed]))
    beside = made.cell(planned((15.2, 16.7)))
    assert beside.attributes["status"] == "failed" and name_of(failed) in beside.attributes["reason"]
    write_cell(tmp_path / "p.h5", beside)
    assert not read_cell(tmp_path / "p.h5").converged
    assert made.cell(planned((9.0, 9.5))).converged


def everywhere(spacing=1.0):
    along = np.arange(6.3, 25.8, spacing)
    return [planned((x, y), f"p{i}_{j}") for i, x in enumerate(along) for j, y in enumerate(along)]


def test_levels_go_on_until_the_tolerance_is_met():
    found = levels.decide(solved(0), 0, everywhere(), Interpolation(tolerance=100.0))
    assert (
        found.done
        and not found.themselves
        and found.beyond == 0
        and found.labels == len(everywhere()) * len(DEPTHS)
    )
    assert "done" in found.words

    # A tighter one asks for the next level where it is missed
    found = levels.decide(solved(0), 0, everywhere(), Interpolation(tolerance_N=1e-6))
    assert not found.done
    more = levels.known_places(found.more)
    assert set(more) <= set(LATTICE.level(1)) - set(LATTICE.level(0))

    # One that is not met says what is reached and solves the sites themselves
    found = levels.decide(solved(1), 1, everywhere()[:3], Interpolation(tolerance_N=1e-9))
    assert found.done and set(found.themselves) == {"p0_0", "p0_1", "p0_2"}
    assert found.largest > 1 and "are solved" in found.words
    own = {"p0_0": site("p0_0", (6.3, 6.3))}
    cell = labels(own=own).cell(replace(everywhere()[0]))
    assert cell.attributes["solved_as"] == "p0_0"
