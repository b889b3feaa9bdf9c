"""`gelforge press`: one indentation with its force-depth table."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gelforge.api.studies import paper_study
from gelforge.cli.study.mesh_quality import mesh_error_words
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
    from rich import box
    from rich.console import Console
    from rich.table import Table

    a, twisted = cell.attributes, "twist_deg" in cell.arrays
    table = Table(
        box=box.SIMPLE,
        padding=(0, 1, 0, 0),  # ten columns in 80 characters
        title=f"Force on the sensor, {study.indenter.words} at ({a['x_mm']:g}, {a['y_mm']:g}) mm",
        caption=f"mesh {study.mechanics.mesh.quality}, {a['degrees_of_freedom']} degrees of freedom, {a['linear_solver']}, "
        f"{a['cpu_seconds']:.1f} CPU s; {mesh_error_words(study)}; mm, N; "
        "± standard deviations of Fz from the mesh and from the constitutive model"
        + ("; Mz torque about the indenter's axis [N mm]" if twisted else ""),
    )
    state, arrays = cell.arrays["node_state"], cell.arrays
    torque = torque_about_centre(arrays) if twisted else None
    last = "steps" if torque is None else "Mz"  # in 80 characters
    for name in (
        "phase",
        "depth",
        "Fx [N]",
        "Fy [N]",
        "Fz [N]",
        "± mesh",
        "± model",
        "touch",
        "slip",
        last,
    ):
        table.add_column(name, justify="right", no_wrap=True)
    bars = [arrays.get(f"total_sigma_{part}_N") for part in ("mesh", "material")]
    for i, (depth, force) in enumerate(zip(cell.arrays["depth_mm"], cell.arrays["total_force_N"])):
        ends = a["iterations"][i] if torque is None else f"{torque[i]:+.3f}"
        table.add_row(
            a["phases"][i],
            f"{depth:.3g}",
            *(f"{value:+.4f}" for value in force),
            *("" if bar is None else f"{bar[i, 2]:.4f}" for bar in bars),
            *(str(count) for count in ((state[i] > 0).sum(), (state[i] == 2).sum(), ends)),
        )
    Console().print(table)


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
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(box=box.SIMPLE, title="Derivatives of the force at the last depth")
    for name in ("effect", "dFx", "dFy", "dFz", "unit", "seconds"):
        table.add_column(name, justify="left" if name in ("effect", "unit") else "right")
    a = cell.attributes
    for name, unit, seconds, force in zip(
        a["sensitivity_names"],
        a["sensitivity_units"],
        a["sensitivity_seconds"],
        cell.arrays["sensitivity_total"][:, -1],
    ):
        table.add_row(str(name), *(f"{value:+.4g}" for value in force), str(unit), f"{seconds:.1f}")
    Console().print(table)
