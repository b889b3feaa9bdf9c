"""Where sites lie between which labels are interpolated, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
import specimens

from gelforge.config import ConfigError, study_from
from gelforge.config.basis.variants import merged
from gelforge.indentation.planning.derived import derived_chunks
from gelforge.indentation.planning.lattice import (
    LAST,
    index_of,
    interpolable,
    lattice_of,
    name_of,
    solved_site,
)
from gelforge.indentation.planning.plan import plan_cells
from gelforge.indentation.sensor.symmetry import transform_points

STUDY = specimens.BETWEEN | {
    "plan": {
        "grid": {"spacing_mm": 1.1, "margin_mm": 5.0},
        "depths_mm": [0.5, 1.0],
        "interpolation": {"tolerance": 0.5},
    },
}


def study_with(changes=None):
    return study_from(merged(STUDY, changes or {}))


def planned(changes=None):
    study = study_with(changes)
    cells = plan_cells(study)
    return study, cells, lattice_of(study, cells)


def test_levels_are_nested_with_names_and_images_and_enclose_the_plan():
    _, cells, lattice = planned()
    places = np.array([(cell.x_mm, cell.y_mm) for cell in cells.values()])
    assert (places >= np.array(lattice.low) - 1e-6).all() and (places <= np.array(lattice.high) + 1e-6).all()
    for number in range(LAST):
        assert set(lattice.level(number)) < set(lattice.level(number + 1))
    assert len(lattice.level(1)) == 81 and len(lattice.representatives(lattice.level(1))) == 15

    # One place of an orbit is solved and its images lie where the symmetry carries it
    _, _, lattice = planned()
    everything = lattice.level(1)
    found = [image for at in lattice.representatives(everything) for image in lattice.images(at)]
    assert sorted(found) == sorted(everything)
    for at in lattice.representatives(everything):
        for image in lattice.images(at):
            carried = transform_points(lattice.symmetry_to(at, image), lattice.place(at), 32.0)
            assert carried == pytest.approx(lattice.place(image), abs=2e-6)

    # Names come back
    for at in lattice.level(1):
        assert index_of(name_of(at)) == at
        site = solved_site(lattice, name_of(at))
        assert (site.x_mm, site.y_mm) == tuple(lattice.place(at)) and site.depths_mm == (0.5, 1.0)
    assert solved_site(lattice, "x01_y01") is None and solved_site(lattice, "between_0999_0000") is None

    # The places asked for around a position enclose it
    for position in ([5.0, 5.0], [27.0, 27.0], [16.0, 8.4], [26.9, 5.1]):
        around = np.array([lattice.place(at) for at in lattice.around(np.array(position), 0)])
        assert len(around) == 9
        assert (around.min(axis=0) <= np.array(position) + 1e-9).all()
        assert (around.max(axis=0) >= np.array(position) - 1e-9).all()


def test_sites_are_solved_themselves_near_edges_and_without_interpolation():
    # Sites near an edge paths and small plans are solved themselves
    study, cells, _ = planned({"plan": {"grid": {"spacing_mm": 1.1, "margin_mm": 1.0}}})
    near_edge = [cell for cell in cells.values() if min(cell.x_mm, 32 - cell.x_mm) < 2]
    assert near_edge and all(not cell.between for cell in near_edge)
    inside = next(cell for cell in cells.values() if cell.between)
    assert not interpolable(study, replace(inside, phases=("load", "unload")))

    # A small plan is solved as it costs no more
    _, cells, lattice = planned({"plan": {"grid": {"spacing_mm": 11.0}}})
    assert lattice is None
    assert not any(cell.between for cell in cells.values())

    # Without interpolation every site is solved or derived
    plain = study_with({"plan": {"interpolation": "none"}})
    assert not any(cell.between for cell in plan_cells(plain).values())
    assert "interpolation" not in plain.model_dump(mode="json")["plan"]

    # A job makes the derived sites of its shard
    _, cells, _ = planned({"plan": {"interpolation": "none"}})
    chunks = derived_chunks(cells, 16)
    mirrored = [name for name, cell in cells.items() if cell.source]
    assert sorted(name for names in chunks.values() for name in names) == sorted(mirrored)
    order = list(cells)
    for number, names in chunks.items():
        assert all(order.index(name) // 16 == number for name in names)


def test_depths_that_differ_give_a_ladder_that_encloses_them(tmp_path):
    rng = np.random.default_rng(3)
    rows = [
        f"p{k},{x:.3f},{y:.3f},{z:.3f}"
        for k, (x, y, z) in enumerate(rng.uniform([6, 6, 0.1], [26, 26, 2], (200, 3)))
    ]
    (tmp_path / "plan.csv").write_text("\n".join(["cell,x_mm,y_mm,depth_mm", *rows]) + "\n")
    plan = {"file": str(tmp_path / "plan.csv"), "interpolation": {"tolerance_N": 0.001}}
    study = study_from({**STUDY, "plan": plan})
    cells = plan_cells(study)
    lattice = lattice_of(study, cells)
    depths = [cell.depths_mm[0] for cell in cells.values()]
    assert lattice.depths_mm[0] == min(depths) and lattice.depths_mm[-1] == max(depths)
    assert all(cell.between for cell in cells.values())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mechanics": {"binning": "node"}}, "binning: node"),
        ({"mechanics": {"store_displacement": True}}, "store_displacement"),
        ({"mechanics": {"sensitivities": ["gel_stiffness"]}}, "sensitivities"),
        ({"mechanics": {"error_bars": False}}, "tolerance_N"),
        ({"mechanics": {"mesh": {"elements": "tetrahedra"}}}, "tetrahedra"),
        (
            {
                "mechanics": {
                    "effects": {"geometry": {"inclusions": [{"centre_mm": [9, 9, -2], "radius_mm": 1}]}}
                }
            },
            "inclusions",
        ),
        (
            {
                "mechanics": {
                    "effects": {
                        "history": {"viscoelastic": {"gel": {"relative_moduli": [0.1], "times_s": [1.0]}}}
                    }
                }
            },
            "history",
        ),
    ],
)
def test_what_does_not_move_with_the_indenter_is_refused_in_a_sentence(changes, words):
    with pytest.raises(ConfigError, match=f"plan.interpolation: .*{words}.*interpolation: none"):
        plan_cells(study_with(changes))


@pytest.mark.parametrize("given", [{}, {"tolerance": 0.5, "tolerance_N": 0.1}, {"tolerance": 0}])
def test_one_positive_tolerance_is_given(given):
    with pytest.raises(ConfigError):
        study_from({**STUDY, "plan": {**STUDY["plan"], "interpolation": given}})
