"""The split: by orbit, seeded, of the size asked for, near walls and in the middle."""

import json

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gelforge.config import Sensor
from gelforge.dataset.shard import ShardDataset
from gelforge.dataset.splits import nearest_mm, orbits, planned_split, separation, split_orbits
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import plan_cells
from gelforge.indentation.sensor.symmetry import D4, transform_points

NAMES = [f"x{i}_y{j}" for i in range(9) for j in range(9)]
ALONE = {name: name for name in NAMES}
PLACES = {name: float(min(i % 9, i // 9)) for i, name in enumerate(NAMES)}


def sensor(width_x=32.0, width_y=32.0) -> Sensor:
    layer = {"name": "gel", "thickness_mm": 6.0, "material": "soft"}
    return Sensor.model_validate({"layers": [layer], "width_x_mm": width_x, "width_y_mm": width_y})


def plan_of(places, depths=(1.0,), within=0.01) -> dict[str, PlannedCell]:
    return {
        f"c{i}": PlannedCell(f"c{i}", float(x), float(y), depths, within_mm=within)
        for i, (x, y) in enumerate(places)
    }


def test_a_fifth_of_the_orbits_of_all_parts_tests():
    split = split_orbits(ALONE, PLACES, 0.2, 0)
    assert list(split) == sorted(NAMES)
    assert sum(side == "test" for side in split.values()) == round(0.2 * 81)

    # Of 81 cells 32 lie at a side: a draw without parts can leave them out.
    for seed in range(20):
        tested = [
            PLACES[name] for name, side in split_orbits(ALONE, PLACES, 0.1, seed).items() if side == "test"
        ]
        assert min(tested) == 0
        assert max(tested) >= 2

    # One cell trains
    assert split_orbits({"alone": "alone"}, {"alone": 1.0}, 0.2, 0) == {"alone": "train"}

    # The draw depends on cells and seed only
    turned = dict(reversed(ALONE.items()))
    assert split_orbits(ALONE, PLACES, 0.2, 3) == split_orbits(turned, PLACES, 0.2, 3)
    assert split_orbits(ALONE, PLACES, 0.2, 3) != split_orbits(ALONE, PLACES, 0.2, 4)


@given(st.integers(2, 40), st.floats(0.01, 0.99), st.integers(0, 9))
def test_both_sides_have_an_orbit(count, fraction, seed):
    names = [f"c{i}" for i in range(count)]
    sides = list(split_orbits({n: n for n in names}, dict.fromkeys(names, 1.0), fraction, seed).values())
    assert set(sides) == {"train", "test"}


@given(
    st.lists(st.tuples(st.integers(1, 31), st.integers(1, 31)), min_size=1, max_size=12), st.integers(0, 9)
)
def test_no_mirror_image_of_a_trained_place_is_tested(places, seed):
    images = {tuple(transform_points(name, np.array(p, float), 32.0)) for p in places for name in D4}
    planned = plan_of(sorted(images))
    split, orbit = planned_split(planned, sensor(), 0.3, seed)
    for cell in planned.values():
        for name in D4:
            x, y = transform_points(name, np.array([cell.x_mm, cell.y_mm]), 32.0)
            image = next(c for c in planned.values() if np.hypot(c.x_mm - x, c.y_mm - y) < 1e-6)
            assert split[image.name] == split[cell.name]
            assert orbit[image.name] == orbit[cell.name]


def scattered(places, visits, scatter_mm, seed):
    """Return positions (n, 2) that a robot reaches when it is sent to each place so many times."""
    rng = np.random.default_rng(seed)
    return (np.repeat(places, visits, axis=0) + rng.normal(0, scatter_mm, (len(places) * visits, 2))).round(6)


GRID = np.stack(np.meshgrid([6.0, 11.0, 16.0, 21.0, 26.0], [6.0, 11.0, 16.0, 21.0, 26.0]), -1).reshape(-1, 2)


@pytest.mark.parametrize("size", [(32, 32), (32, 30)])
@pytest.mark.parametrize("seed", range(5))
def test_a_robot_that_scatters_has_no_test_position_beside_a_training_one(size, seed):
    """Every visit of a position is a site of the plan, as where positions are the recorded ones."""
    planned = plan_of(scattered(GRID, 4, 0.015, seed), within=0.075)
    split, _ = planned_split(planned, sensor(*size), 0.2, seed)
    found = separation(planned, split, sensor(*size))
    assert set(split.values()) == {"train", "test"}
    assert found.smallest_mm > 0.9  # 30 mm: a mirror image lies 1 mm next to a position of its own
    assert found.doubtful == (size == (32, 30))


@given(
    st.lists(st.tuples(st.integers(1, 31), st.integers(1, 31)), min_size=2, max_size=12), st.integers(0, 9)
)
def test_no_mirror_image_of_a_trained_place_is_tested_where_positions_scatter(places, seed):
    planned = plan_of(scattered(np.array(places, float), 2, 0.015, seed), within=0.2)
    split, _ = planned_split(planned, sensor(), 0.3, seed)
    xy = np.array([(cell.x_mm, cell.y_mm) for cell in planned.values()])
    tests = np.array([split[name] == "test" for name in planned])
    for k in np.flatnonzero(tests):
        images = np.array([transform_points(name, xy[k], 32.0) for name in D4])
        apart = np.linalg.norm(images[:, None] - xy[~tests], axis=-1).min()
        assert apart > 0.2
        assert apart == pytest.approx(nearest_mm(xy[k], xy[~tests], sensor())[0])


def test_near_positions_and_images_are_one_orbit_and_the_spacing_that_meant():
    # Near positions and mirror images are one orbit
    line = plan_of([(10.0, 5.0), (10.02, 5.0), (10.04, 5.0), (10.061, 5.0)], within=0.02)
    assert list(orbits(line, sensor()).values()) == ["c0", "c0", "c0", "c3"]

    # A rectangle has no diagonal and other depths at a place are no other orbit
    planned = plan_of([(4, 10), (28, 10), (10, 4)])
    assert list(orbits(planned, sensor()).values()) == ["c0", "c0", "c0"]
    assert list(orbits(planned, sensor(32, 20)).values()) == ["c0", "c0", "c2"]
    deeper = {"deep": PlannedCell("deep", 4.0, 10.0, (2.0,))}
    assert orbits(planned | deeper, sensor())["deep"] == "c0"

    # The usual spacing is that of the positions meant. A grid states its own; near positions that count as several
    # do not make it small
    planned = plan_of(GRID)
    split, _ = planned_split(planned, sensor(), 0.2, 0)
    assert separation(planned, split, sensor()).spacing_mm == pytest.approx(5.0)
    several = plan_of(scattered(GRID, 4, 0.015, 0))
    split, _ = planned_split(several, sensor(), 0.2, 0)
    found = separation(several, split, sensor())
    assert found.smallest_mm < 0.1 and found.spacing_mm > 2 and found.doubtful
    alone = plan_of([(10, 10)])
    assert separation(alone, {"c0": "train"}, sensor()) is None


@pytest.mark.parametrize("part", [slice(0, 4), slice(4, 9)])
def test_every_row_of_a_cell_is_on_one_side_in_every_shard(made, part):
    path = made.join(names=made.names[part])
    rows = ShardDataset([path])
    read = rows.read(np.arange(len(rows)), ["cell", "split", "press"])
    expected, orbit = planned_split(
        plan_cells(made.study), made.study.sensor, made.study.dataset.test_fraction, made.study.seed
    )
    assert [expected[cell] for cell in read["cell"]] == list(read["split"])
    assert len(set(zip(read["cell"], read["split"]))) == len(set(read["cell"]))
    with h5py.File(path) as file:
        kept = json.loads(file.attrs["cells"])
    assert {name: about["orbit"] for name, about in kept.items()} == {n: orbit[n] for n in made.names[part]}
