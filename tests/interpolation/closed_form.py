"""Sites whose forces are known in closed form: a ball's pressure that grows smoothly with the place, and friction."""

import json
from functools import cache

import numpy as np
import specimens

from gelforge.config import study_from
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.planning.lattice import Lattice
from gelforge.interpolation.nodal_forces import NodalForces
from gelforge.interpolation.solved_sites import SolvedSites
from gelforge.mechanics.laws.models.ogden import Ogden

LAWS = {"gel": Ogden((0.008,), (2.0,))}
RADIUS, SIZE = 5.0, 0.25  # of the ball, and between nodes [mm]
DEPTHS = (0.5, 0.8, 1.1, 1.4, 1.7, 2.0)
LATTICE = Lattice((6.0, 6.0), (26.0, 26.0), (4, 4), DEPTHS, 32.0)
STUDY = study_from(
    specimens.BETWEEN
    | {
        "plan": {
            "grid": {"spacing_mm": 1.0, "margin_mm": 6.0},
            "depths_mm": list(DEPTHS),
            "interpolation": {"tolerance": 0.5},
        },
    }
)


def stiffer(position):
    """Return how much larger forces are at a position, the same from all sides of the square."""
    away = (np.asarray(position) - 16.0) / 16.0
    return 1 + 0.3 * (away**2).sum() + 0.2 * (away[0] * away[1]) ** 2


def pull(position):
    """Return the horizontal force over the vertical one (2,) at a position: away from the middle."""
    return 0.1 * (np.asarray(position) - 16.0) / 16.0


def site(name, position, depths=DEPTHS, sigma=1e-4, shift=(0.0, 0.0)) -> Cell:
    """Return a solved cell at a position (2,): Hertz's pressure on nodes that lie shifted by (2,) [mm] from the ball."""
    position = np.asarray(position, float)
    along = np.arange(-24, 25) * SIZE
    node = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2) + shift
    normal = np.zeros((len(depths), len(node), 3))
    for d, depth in enumerate(depths):
        a2 = depth * (2 * RADIUS - depth)
        pressure = np.sqrt(np.maximum(1 - (node**2).sum(axis=1) / a2, 0.0)) * np.sqrt(depth)
        normal[d, :, 2] = -0.01 * SIZE**2 * pressure * stiffer(position)
        normal[d, :, :2] = -normal[d, :, 2:] * pull(position)
    shear = np.zeros_like(normal)
    shear[..., :2] = -0.3 * normal[..., 2:] * pull(position)
    arrays = {
        "depth_mm": np.array(depths),
        "shear_mm": np.zeros((len(depths), 2)),
        "tilt_deg": np.zeros((len(depths), 2)),
        "node_xy_mm": node + position,
        "node_area_mm2": np.full(len(node), SIZE**2),
        "node_normal_N": normal,
        "node_shear_N": shear,
        "node_state": np.ones(normal.shape[:2], np.int8),
        "node_displacement_mm": np.zeros(normal.shape, np.float32),
        "indenter_mm": np.column_stack([np.tile(position, (len(depths), 1)), RADIUS - np.array(depths)]),
    }
    attributes = {"cell": name, "x_mm": position[0], "y_mm": position[1], "status": "converged", "reason": ""}
    nodal = NodalForces.of(Cell(arrays, attributes))
    bins = nodal.binned(position, STUDY.sensor).reshape(len(depths), -1, 6)
    force = bins[..., :3] + bins[..., 3:]
    arrays |= {
        "bin_normal_N": bins[..., :3],
        "bin_shear_N": bins[..., 3:],
        "bin_force_N": force,
        "total_force_N": force.sum(axis=1),
        "reaction_N": force.sum(axis=1),
        "side_force_N": np.zeros((len(depths), 3)),
    }
    loaded = (np.abs(force).max(axis=-1, keepdims=True) > 0) * np.ones(3)
    for part in ("mesh", "material"):
        arrays |= {
            f"bin_sigma_{part}_N": sigma * loaded,
            f"total_sigma_{part}_N": np.full((len(depths), 3), 5 * sigma),
        }
    known = {
        "inputs_digest": "",
        "code_version": "",
        "source": "",
        "last_good_depth_mm": depths[-1],
        "settings": json.dumps({"sensor": STUDY.sensor.model_dump(mode="json")}),
        "regions": ["gel"],
        "touched_parts": [True],
        "volume_outside_valid_range": np.zeros((len(depths), 1)),
    }
    return Cell(arrays, attributes | known)


@cache
def solved(level=1) -> SolvedSites:
    """Return a level's sites, made once."""
    return anew(level)


def anew(level=1, lattice=LATTICE, failed=(), between_depths=False, **keys) -> SolvedSites:
    """Return a level's sites in closed form; failed: places that did not converge."""
    from gelforge.indentation.planning.lattice import name_of

    cells = {
        at: site(name_of(at), lattice.place(at), lattice.depths_mm, **keys)
        for at in lattice.representatives(lattice.level(level))
    }
    for at in failed:
        cells[at] = Cell({}, cells[at].attributes | {"status": "failed", "reason": "no balance"})
    return SolvedSites(lattice, STUDY.sensor, STUDY.indenter, cells, between_depths)
