"""Sites of the virtual sensor: its true physics, on a mesh of its own, loading and unloading."""

from __future__ import annotations

from gelforge.config import Study, VirtualLab
from gelforge.files import digest, source_digest
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.solving.simulate import simulate_trajectory
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.virtual_lab.particles import VirtualLabError


def true_laws(study: Study, lab: VirtualLab) -> dict[str, PrincipalLaw]:
    """Return the laws of the virtual sensor by layer [MPa]: those of its coupons times the concealed factor."""
    laws: dict[str, PrincipalLaw] = {}
    for layer in study.sensor.layers:
        coupon = lab.materials[layer.material]
        factor = 1e-3 * lab.stiffness_scale.get(layer.name, 1.0)
        laws[layer.name] = Ogden(tuple(factor * mu for mu in coupon.ogden_mu_kPa), tuple(coupon.alpha))
    return laws


def simulate_truth_cell(study: Study, lab: VirtualLab, planned: PlannedCell) -> Cell:
    """Return the site of the virtual sensor, gel displacement included: after the plan's depths it is unloaded, a path is
    followed as planned.

    Parameters
    ----------
    study : Study
        Sensor and indenter.
    lab : VirtualLab
        The true mechanics.
    planned : PlannedCell
        The site.

    Returns
    -------
    Cell
        SYNTHETIC forces [N] and displacements [mm].

    Raises
    ------
    VirtualLabError
        For a site that cannot be recorded.
    """
    check_recordable(planned)
    trajectory = Trajectory.of(planned) if planned.follows_a_path else _down_and_up(lab, planned)
    mechanics = lab.mechanics.model_copy(update={"store_displacement": True})
    cell = simulate_trajectory(study.sensor, study.indenter, mechanics, true_laws(study, lab), trajectory)
    return Cell(cell.arrays, cell.attributes | {"cell": planned.name, "synthetic": True})


def _down_and_up(lab: VirtualLab, planned: PlannedCell) -> Trajectory:
    deepest = planned.depths_mm[-1]
    unload = tuple(depth for depth in sorted(lab.unload_depths_mm, reverse=True) if depth < deepest)
    phases = ("load",) * len(planned.depths_mm) + ("unload",) * len(unload)
    return Trajectory(planned.x_mm, planned.y_mm, planned.depths_mm + unload, phases)


COURSE = ("load", "shear", "unload")  # of an indentation that a recording can show


def check_recordable(planned: PlannedCell) -> None:
    """Refuse a path that no indentations.csv can show: it turns nothing, and has one order of phases.

    Parameters
    ----------
    planned : PlannedCell
        The site.

    Raises
    ------
    VirtualLabError
        Names the site and what its path has.
    """
    moves = [phase for phase in planned.phases if phase != "dwell"]
    others = sorted(set(moves) - set(COURSE))
    down = [depth for depth, phase in zip(planned.depths_mm, planned.phases) if phase == "load"]
    if others or any(map(any, planned.tilts_deg)) or any(planned.twists_deg):
        why = f"has phases {others or ['tilt or twist']}; recordings hold depth and position only"
    elif moves != sorted(moves, key=COURSE.index):
        why = f"has phases in the order {', '.join(dict.fromkeys(moves))}; a recorded indentation runs load, shear, unload"
    elif planned.phases and (not down or any(b <= a for a, b in zip(down, down[1:]))):
        why = f"is loaded to {down} mm in turn; these must increase"
    else:
        return
    raise VirtualLabError(
        f"site {planned.name}: its path {why}: the virtual lab cannot record it; change the path or leave it out of the plan"
    )


def truth_digest(study: Study, lab: VirtualLab, planned: PlannedCell) -> str:
    """Return the digest of everything that decides a site of the virtual sensor.

    Parameters
    ----------
    study : Study
        Sensor and indenter.
    lab : VirtualLab
        Its physics.
    planned : PlannedCell
        The site.

    Returns
    -------
    str
        SHA-256 in hexadecimal.
    """
    models = {"sensor": study.sensor, "indenter": study.indenter, "lab": lab}
    path = ("name", "x_mm", "y_mm", "depths_mm", "phases", "shears_mm")
    return digest(
        {name: model.model_dump(mode="json") for name, model in models.items()}
        | {
            "cell": [getattr(planned, name) for name in path],
            "sources": source_digest("mechanics", "meshing", "indentation", "virtual_lab/truth.py"),
        }
    )
