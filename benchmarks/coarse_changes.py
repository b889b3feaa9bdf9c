"""By how much the change of a force errs on coarse meshes: a compliant frame, three places, four depths. SYNTHETIC.

usage: python benchmarks/coarse_changes.py      (one thread; a minute)

A block of 16 x 16 x 4 mm is pressed by a ball of 4 mm whose frame yields by 0.06 mm per newton. Printed is the root mean
square error of the relative change of Fz against the finest mesh, by the element under the contact over the ball's radius.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

from gelforge.config import study_from  # noqa: E402
from gelforge.config.basis.variants import merged  # noqa: E402
from gelforge.indentation.paths.planned_cell import PlannedCell  # noqa: E402
from gelforge.indentation.solving.simulate import simulate_cell  # noqa: E402
from gelforge.laws_of_study import laws_of  # noqa: E402

NEAR_MM = (0.4, 0.6, 0.8, 0.96, 1.2, 1.6, 2.0)  # the first is the reference
PLACES = ((5.0, 5.0), (5.0, 8.0), (8.0, 8.0))
DEPTHS = (0.3, 0.6, 0.9, 1.2)
FRAME = {"kinematics": {"frame_compliance_mm_per_N": 0.06}}
BLOCK = {
    "study": "coarse_changes",
    "materials": {"gel": {"parameters": {"law": "neo_hooke", "mu_kPa": 30}}},
    "sensor": {
        "width_x_mm": 16,
        "width_y_mm": 16,
        "wall_mm": 0,
        "layers": [{"name": "gel", "thickness_mm": 4, "material": "gel"}],
        "bins": {"nx": 8, "ny": 8},
    },
    "indenter": {"kind": "sphere", "radius_mm": 4},
    "plan": {"grid": {"spacing_mm": 3.0, "margin_mm": 5.0}, "depths_mm": list(DEPTHS)},
    "sessions": [],
}


def vertical(near: float, effects: dict) -> np.ndarray:
    """Return Fz (places, depths) [N] on a mesh, with effects."""
    mesh = {"near_mm": near, "near_radius_mm": 2.5 * near, "far_mm": 2.5 * near}
    study = study_from(merged(BLOCK, {"mechanics": {"error_bars": False, "mesh": mesh, "effects": effects}}))
    laws = laws_of(study, [])
    cells = (simulate_cell(study, laws, PlannedCell("place", *place, DEPTHS)) for place in PLACES)
    return np.array([cell.arrays["total_force_N"][:, 2] for cell in cells])


def main() -> None:
    changes = {near: vertical(near, FRAME) / vertical(near, {}) - 1 for near in NEAR_MM}
    finest = changes[NEAR_MM[0]]
    rows = [
        (near, near / BLOCK["indenter"]["radius_mm"], 100 * np.sqrt(np.mean((change / finest - 1) ** 2)))
        for near, change in changes.items()
    ]
    print(
        pd.DataFrame(rows, columns=["near [mm]", "over the radius", "error of the change [%]"]).to_markdown(
            index=False
        )
    )


if __name__ == "__main__":
    main()
