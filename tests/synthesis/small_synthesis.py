"""A small study with a simulated training set on a coarse mesh."""

import numpy as np

from gelforge.config import study_from
from gelforge.indentation.cells.cell_file import Cell
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.virtual_lab.particles import interpolation

LAWS = {"soft": Ogden((0.01,), (2.0,))}
CAMERA = {
    "width_px": 200,
    "height_px": 200,
    "focal_px": 272.0,
    "centre_px": [99.5, 99.5],
    "position_mm": [16.0, 16.0, -46.0],
}
LAYERS = [
    {"name": "gel", "thickness_mm": 4.5, "material": "soft", "particle_volume_fraction": 0.0196},
    {"name": "skin", "thickness_mm": 1.5, "material": "soft"},
]


def study_of(**synthesis):
    """Return the study; synthesis: keys of the training set that differ."""
    settings = {"camera": CAMERA, "particles": {"diameter_mm": 0.6}, "steps": 2}
    return study_from(
        {
            "study": "small",
            "materials": {"soft": {"parameters": {"mu_kPa": [10.0], "alpha": [2.0]}}},
            "sensor": {"layers": LAYERS},
            "plan": {"grid": {"spacing_mm": 6.0, "margin_mm": 10.0}, "depths_mm": [0.5, 1.0]},
            "mechanics": {"mesh": {"near_mm": 1.2, "near_radius_mm": 5.0, "far_mm": 3.2}},
            "features": {"regions": 20},
            "synthesis": settings | synthesis,
        }
    )


def place_of(cell: Cell) -> np.ndarray:
    """Return where a solved press touches (2,) [mm]."""
    return np.array([cell.attributes["x_mm"], cell.attributes["y_mm"]])


def motion(cell: Cell, step: int, particles: np.ndarray) -> np.ndarray:
    """Return the displacement (n, 3) [mm] of particles (n, 3) at a step of a solved press, by its elements."""
    weights = interpolation(cell.arrays["gel_node_mm"], cell.arrays["gel_hex"], particles)
    return weights @ cell.arrays["gel_displacement_mm"][step].astype(float)
