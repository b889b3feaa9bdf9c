"""A truth cell with a closed-form displacement, and a small study around it: for tests of what reads truth cells."""

import numpy as np

from gelforge.config import VirtualLab, study_from
from gelforge.indentation.cells.cell_file import Cell

DEPTHS, UNLOAD = [0.5, 1.0], [0.6]


def small_study(positions=3, spacing=6.0):
    """Return a study of positions x positions cells on the paper's sensor."""
    margin = (32 - spacing * (positions - 1)) / 2
    return study_from(
        {
            "study": "small",
            "materials": {"soft": {"parameters": {"mu_kPa": [10.0], "alpha": [2.0]}}},
            "sensor": {
                "layers": [
                    {
                        "name": "gel",
                        "thickness_mm": 4.5,
                        "material": "soft",
                        "particle_volume_fraction": 0.0196,
                    },
                    {"name": "skin", "thickness_mm": 1.5, "material": "soft"},
                ]
            },
            "plan": {
                "grid": {"spacing_mm": spacing, "margin_mm": margin},
                "depths_mm": DEPTHS,
                "symmetry": "d4",
            },
            "features": {"regions": 20},
        }
    )


def small_lab():
    """Return a virtual lab of two sessions, whose stages and force sensors stand differently."""
    return VirtualLab.model_validate(
        {
            "serial": "virtual-x",
            "materials": {"soft": {"mu_kPa": [10.0], "alpha": [2.0]}},
            "stiffness_scale": {"gel": 1.123},
            "unload_depths_mm": UNLOAD,
            "particles": {"diameter_mm": 0.6},
            "camera": {
                "width_px": 200,
                "height_px": 160,
                "focal_px": 200.0,
                "centre_px": [99.5, 79.5],
                "position_mm": [16.0, 16.0, -46.0],
            },
            "imaging": {"images_per_press": 2},
            "sessions": [
                {
                    "session": "one",
                    "date": "2024-01-01",
                    "share": 0.6,
                    "seed": 1,
                    "axes": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
                    "stage_to_sensor": {"origin_mm": [16.0, 16.0], "rotation_deg": 90.0},
                },
                {
                    "session": "two",
                    "date": "2024-01-02",
                    "share": 0.4,
                    "seed": 2,
                    "acts_on": "sensor",
                    "stage_to_sensor": {"origin_mm": [0.0, 32.0], "handedness": "left"},
                },
            ],
        }
    )


def displacement_per_mm(X, x, y):
    """Return the displacement (N, 3) [mm] of points X (N, 3) per mm of depth at (x, y): outwards and down, 0 at the base."""
    r = X[:, :2] - [x, y]
    bell = np.exp(-(r**2).sum(axis=1) / (2 * 4.0**2)) * (X[:, 2] + 6) / 4.5
    return np.concatenate([0.12 * r * bell[:, None], -0.7 * bell[:, None]], axis=1)


def force_at(depth, x, y):
    """Return the force (D, 3) [N] at depths (D,): down, and sideways towards the nearer wall."""
    return np.stack(
        [0.05 * depth * np.sign(x - 16), 0.03 * depth * np.sign(y - 16), -0.25 * depth**1.5], axis=1
    )


def bins_at(depth, x, y, bins=20):
    """Return the force per bin (D, B, 3) [N]: three quarters in the bin under (x, y), the rest in the next along x."""
    k = int(y / 32 * bins) * bins + int(x / 32 * bins)
    force = np.zeros((len(depth), bins * bins, 3))
    force[:, k], force[:, k + 1] = 0.75 * force_at(depth, x, y), 0.25 * force_at(depth, x, y)
    return force


def gel_mesh(elements=(24, 24, 6)):
    """Return nodes (G, 3) and hexahedra (E, 8) of a graded grid over the paper's gel."""
    lines = [1.5 + 29 * np.linspace(0, 1, n + 1) ** 1.1 for n in elements[:2]]
    lines.append(-6 + 4.5 * np.linspace(0, 1, elements[2] + 1) ** 0.9)
    x, y, z = np.meshgrid(*lines, indexing="ij")
    node = np.arange(x.size).reshape(x.shape)
    corner = [(i, j, k) for k in (0, 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    nx, ny, nz = elements
    hexahedra = np.stack([node[i : nx + i, j : ny + j, k : nz + k].ravel() for i, j, k in corner], axis=1)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), hexahedra


def truth_cell(name, x, y, **attributes):
    """Return a truth cell at (x, y) with loading and unloading depths."""
    nodes, hexahedra = gel_mesh()
    depth = np.array(DEPTHS + UNLOAD)
    moved = depth[:, None, None] * displacement_per_mm(nodes, x, y)
    arrays = {
        "depth_mm": depth,
        "total_force_N": force_at(depth, x, y),
        "bin_force_N": bins_at(depth, x, y),
        "gel_node_mm": nodes,
        "gel_hex": hexahedra,
        "gel_displacement_mm": moved.astype(np.float32),
    }
    phases = ["load"] * len(DEPTHS) + ["unload"] * len(UNLOAD)
    return Cell(arrays, {"cell": name, "status": "converged", "reason": "", "phases": phases} | attributes)
