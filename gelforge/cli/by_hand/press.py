"""`gelforge press`: one indentation with its force-depth table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.api.studies import paper_study
from gelforge.cli.study.mesh_quality import mesh_error_words
from gelforge.cli.tables import print_table
from gelforge.config import Indenter, Study, load_section, load_study
from gelforge.laws_of_study import laws_and_doubts, material_laws_of


def press(
    x: float,
    y: float,
    depths: list[float],
    indenter: Path | None,
    shear: list[float] | None,
    twist: float,
    unload: bool,
    sensitivities: str | None,
    out: Path | None,
    study: Path | None,
    laws: list[Path],
) -> None:
    """Press once, print the force-depth table, and write the cell if asked."""
    from gelforge.indentation.cells.cell_file import CellError, write_cell
    from gelforge.indentation.planning.plan import check_inside, press_path
    from gelforge.indentation.solving.companion import simulate_label
    from gelforge.materials.fitting.stiffness import stiffness_words

    described = described_press(study, indenter)
    if sensitivities:
        names = derivable_effects() if sensitivities == "all" else sensitivities.split(",")
        mechanics = described.mechanics.model_copy(update={"sensitivities": names})
        described = described.model_copy(update={"mechanics": mechanics})
    planned = press_path("press", x, y, depths, shear, unload, twist)
    check_inside({planned.name: planned}, described)
    known = material_laws_of(described, laws)
    for name in dict.fromkeys(layer.material for layer in described.sensor.layers):
        print(f"{name}: {stiffness_words(known[name].law)}")
    cell = simulate_label(described, *laws_and_doubts(known), planned)
    print_force_depth(described, cell)
    if sensitivities and cell.converged:
        print_sensitivities(cell)
    if out is not None:
        write_cell(out, cell)
        print(f"written to {out}")
    if not cell.converged:
        raise CellError(f"the indentation failed: {cell.attributes['reason']}; the depths above are good")


def described_press(study: Path | None, indenter: Path | None) -> Study:
    """Return the study whose sensor and settings are pressed, or the paper's; with another indenter, if one is named."""
    described = load_study(study) if study else paper_study()
    if indenter is None:
        return described
    return described.model_copy(update={"indenter": load_section(indenter, Indenter)})


def print_force_depth(study: Study, cell) -> None:
    """Print force on the sensor and standard deviations of Fz [N], contact nodes and iterations, depth by depth."""
    a, arrays = cell.attributes, cell.arrays
    table = pd.DataFrame({"phase": list(a["phases"]), "depth": arrays["depth_mm"]})
    table[[f"F{axis} [N]" for axis in "xyz"]] = arrays["total_force_N"]
    for part, name in (("mesh", "± mesh"), ("material", "± model")):
        if (bars := arrays.get(f"total_sigma_{part}_N")) is not None:
            table[name] = bars[:, 2]
    state, twisted = arrays["node_state"], "twist_deg" in arrays
    table["touch"], table["slip"] = (state > 0).sum(axis=1), (state == 2).sum(axis=1)
    if twisted:
        table["Mz"] = torque_about_centre(arrays)
    else:
        table["steps"] = a["iterations"]
    signed = dict.fromkeys(("Fx [N]", "Fy [N]", "Fz [N]"), "+.4f")
    print_table(
        table,
        {"depth": ".3g", **signed, "± mesh": ".4f", "± model": ".4f", "Mz": "+.3f"},
        f"Force on the sensor, {study.indenter.words} at ({a['x_mm']:g}, {a['y_mm']:g}) mm",
        f"mesh {study.mechanics.mesh.quality}, {a['degrees_of_freedom']} degrees of freedom, {a['linear_solver']}, "
        f"{a['cpu_seconds']:.1f} CPU s; {mesh_error_words(study)}; mm, N; "
        "± standard deviations of Fz from the mesh and from the constitutive model"
        + ("; Mz torque about the indenter's axis [N mm]" if twisted else ""),
    )


def torque_about_centre(arrays: dict) -> np.ndarray:
    """Return the torque (D,) [N mm] of a cell's forces on the top surface about z through the indenter's centre."""
    force = arrays["node_normal_N"] + arrays["node_shear_N"]
    arm = arrays["node_xy_mm"] + arrays["node_displacement_mm"][..., :2] - arrays["indenter_mm"][:, None, :2]
    return (arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0]).sum(axis=1)


def derivable_effects() -> list[str]:
    """Return the names of the effects with a derivative."""
    from gelforge.indentation.effects.catalogue import CATALOGUE
    from gelforge.indentation.solving.sensitivities import derivable

    return [name for name in CATALOGUE if derivable(name)]


def print_sensitivities(cell) -> None:
    """Print how the force at the last depth follows each effect, and what finding that cost."""
    a = cell.attributes
    table = pd.DataFrame(cell.arrays["sensitivity_total"][:, -1], columns=["dFx", "dFy", "dFz"])
    table.insert(0, "effect", list(a["sensitivity_names"]))
    table["unit"], table["seconds"] = list(a["sensitivity_units"]), a["sensitivity_seconds"]
    formats = dict.fromkeys(("dFx", "dFy", "dFz"), "+.4g") | {"seconds": ".1f"}
    print_table(table, formats, "Derivatives of the force at the last depth")
