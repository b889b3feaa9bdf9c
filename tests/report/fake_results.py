"""A small made-up results folder in the formats of the stages, so that the report can be drawn without a run.

Nothing here is mechanics: forces follow rough closed forms of the right size for the paper's sensor.
"""

from __future__ import annotations

import json
from pathlib import Path

import fake_tables
import fake_verdict
import h5py
import numpy as np
import pandas as pd
from matplotlib.image import imsave

from gelforge.config import Camera, ForceSensor, Session, Study, study_from, write_yaml
from gelforge.files import write_product_json, write_product_table, write_table
from gelforge.hdf5 import writing
from gelforge.indentation.cells.cell_file import Cell, write_cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import plan_cells, variant_cells
from gelforge.materials.basis.measured_effects import MeasuredEffect, MeasuredEffects
from gelforge.materials.fitting.law_file import MaterialLaw, write_law
from gelforge.materials.fitting.material_table import material_table
from gelforge.mechanics.laws.homogeneous import cauchy_stress
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.recording.plausibility.findings import Finding, Findings, write_findings
from gelforge.report.mismatch_page import write_mismatch_page

RADIUS = 5.0
DEPTHS = [0.5, 1.0, 1.5, 2.0]
FAILED = "x0_y2"
REGION_NAMES = ["gel", "skin", "wall"]
CAMERA = Camera(
    width_px=420, height_px=420, focal_px=400.0, centre_px=[209.5, 209.5], position_mm=[16, 16, -32.0]
)


def fake_study(root: Path, sessions: bool = True, spacing: float = 5.5, variants=()) -> Study:
    """Return a study of 5 x 5 positions whose data folder lies under root."""
    given = {"mu_kPa": [7.9652, 0.3093], "alpha": [1.2769, 3.5676]}
    return study_from(
        {
            "study": "fake",
            "data": str(root / "data" / "fake"),
            "materials": {"ecoflex_gel": {"parameters": given}, "elastosil_25_1": {"parameters": given}},
            "sensor": {
                "layers": [
                    {"name": "gel", "thickness_mm": 4.5, "material": "ecoflex_gel"},
                    {"name": "skin", "thickness_mm": 1.5, "material": "elastosil_25_1"},
                ]
            },
            "plan": {"grid": {"spacing_mm": spacing}, "depths_mm": DEPTHS, "symmetry": "none"},
            "sessions": ["day1"] if sessions else [],
            "variants": {name: {"describes": f"with a {name}"} for name in variants},
        }
    )


def fz(cell: PlannedCell, depth: float) -> float:
    off_centre = np.hypot(cell.x_mm - 16, cell.y_mm - 16) / 15.6
    return -0.36 * depth**1.6 * (1 + 0.34 * off_centre**2)


