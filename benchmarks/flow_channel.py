"""Concealed cases with images: what the flow adds to the forces.

A small sensor of the virtual lab on a mesh of its own, with images of 400 x 400 px; its particles are smaller, blurred
more and placed otherwise than the analysis assumes. Kinds and amounts are drawn by a seed: the gel's stiffness alone and the
force sensor's gain, which forces part badly, effects of the camera, and nothing. Each is judged with and without images.

usage: python benchmarks/flow_channel.py [--seed 2026] [--other] [--kept FOLDER] [--only N ...]      (one thread)
--other: images by another renderer (other_renderer.py), with specks of many sizes and a lens that distorts.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from other_renderer import instead_of_the_virtual_labs

from gelforge.config import Camera, Study, VirtualLab, load_session, study_from, write_yaml
from gelforge.config.parts.mechanics import Mesh
from gelforge.indentation.cells.cell_file import write_cell
from gelforge.indentation.planning.plan import plan_cells
from gelforge.laws_of_study import laws_and_doubts, material_laws_of
from gelforge.mismatch.fem.nominal import observations_of, problem_of
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.images.flow import with_flow
from gelforge.mismatch.inference.judge import Judgement, judge
from gelforge.mismatch.summary.sections import after_of, flow_section
from gelforge.virtual_lab.session import make_session
from gelforge.virtual_lab.truth import simulate_truth_cell

CAMERA = {
    "width_px": 400, "height_px": 400, "focal_px": 480.0, "centre_px": [199.5, 199.5], "position_mm": [8.0, 8.0, -20.0],
}  # fmt: skip
SOFT, STIFF = (
    {"mu_kPa": [7.9652, 0.3093], "alpha": [1.2769, 3.5676]},
    {"mu_kPa": [85.1168, -0.0020], "alpha": [2.8991, -8.2915]},
)
LOCATED = [
    "delamination",
    "void",
    "inclusion",
]  # many places, each with its own solution; not what is asked here
STIFFNESSES = (0.4, 0.8, -0.35)  # of the gel; few, as each needs true cells of its own
KINDS = (
    ("gel_stiffness",) * 3 + ("force_gain",) * 3 + ("camera_scale",) * 2 + ("camera_pose",) * 2 + ("nothing",)
)


@dataclass(frozen=True)
class Case:
    """What is concealed."""

    kind: str
    amount: float
    gel: float  # factor on the gel's stiffness
    gain: tuple[float, float, float]
    camera: dict


def small_study() -> Study:
    """Return the study: a block of 16 mm, pressed at nine places to four depths."""
    return study_from(
        {
            "study": "flow",
            "materials": {"soft": {"parameters": SOFT}, "stiff": {"parameters": STIFF}},
            "sensor": {
                "width_x_mm": 16.0,
                "width_y_mm": 16.0,
                "layers": [
                    {
                        "name": "gel",
                        "thickness_mm": 3.0,
                        "material": "soft",
                        "particle_volume_fraction": 0.02,
                    },
                    {"name": "skin", "thickness_mm": 1.0, "material": "stiff"},
                ],
                "wall_mm": 1.0,
                "bins": {"nx": 10, "ny": 10},
            },
            "plan": {
                "grid": {"spacing_mm": 3.0, "margin_mm": 5.0},
                "depths_mm": [0.4, 0.7, 1.0, 1.3],
                "symmetry": "d4",
            },
            "mechanics": {"mesh": {"near_mm": 0.4, "near_radius_mm": 2.5, "growth": 0.3, "far_mm": 0.8}},
            "mismatch": {
                "leave_out": LOCATED,
                "draws": 1000,
                "images": "fitted",
            },
        }
    )


TRUE_MESH = Mesh(near_mm=0.35, near_radius_mm=2.5, growth=0.3, far_mm=0.7)


def lab_of(case: Case, seed: int, mesh: Mesh = TRUE_MESH) -> VirtualLab:
    """Return the virtual lab of a case."""
    return VirtualLab(
        serial=f"flow-{seed}",
        materials={"soft": SOFT, "stiff": STIFF},
        stiffness_scale={"gel": case.gel},
        mechanics={"mesh": mesh},
        unload_depths_mm=[],
        particles={"diameter_mm": 0.27, "volume_fraction": 0.02},
        camera=CAMERA | case.camera,
        imaging={"blur_px": 0.9, "noise_grey": 2.5, "particle_grey": 220.0, "background_grey": 20.0},
        force={"noise_N": [0.004, 0.004, 0.008], "resolution_N": [0.01, 0.01, 0.02]},
        sessions=[{"session": "s1", "date": "2024-01-01", "share": 1.0, "seed": seed, "acts_on": "sensor"}],
    )


def drawn_cases(seed: int) -> list[Case]:
    """Return the cases in an order and with amounts drawn by the seed."""
    rng = np.random.default_rng(seed)
    cases, stiffness = [], list(rng.permutation(STIFFNESSES))
    for kind in rng.permutation(KINDS):
        sign = rng.choice([-1.0, 1.0])
        gel, gain, camera, amount = 1.0, (0.0, 0.0, 0.0), {}, 0.0
        if kind == "gel_stiffness":
            amount = stiffness.pop()
            gel = 1 + amount
        elif kind == "force_gain":
            amount = sign * rng.uniform(0.10, 0.15)  # of a plausible 0.05
            gain = (amount, amount, amount)
        elif kind == "camera_scale":
            amount = sign * rng.uniform(0.03, 0.05)  # of a plausible 0.02
            camera = {"focal_px": CAMERA["focal_px"] * (1 + amount)}
        elif kind == "camera_pose":
            amount = sign * rng.uniform(0.5, 1.0)  # mm along x, of a plausible 0.5
            camera = {"position_mm": [8.0 + amount, 8.0, -20.0]}
        cases.append(Case(str(kind), float(amount), float(gel), gain, camera))
    return cases


def record(case: Case, study: Study, seed: int, kept: Path, out: Path, mesh: Mesh = TRUE_MESH) -> Path:
    """Write the session of a case; true cells are solved once per stiffness."""
    lab, cells = lab_of(case, seed, mesh), plan_cells(study)
    truth = kept / f"truth_{case.gel:g}"
    for cell in cells.values():
        path = truth / f"{cell.name}.h5"
        if cell.source is None and not path.is_file():
            write_cell(path, simulate_truth_cell(study, lab, cell))
    folder = out / "s1"
    make_session(lab, lab.sessions[0], study, cells, truth, folder)
    described = load_session(folder / "session.yaml")
    write_yaml(  # the session states the nominal camera
        folder / "session.yaml",
        described.model_copy(update={"camera": Camera(**CAMERA), "base_parameters": "exact"}),
    )
    if any(case.gain):
        table = pd.read_csv(folder / "indentations.csv", keep_default_na=False)
        for name, gain in zip(("fx_N", "fy_N", "fz_N"), case.gain):
            table[name] = (table[name].astype(float) * (1 + gain)).round(9)
        table.to_csv(folder / "indentations.csv", index=False)
    return folder


def groups(judgement: Judgement) -> str:
    """Return what the answer names: members of a group with `or`, what acts together with `and`."""
    if judgement.answer is None:
        return ""
    return " and ".join(" or ".join(one.names) for one in judgement.answer.groups)


def judged(folder: Path, study: Study, kept: Path, images: bool):
    """Return judgement and flow section of a session, with its images or without."""
    laws, _ = laws_and_doubts(material_laws_of(study, []))
    solver = Solver(study, laws, {}, kept / "solves")
    observations, _ = observations_of([folder], study)
    problem, base = problem_of(solver, observations)
    if images:
        problem = with_flow(solver, base, problem, [folder])
    judgement = judge(problem, study.mismatch, study.seed)
    section = flow_section(problem, judgement, after_of(problem, judgement))
    return judgement, section, problem


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument(
        "--kept", type=Path, help="folder for solutions and true cells; a temporary one if left out"
    )
    parser.add_argument("--other", action="store_true", help="images by another renderer")
    parser.add_argument("--only", type=int, nargs="+", help="numbers of the only cases to judge")
    arguments = parser.parse_args()
    study = small_study()
    with tempfile.TemporaryDirectory() as temporary:
        kept = arguments.kept or Path(temporary) / "kept"
        print("| case | concealed | amount | forces alone | with images | p of the flow | rmse [px] | s |")
        print("|---|---|---|---|---|---|---|---|")
        for number, case in enumerate(drawn_cases(arguments.seed)):
            if arguments.only and number not in arguments.only:
                continue
            with instead_of_the_virtual_labs() if arguments.other else nullcontext():
                folder = record(case, study, arguments.seed + number, kept, Path(temporary) / str(number))
            without, _, _ = judged(folder, study, kept, images=False)
            clock = time.perf_counter()
            with_them, flow, _ = judged(folder, study, kept, images=True)
            seconds = time.perf_counter() - clock
            after = "" if flow.rmse_after_px is None else f" -> {flow.rmse_after_px:.3f}"
            print(
                f"| {number} | {case.kind} | {case.amount:+.3f} | {without.state}: {groups(without)}"
                f" | {with_them.state}: {groups(with_them)} | {flow.p:.2g}"
                f" | {flow.rmse_before_px:.3f}{after} | {seconds:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
