"""Error bars of nominal forces: wide enough for another code's forces, and no wider than a study states."""

from pathlib import Path

import numpy as np
import pytest

from gelforge.api.studies import paper_study
from gelforge.config import load_study
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.error_bars import layer_totals
from gelforge.indentation.solving.resolution import Resolution, resolution_of
from gelforge.laws_of_study import laws_of
from gelforge.mismatch.fem.base_bars import SIDEWAYS, base_bars, known_resolution
from gelforge.mismatch.fem.nominal import large_elements

# Fx and Fz [N] of the small sensor of validation/, from 0.8 mm on, 6 mm next to its middle and 6 mm along each axis:
# on elements of 0.3 mm and of 0.6 mm, and FElupe's (validation.checks.between_codes --bases concealed --sizes 0.3 0.6)
OWN = np.array(
    [
        [[0.00201, -0.21023], [0.0091, -0.4516], [0.0274, -0.82079]],
        [[0.00211, -0.22708], [0.00886, -0.49004], [0.02473, -0.8882]],
    ]
)
COARSE = np.array(
    [
        [[0.00185, -0.21077], [0.00798, -0.45424], [0.02794, -0.83304]],
        [[0.00172, -0.22744], [0.00841, -0.49415], [0.02476, -0.90054]],
    ]
)
FELUPE = np.array(
    [
        [[0.00182, -0.20919], [0.00826, -0.44761], [0.02606, -0.81126]],
        [[0.00207, -0.22519], [0.00853, -0.48366], [0.02389, -0.87396]],
    ]
)


PLACES = ((16.0, 10.0), (16.0, 16.0))  # mm


def along_x_and_z(forces):
    """Return forces (D, 3) [N] of those along x and z (D, 2)."""
    return np.insert(forces, 1, 0.0, axis=1)


def resolution(place):
    """Return how the small sensor's mesh of 0.3 mm, 0.6 mm away from the contact, resolves a place."""
    study = load_study(Path(__file__).parents[2] / "validation/config/concealed.yaml")
    mesh = study.mechanics.mesh.model_copy(update={"near_mm": 0.3, "far_mm": 0.6})
    return resolution_of(study.sensor, mesh, laws_of(study, []), *place)


@pytest.mark.parametrize("place", range(2))
def test_forces_of_another_code_lie_within_two_bars(place):
    own, coarse, other = (along_x_and_z(forces[place]) for forces in (OWN, COARSE, FELUPE))
    off = np.abs(other - own)[:, [0, 2]]
    bars = base_bars(own, coarse, resolution(PLACES[place]))[:, [0, 2]]
    assert (off < 2.05 * bars).all()
    # next to a wall the difference of meshes alone does not hold Fz, and sideways forces less well
    without = base_bars(own, coarse, None)[:, [0, 2]]
    assert (off[:, 1] > 2.05 * without[:, 1]).all()
    assert np.sqrt(np.mean((off[:, 0] / without[:, 0]) ** 2)) > np.sqrt(
        np.mean((off[:, 0] / bars[:, 0]) ** 2)
    )


def test_bars_without_a_difference_are_those_of_layers_along_z_and_a_share_of_sideways_forces():
    own = np.array([[0.03, -0.01, -0.5], [0.06, -0.02, -1.0]])
    at = Resolution(through=8.0, contrast=0.9, walls=0.1)
    bars = base_bars(own, own, at)
    assert bars[:, 2] == pytest.approx(layer_totals(own, at)[:, 2])
    assert bars[:, :2] == pytest.approx(SIDEWAYS * np.abs(own[:, :2]))
    assert not base_bars(own, own, None).any()


def test_a_study_that_states_its_error_adds_no_parts_of_layers_and_walls():
    for error in (None, 0.01):
        study = paper_study().with_values({"mismatch": {"discretisation": error}})
        at = known_resolution(study, laws_of(study, []), PlannedCell("", 16.0, 16.0, (1.0,)))
        assert (at is None) == (error is not None)


@pytest.mark.parametrize(
    ("near", "coarser", "radius", "said"),
    [(0.3, 2.0, 5.0, False), (0.8, 2.0, 5.0, True), (0.3, 2.0, 2.0, True)],
)
def test_a_verdict_says_where_elements_are_too_large_for_the_contact_of_a_ball(near, coarser, radius, said):
    study = paper_study()
    study = study.with_values(
        {
            "mechanics": {"mesh": {"near_mm": near}},
            "mismatch": {"coarser": coarser},
            "indenter": {"kind": "sphere", "radius_mm": radius},
        }
    )
    assert bool(large_elements(study)) == said
    flat = {"kind": "cylinder", "radius_mm": radius, "length_mm": 12.0, "edge_radius_mm": 0.5}
    assert not large_elements(study.with_values({"indenter": flat}))