def fake_cell(cell: PlannedCell, failed: bool = False) -> Cell:
    """Return a cell with an ellipsoidal pressure and a smooth dent; a failed one keeps its first depth."""
    depths = np.array(cell.depths_mm[:1] if failed else cell.depths_mm)
    axis_x, axis_y = _graded_axis(cell.x_mm), _graded_axis(cell.y_mm)
    x, y = (a.ravel() for a in np.meshgrid(axis_x, axis_y))
    area = np.outer(np.gradient(axis_y), np.gradient(axis_x)).ravel()
    offset = np.stack([x - cell.x_mm, y - cell.y_mm], axis=-1)
    distance = np.hypot(*offset.T)
    normals, dents, totals, bins = [], [], [], []
    for depth in depths:
        contact = 0.75 * np.sqrt(2 * RADIUS * depth)
        pressure = np.sqrt(np.maximum(0.0, 1 - (distance / contact) ** 2)) * area
        pressure *= -fz(cell, depth) / pressure.sum()
        lean = np.array([cell.x_mm - 16, cell.y_mm - 16]) / 11 * 0.07
        normal = np.column_stack([pressure[:, None] * (offset / RADIUS * 0.6 + lean), -pressure]) + 0.0
        normals.append(normal)
        dents.append(np.column_stack([offset * 0.02 * depth, -_dent(distance, depth)]))
        totals.append(normal.sum(axis=0))
        index = np.minimum(y // 1.6, 19).astype(int) * 20 + np.minimum(x // 1.6, 19).astype(int)
        bins.append(np.stack([np.bincount(index, normal[:, i], 400) for i in range(3)], axis=-1))
    section = _fake_section(cell, depths, axis_x)
    arrays = {
        "depth_mm": depths,
        "shear_mm": np.zeros((len(depths), 2)),
        "tilt_deg": np.zeros((len(depths), 2)),
        "indenter_mm": np.array([[cell.x_mm, cell.y_mm, RADIUS - depth] for depth in depths]),
        "total_force_N": np.array(totals),
        "total_sigma_mesh_N": 0.01 * np.abs(totals),
        "total_sigma_material_N": 0.004 * np.abs(totals),
        "reaction_N": -np.array(totals),
        "side_force_N": np.zeros((len(depths), 3)),
        "bin_force_N": np.array(bins),
        "bin_normal_N": np.array(bins),  # without friction
        "bin_shear_N": np.zeros_like(bins),
        "node_xy_mm": np.stack([x, y], axis=-1),
        "node_area_mm2": area,
        "node_normal_N": np.array(normals),
        "node_shear_N": np.zeros_like(normals),
        "node_state": (np.array(normals)[..., 2] < 0).astype(np.int8),
        "node_displacement_mm": np.array(dents),
        **section,
    }
    attributes = {
        "cell": cell.name,
        "x_mm": cell.x_mm,
        "y_mm": cell.y_mm,
        "status": "failed" if failed else "converged",
        "reason": "no equilibrium at 1 mm after 4 halvings" if failed else "",
        "last_good_depth_mm": float(depths[-1]),
        "seconds": 9.5 + 0.1 * cell.x_mm,
        "iterations": [4] * len(depths),
        "uncertain_materials": ["elastosil_25_1"],
        "leaves_valid_range": (depths > 1.4).astype(np.int8),
        "stretch_range": np.stack([np.column_stack([1 - 0.2 * depths, 1 + 0.4 * depths])] * 2, axis=1),
        "volume_outside_valid_range": np.stack([0.0 * depths, 0.01 * (depths > 1.4)], axis=1),
        "code_version": "0.0.0",
        "settings": json.dumps(
            {"sensor": {"width_x_mm": 32.0, "width_y_mm": 32.0, "bins": {"nx": 20, "ny": 20}}}
        ),
        "regions": REGION_NAMES,
    }
    return Cell(arrays, attributes)


def _graded_axis(at: float) -> np.ndarray:
    coarse = np.linspace(0, 32, 17)
    fine = np.linspace(max(0, at - 4), min(32, at + 4), 17)
    return np.unique(np.round(np.concatenate([coarse[np.abs(coarse - at) > 4.2], fine]), 6))


def _dent(distance, depth):
    ball = depth - (RADIUS - np.sqrt(np.maximum(0, RADIUS**2 - np.minimum(distance, 4) ** 2)))
    return np.maximum(
        ball,
        0.45 * depth * np.exp(-((distance / 3.2) ** 2))
        - 0.12 * depth * np.exp(-(((distance - 6) / 2.5) ** 2)),
    )


def _fake_section(cell: PlannedCell, depths, axis) -> dict[str, np.ndarray]:
    axis = np.unique(np.concatenate([axis, [1.5, 30.5]]))
    z = np.array([-6, -5, -4, -3, -2.2, -1.5, -1.0, -0.5, 0.0])
    x_grid, z_grid = np.meshgrid(axis, z)
    nodes = np.column_stack([x_grid.ravel(), np.full(x_grid.size, cell.y_mm), z_grid.ravel()])
    nx, corner = len(axis), []
    for iz in range(len(z) - 1):
        corner += [
            [iz * nx + i, iz * nx + i + 1, (iz + 1) * nx + i + 1, (iz + 1) * nx + i] for i in range(nx - 1)
        ]
    middle = nodes[np.array(corner)].mean(axis=1)
    in_wall = (middle[:, 0] < 1.5) | (middle[:, 0] > 30.5)
    region = np.where(middle[:, 2] > -1.5, 1, np.where(in_wall, 2, 0))
    rise = (nodes[:, 2] + 6) / 6
    moved = [
        np.column_stack(
            [
                (nodes[:, 0] - cell.x_mm) * 0.02 * d * rise,
                0 * rise,
                -_dent(np.abs(nodes[:, 0] - cell.x_mm), d) * rise,
            ]
        )
        for d in depths
    ]
    return {
        "section_node_mm": nodes,
        "section_quad": np.array(corner),
        "section_region": region,
        "section_displacement_mm": np.array(moved),
    }


def write_cells(study: Study, folder: Path) -> None:
    for name, cell in plan_cells(study).items():
        write_cell(folder / "cells" / f"{name}.h5", fake_cell(cell, failed=name == FAILED))


def write_variants(study: Study, folder: Path) -> None:
    """Write centre and corner of every variant, their forces 3 % larger than the study's."""
    planned = plan_cells(study)
    for variant in study.variants:
        for name in variant_cells(planned, study, variant):
            cell = fake_cell(planned[name])
            arrays = cell.arrays | {"total_force_N": 1.03 * cell.arrays["total_force_N"]}
            write_cell(folder / "variants" / variant / f"{name}.h5", Cell(arrays, cell.attributes))


def write_materials(study: Study, folder: Path) -> None:
    """Write the laws as a fit of synthetic tests would leave them, and the table of their parameters."""
    laws = []
    for name, scale in (("ecoflex_gel", 1.0), ("elastosil_25_1", 20.0)):
        given = study.materials[name].parameters
        law = Ogden(tuple(scale * m / 1e3 for m in given.mu_kPa), tuple(given.alpha))
        tests = ("uniaxial", "pure_shear", "equibiaxial")
        quality, valid, samples = ({test: v for test in tests} for v in (0.997, (1.0, 1.8), 3))
        laws.append(MaterialLaw(name, law, "0" * 64, np.eye(4) * 1e-4, quality, valid, samples, True))
        write_law(folder / "materials" / name / "law.json", laws[-1])
        rows = []
        for test in tests:
            stretch = np.linspace(1, 1.8, 60)
            nominal = cauchy_stress(law, test, stretch) / stretch * 1e3
            for sample, factor in (("s1", 0.96), ("s2", 1.0), ("s3", 1.04), ("mean", 1.0)):
                rows += [(test, sample, x, factor * p * x, factor * p, p) for x, p in zip(stretch, nominal)]
        columns = [
            "test",
            "sample",
            "stretch",
            "cauchy_stress_kPa",
            "nominal_stress_kPa",
            "model_nominal_stress_kPa",
        ]
        write_product_table(folder / "materials" / name / "curves.csv", pd.DataFrame(rows, columns=columns))
        age = MeasuredEffect(
            "age", "uniaxial", "relative change of the nominal stress", 0.3, (0.2, 0.4), "repeats", "1",
            "significant stiffening", "From 0 to 63 days: significant stiffening with age.",
        )  # fmt: skip
        effects = MeasuredEffects(name, (age,), (("friction", "no friction.csv with tilt trials"),))
        write_table(folder / "materials" / name, "effects", effects.table())
        compared = {"law": ["ogden2", "yeoh"], "chosen": [True, False], "AICc difference": [0.0, 12.5]}
        write_table(folder / "materials" / name, "laws", pd.DataFrame(compared))
    write_table(folder / "tables", "material", material_table(laws))


def write_session(study: Study, seed: int = 3) -> None:
    """Write session.yaml and the pictures of the one synthetic session."""
    folder = study.session_folder("day1")
    (folder / "images").mkdir(parents=True)
    session = Session(
        session="day1", synthetic=True, camera=CAMERA, force=ForceSensor(resolution_N=[0.03, 0.03, 0.06])
    )
    write_yaml(folder / "session.yaml", session)
    rng = np.random.default_rng(seed)
    at = rng.uniform(0, 420, (900, 2))
    for name, shift in (("reference.png", 0.0), ("images/p1.png", 9.0)):
        v, u = np.mgrid[:420, :420]
        picture = np.full((420, 420), 30.0)
        for point in at:
            offset = point - 209.5
            u0, v0 = point + shift * offset / 90 * np.exp(-(offset @ offset) / 2 / 60**2)
            window = np.s_[max(0, int(v0) - 8) : int(v0) + 9, max(0, int(u0) - 8) : int(u0) + 9]
            picture[window] += 150 * np.exp(-((u[window] - u0) ** 2 + (v[window] - v0) ** 2) / 8)
        imsave(folder / name, picture.clip(0, 255).astype(np.uint8), cmap="gray", vmin=0, vmax=255)


def write_features(study: Study, folder: Path, regions: int = 40) -> None:
    """Write features/day1.h5: one image per press of every cell, and one untouched row each."""
    rows = [(c, d) for c in plan_cells(study).values() for d in (0.0, *c.depths_mm)]
    axis = (np.arange(regions) + 0.5) * 420 / regions - 210
    u, v = (a.ravel() for a in np.meshgrid(axis, axis))
    size = 9 * np.hypot(u, v) / 90 * np.exp(-(u**2 + v**2) / 2 / 60**2)
    feature = np.array([np.concatenate([size * d / 2, np.arctan2(v, u)]) for _, d in rows], np.float32)
    text = h5py.string_dtype()
    path = folder / "features" / "day1.h5"
    path.parent.mkdir(parents=True)
    with writing(path) as file:
        file.attrs["format"], file.attrs["synthetic"] = "gelforge-features-1", True
        file.create_dataset("cell", data=[c.name for c, _ in rows], dtype=text)
        file.create_dataset("session", data=["day1"] * len(rows), dtype=text)
        file.create_dataset("press", data=[f"{c.name}_{d}" for c, d in rows], dtype=text)
        file.create_dataset("phase", data=["load" if d else "zero" for _, d in rows], dtype=text)
        file.create_dataset("image", data=["p1.png"] * len(rows), dtype=text)
        file["image_index"] = np.zeros(len(rows), int)
        file["position_mm"] = [(c.x_mm, c.y_mm) for c, _ in rows]
        file["depth_mm"] = [d for _, d in rows]
        file["force_N"] = [(0.0, 0.0, fz(c, d)) for c, d in rows]
        file["feature"] = feature
        file["flow_px"] = np.float32([0.02 + 2.5 * d for _, d in rows])
        file["flow_lost"] = np.float32([0.05 if d >= 2 else 0.0 for _, d in rows])


def write_agreement(study: Study, folder: Path, seed: int = 4) -> pd.DataFrame:
    """Write agreement.csv: FEM 12 % softer than the readings, with scatter."""
    rng = np.random.default_rng(seed)
    rows = []
    for cell in plan_cells(study).values():
        lean = np.array([cell.x_mm - 16, cell.y_mm - 16]) / 11 * 0.07
        for depth in cell.depths_mm if cell.name != FAILED else ():
            fem = np.array([*(-fz(cell, depth) * lean), fz(cell, depth)])
            ft = 1.12 * fem + rng.normal(0, [0.01, 0.01, 0.02])
            rows.append(("day1", f"{cell.name}_{depth}", cell.name, cell.x_mm, cell.y_mm, depth, *fem, *ft))
    columns = ["session", "press", "cell", "x_mm", "y_mm", "depth_mm"] + [
        f"{k}_{a}_N" for k in ("fem", "ft") for a in "xyz"
    ]
    table = pd.DataFrame(rows, columns=columns)
    write_product_table(folder / "agreement.csv", table)
    return table


def write_found(study: Study, folder: Path) -> None:
    """Write that one indentation of each session fell into a gap of its force log."""
    for name in study.sessions:
        gap = Finding(
            "gap",
            "excluded",
            "force",
            "has no sample",
            "record without gaps",
            "p00003",
            36.0,
            1.6,
            0.04,
            "s",
            (3,),
        )
        path = folder / "recordings" / f"{name}.findings.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_findings(path, Findings(name, (gap,)))


def write_model(study: Study, folder: Path, seed: int = 5) -> None:
    """Write loss.csv and predictions.h5 of the centre cell and one near an edge."""
    (folder / "model").mkdir()
    number = np.arange(1, 61)
    training, validation = np.exp(-number / 15) + 0.02, 0.9 * np.exp(-number / 15) + 0.05 + number**2 / 1e5
    losses = pd.DataFrame({"step": 16 * number, "training": training, "validation": validation})
    write_product_table(folder / "model" / "loss.csv", losses)
    planned = plan_cells(study)
    rng = np.random.default_rng(seed)
    rows, true = [], []
    for name in ("x2_y2", "x4_y2"):
        cell = fake_cell(planned[name])
        for i, depth in enumerate(planned[name].depths_mm):
            rows.append((name, planned[name].x_mm, planned[name].y_mm, depth))
            true.append(cell.arrays["bin_force_N"][i])
    true = np.array(true)
    predicted = 0.9 * true + np.where(
        np.abs(true) > 0, rng.normal(0, 0.002, true.shape), rng.normal(0, 3e-4, true.shape)
    )
    with writing(folder / "model" / "predictions.h5") as file:
        file.create_dataset("cell", data=[r[0] for r in rows], dtype=h5py.string_dtype())
        file["position_mm"] = [r[1:3] for r in rows]
        file["depth_mm"] = [r[3] for r in rows]
        file["predicted_N"], file["true_N"] = predicted, true
        file["total_force_ft_N"] = 1.12 * true.sum(axis=1)
        file["untouched"] = np.zeros(len(rows), bool)
        file["training_mean_N"] = true.mean(axis=0)


def write_manifest(study: Study, folder: Path) -> None:
    """Write the part of the dataset's manifest that the report reads."""
    rows = {"train": 100, "test": 24, "all": 124}
    content = {
        "rows": rows,
        "shards": [{"name": "shard-00000.h5"}],
        "format": "gelforge-dataset-1",
        "settings": study.model_dump(mode="json"),
    }
    write_product_json(folder / "dataset" / "manifest.json", content)


def write_benchmarks(study: Study, folder: Path) -> None:
    """Write one benchmark file per cell and two other stages."""
    for name in [f"cells/{c}" for c in plan_cells(study)] + ["train", "dataset"]:
        path = folder / "benchmarks" / f"{name}.tsv"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("s\th:m:s\tmax_rss\tcpu_time\n12.5\t0:00:12\t640.2\t12.1\n")


def write_everything(root: Path) -> tuple[Study, Path, Path]:
    """Write a whole study with a synthetic session; return it, its results and the paper's folder."""
    study, folder, paper = fake_study(root, variants=["flange"]), root / "results" / "fake", root / "paper"
    write_cells(study, folder)
    write_variants(study, folder)
    write_materials(study, folder)
    write_session(study)
    write_features(study, folder)
    write_agreement(study, folder)
    write_found(study, folder)
    write_model(study, folder)
    fake_tables.write_error_tables(folder)
    fake_tables.write_verification(folder)
    write_manifest(study, folder)
    write_benchmarks(study, folder)
    fake_tables.write_paper(paper)
    write_mismatch_page(fake_verdict.write_fake_verdict(folder / "mismatch"))
    return study, folder, paper
