"""Commands for one's own hands: one press, predictions of images, and the kernels compiled beforehand."""

from __future__ import annotations

import csv
import math
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gelforge.api.studies import paper_study
from gelforge.config import Indenter, Study, load_camera, load_section, load_study
from gelforge.laws_of_study import laws_and_doubts, laws_of, material_laws_of
from gelforge.progress import tracked

if TYPE_CHECKING:
    from gelforge.indentation.cells.cell_file import Cell


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


def mesh(x: float, y: float, depth: float, indenter: Path | None, out: Path, study: Path | None) -> None:
    """Write the undeformed mesh on which a press at this place and depth is solved; print which number is which region."""
    from gelforge.indentation.paths.trajectory import Trajectory
    from gelforge.indentation.planning.plan import check_inside, press_path
    from gelforge.indentation.solving.simulate import meshes_of, shape_of
    from gelforge.meshing.tetrahedra import write_mesh

    described = described_press(study, indenter)
    planned = press_path("press", x, y, [depth], None, False)
    check_inside({planned.name: planned}, described)
    described.mechanics.effects.check(described.sensor)
    shape, trajectory = shape_of(described.indenter), Trajectory.of(planned, described.plan.approach)
    _, made = meshes_of(described.sensor, shape, described.mechanics, trajectory)
    write_mesh(out, made)
    for number, name in enumerate(made.regions):
        print(f"region {number}: {name}, {(made.region == number).sum()} elements")
    print(f"{len(made.X)} nodes, written to {out}")


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
        caption=f"{a['degrees_of_freedom']} degrees of freedom, {a['linear_solver']}, {a['seconds']:.1f} s; mm, N; "
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
        "± constitutive model",
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


WARM_UP = 10  # frames whose times are not counted


def predict(
    source: str,
    model: Path,
    reference: Path | None,
    crop: list[int] | None,
    camera: Path | None,
    plane_z_mm: float | None,
    out: Path | None,
    frames: int | None,
) -> None:
    """Print the total force of each frame, write the distributions, and print how long each step took."""
    from itertools import islice

    from gelforge.learning.deployment.predictor import Predictor, Timing, predict_frames
    from gelforge.recording.imaging.flow import read_grey
    from gelforge.recording.imaging.frames import frames as frames_of

    zero = read_grey(reference) if reference else None
    timing = Timing(WARM_UP)
    seen_by = load_camera(camera) if camera else None
    predictions = predict_frames(Predictor(model), frames_of(source), zero, crop, seen_by, plane_z_mm)
    predictions = islice(predictions, frames)
    flagged = []
    with distribution_table(out) as write:
        for prediction in tracked(predictions, f"frames of {source}", frames):
            timing.add(prediction)
            write(prediction)
            flagged.append(prediction.unlike > 1)
    if any(flagged):
        print(
            f"{sum(flagged)} of {len(flagged)} frames are unlike those that the model learnt from: distrust their forces "
            "(another camera, gel or contact? docs/learning.md)"
        )
    print_timing(timing)


@contextmanager
def distribution_table(path: Path | None):
    """Yield a function that writes a prediction as a row: name, time, total force, then every bin's force [N].

    Rows are written as they come, so that a live run that is interrupted keeps what it has seen; without a path the
    total force is printed instead. A time or a measure of unlikeness that is not known is left empty.
    """
    if path is None:
        yield lambda p: print(
            f"{p.name}  F = " + "  ".join(f"{f:+.3f}" for f in p.force_N.sum(axis=0)) + " N"
        )
        return
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)

        def write(p) -> None:
            if file.tell() == 0:
                bins = [f"f{axis}_{k}_N" for k in range(len(p.force_N)) for axis in "xyz"]
                rows.writerow(["frame", "time_s", "unlike", "fx_N", "fy_N", "fz_N", *bins])
            values = [*p.force_N.sum(axis=0), *p.force_N.ravel()]
            seconds = f"{p.time_s:.6f}" if math.isfinite(p.time_s) else ""
            unlike = f"{p.unlike:.3g}" if math.isfinite(p.unlike) else ""
            rows.writerow([p.name, seconds, unlike, *(f"{value:.6g}" for value in values)])

        yield write


def print_timing(timing) -> None:
    """Print p50, p95 and p99 of every step [ms] and the frames per second that they allow."""
    from rich.console import Console
    from rich.table import Table

    counted = max(timing.seen - timing.warm_up, 0)
    told = f"{counted} frames, after the first {timing.warm_up}, which are not counted"
    if not counted:
        print(f"no times: {timing.seen} frames, and the first {timing.warm_up} are not counted")
        return
    table = Table(title=f"time per frame ({told})")
    for name in ("step", "p50, ms", "p95, ms", "p99, ms", "frames/s at p50", "frames/s at p99"):
        table.add_column(name, justify="right")
    for row in timing.table().itertuples(index=False):
        times = (f"{value:.2f}" for value in (row.p50_ms, row.p95_ms, row.p99_ms))
        table.add_row(row.step, *times, f"{row.fps_at_p50:.0f}", f"{row.fps_at_p99:.0f}")
    Console().print(table)


def verify(out: Path | None, only: list[str] | None) -> None:
    """Run checks of the finite elements, all if none is named, print and write the table; fail beyond a limit."""
    from gelforge.files import write_table
    from gelforge.verification.check import VerificationFailed, check_table
    from gelforge.verification.run import CHECKS, run_checks

    if unknown := set(only or []) - set(CHECKS):
        raise VerificationFailed(f"--only {', '.join(sorted(unknown))}: the checks are {', '.join(CHECKS)}")
    checks = []
    for check in run_checks(only or list(CHECKS)):
        checks.append(check)
        print(
            f"{'ok' if check.passed else 'FAILED':8}{check.quantity}: {check.found:.6g}, error {check.error:.1e}"
        )
    if out is not None:
        write_table(out, "verification", check_table(checks))
    failed = [f"{c.quantity} (error {c.error:.1e}, limit {c.limit:.1e})" for c in checks if not c.passed]
    if failed:
        raise VerificationFailed(f"{len(failed)} of {len(checks)} checks failed: {'; '.join(failed)}")


def warm_up() -> None:
    """Compile every kernel by tiny presses; later runs load them from the cache."""
    for strain in ("finite", "small"):
        cell = tiny_press(strain)
        print(f"{strain} strain: {cell.attributes['linear_solver']}, {cell.attributes['seconds']:.1f} s")


def tiny_press(strain: str) -> Cell:
    """Return the solution of a press on a coarse mesh, which compiles or loads the kernels and the direct solver."""
    from gelforge.config import Mesh
    from gelforge.indentation.paths.planned_cell import PlannedCell
    from gelforge.indentation.solving.simulate import simulate_cell

    study = paper_study()
    coarse = Mesh(near_mm=2.0, near_radius_mm=2.0, far_mm=4.0)
    mechanics = study.mechanics.model_copy(update={"mesh": coarse, "strain": strain})
    tiny = study.model_copy(update={"mechanics": mechanics})
    return simulate_cell(tiny, laws_of(study, []), PlannedCell("warm_up", 16.0, 16.0, (0.5,)))
