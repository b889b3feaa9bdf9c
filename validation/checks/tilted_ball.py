"""The sideways force of a tilted sensor by FElupe and by gelforge, in both frames of a force sensor.

usage: python -m validation.checks.tilted_ball [--degrees 2] [--friction 0.3]

Solves one press of the wide sensor by each code, some minutes in all. Prints the sideways force over the pressing force and
the tilt's angle: in the sensor's axes, and in the stage's, turned by the rotation's matrix.
"""

from __future__ import annotations

import argparse

import felupe as fem
import numpy as np

from gelforge.config import load_study, study_from
from gelforge.config.basis.variants import merged
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mismatch.pipeline.stage import laws_and_doubts, material_laws_of
from validation.pressed import ITERATIONS, MIDDLE, TOLERANCE, Setup, _Model
from validation.sets import CONFIG

DEPTHS = (0.3, 0.6, 0.9, 1.2)
SIZES = {"near_mm": 0.25, "far_mm": 1.0}
BESIDE = 1e-6  # mm from the middle: there FElupe's model would be halved along x


class Slanted(_Model):
    """FElupe's model whose ball comes down at an angle [rad] about y to the surface's normal."""

    def __init__(self, setup: Setup, angle: float):
        super().__init__(setup)
        self.along = np.array([np.sin(angle), 0.0, -np.cos(angle)])

    def _newton(self, depth: float) -> int:
        items = [*self.solids, self.ball]
        values = np.zeros((self.mesh.npoints, 3))
        values[-1] = self.along * depth
        for item in items:
            item.field.link(self.field)
        found = fem.newtonraphson(
            x0=self.field, items=items, dof0=self.held, dof1=self.free, ext0=values.ravel()[self.held],
            tol=TOLERANCE, maxiter=ITERATIONS, verbose=0, solver=self.solve,
        )  # fmt: skip
        self.field[0].values[:] = found.x[0].values
        return found.iterations


def by_felupe(angle: float, friction: float) -> np.ndarray:
    """Return the force (D, 3) [N] on the sensor in its own axes; it is turned by an angle [rad] about y."""
    wide = Setup(
        BESIDE, 0.0, DEPTHS, MIDDLE, 3.0, 0.5, 4.0, friction=friction, tangential=400.0, width_mm=32.0
    )
    model, forces = Slanted(wide, angle), []
    for depth in DEPTHS:
        model.go_to(depth)
        forces.append(model.force())
    return np.array(forces)


def by_gelforge(angle: float, friction: float) -> np.ndarray:
    """Return the same by the study's own finite elements."""
    study = load_study(CONFIG / "wide.yaml")
    keys = {
        "friction": friction, "mesh": SIZES, "error_bars": False,
        "effects": {"kinematics": {"tilt_deg": [0.0, float(np.degrees(angle))]}},
    }  # fmt: skip
    tilted = study_from(
        merged(study.model_dump(mode="json"), {"mechanics": keys, "plan": {"symmetry": "none"}})
    )
    laws = laws_and_doubts(material_laws_of(study, []))[0]
    return simulate_cell(tilted, laws, PlannedCell("", 16.0, 16.0, DEPTHS)).arrays["total_force_N"]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--degrees", type=float, default=2.0)
    parser.add_argument("--friction", type=float, nargs="+", default=[0.0, 0.3])
    asked = parser.parse_args()
    angle = np.radians(asked.degrees)
    about_y = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    print(f"Fx over Fz and the angle, at depths {DEPTHS} mm")
    for friction in asked.friction:
        for code, solve in (("gelforge", by_gelforge), ("FElupe", by_felupe)):
            force = solve(angle, friction)
            for frame, F in (("sensor", force), ("stage", force @ about_y.T)):
                share = F[:, 0] / F[:, 2] / angle
                print(
                    f"friction {friction:g}, {frame:6}, {code:8}: {' '.join(f'{s:+.3f}' for s in share)}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
