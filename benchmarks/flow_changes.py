"""How far a change of the images' flow is what the analysis takes it for: the mean motion's, on a coarser mesh.

The small sensor of flow_channel.py, untouched and with another stiffness of its gel, the same particles in both. Its true
cells are solved on a finer mesh than the study's, images drawn from them. Two tables: by depth, the change that the search
finds in images over that of the true mean motion; by mesh, how far the solved motion and its change are off the true ones.

usage: python benchmarks/flow_changes.py [--kept FOLDER] [--other]      (one thread; ten minutes, one with what was kept)
--other: images by another renderer (other_renderer.py).
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
from flow_channel import STIFFNESSES, Case, record, small_study
from other_renderer import instead_of_the_virtual_labs

from gelforge.config import Study
from gelforge.indentation.cells.cell_file import read_cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import plan_cells
from gelforge.laws_of_study import laws_and_doubts, material_laws_of
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.fem.nominal import observations_of
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.images.flow_images import (
    FlowObservation,
    away_from_indenter,
    even_points,
    likely_particles,
    mean_motion,
    seen_flows,
)
from gelforge.mismatch.images.flow_model import Moved, motions_of

SEED = 77
NEAR_PX = 120.0  # from the indenter: the regions that move most lie within
COARSER = (1.0, 1.25, 1.5, 2.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--kept", type=Path, help="folder of true cells and solutions; a temporary one if left out"
    )
    parser.add_argument("--other", action="store_true", help="images by another renderer")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        kept = arguments.kept or Path(temporary) / "kept"
        study = small_study()
        even = even_points(study.sensor, likely_particles(study.sensor, study.seed).diameter_mm)
        with instead_of_the_virtual_labs() if arguments.other else nullcontext():
            folders = {
                gel: record(_case(gel), study, SEED, kept, Path(temporary) / f"{gel:g}") for gel in _gels()
            }
        sites = [cell for cell in plan_cells(study).values() if cell.source is None]
        by_depth = {depth: _seen(folders, study, depth, sites) for depth in study.plan.depths_mm}
        _print_search(by_depth, sites, kept, even)
        _print_meshes(by_depth[min(by_depth)], sites, study, kept, even)


def _gels() -> list[float]:
    return [1.0, *(1 + amount for amount in STIFFNESSES)]


def _case(gel: float) -> Case:
    return Case("gel_stiffness", gel - 1, gel, (0.0, 0.0, 0.0), {})


def _seen(
    folders: dict[float, Path], study: Study, depth: float, sites: Sequence[PlannedCell]
) -> dict[float, list[FlowObservation]]:
    """Return by stiffness what is seen at a depth, at sites that have true cells, in their order."""
    found = {}
    for gel, folder in folders.items():
        observations, _ = observations_of([folder], study)
        at = {tuple(np.round(xy, 3)): k for k, xy in enumerate(observations.sites)}
        seen = {int(one.row["site"]): one for one in seen_flows([folder], observations, study.sensor, depth)}
        found[gel] = [seen[at[tuple(np.round((s.x_mm, s.y_mm), 3))]] for s in sites]
    return found


def _true_motion(
    seen: FlowObservation, cell: PlannedCell, gel: float, kept: Path, even: np.ndarray
) -> np.ndarray:
    arrays = read_cell(kept / f"truth_{gel:g}" / f"{cell.name}.h5").arrays
    moved = Moved(arrays["gel_node_mm"], arrays["gel_hex"], arrays["gel_displacement_mm"], {})
    return _motion(seen, moved, cell, even)


def _motion(seen: FlowObservation, moved: Moved, cell: PlannedCell, even: np.ndarray) -> np.ndarray:
    step = int(np.argmin(np.abs(np.array(cell.depths_mm) - seen.row["depth_mm"])))
    return mean_motion(seen.eye, even, moved.weights(even) @ moved.base[step].astype(float))


def _print_search(by_depth, sites: Sequence[PlannedCell], kept: Path, even: np.ndarray) -> None:
    print("Changes of the flow in images over those of the true mean motion (least squares over regions)\n")
    print(
        "| depth [mm] | gel | largest motion [px] | all | within 120 px | beyond | residual, share of the change |"
    )
    print("|---|---|---|---|---|---|---|")
    for depth, seen in by_depth.items():
        for gel in _gels()[1:]:
            found, true, near, largest = [], [], [], 0.0
            for before, after, cell in zip(seen[1.0], seen[gel], sites):
                found.append(after.flow - before.flow)
                true.append(
                    _true_motion(after, cell, gel, kept, even) - _true_motion(before, cell, 1.0, kept, even)
                )
                near.append(away_from_indenter(before) < NEAR_PX)
                largest = max(largest, float(np.linalg.norm(before.flow, axis=1).max()))
            a, b, inside = np.concatenate(found), np.concatenate(true), np.concatenate(near)
            left = np.linalg.norm(a - _scale(a, b) * b) / np.linalg.norm(b)
            scales = [_scale(a, b), _scale(a[inside], b[inside]), _scale(a[~inside], b[~inside])]
            print(
                f"| {depth:g} | x {gel:g} | {largest:.2f} | "
                + " | ".join(f"{s:.3f}" for s in (*scales, left))
                + " |"
            )


def _scale(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sum(a * b) / np.sum(b * b))


def _print_meshes(seen, sites: Sequence[PlannedCell], study: Study, kept: Path, even: np.ndarray) -> None:
    print("\nSolved mean motion, root mean square off the true one (share of the motion) and of its change\n")
    print(
        "| mesh, of the study's sizes | the motion | "
        + " | ".join(f"its change, x {g:g}" for g in _gels()[1:])
        + " |"
    )
    print("|---" * (1 + len(_gels())) + "|")
    laws, _ = laws_and_doubts(material_laws_of(study, []))
    solver = Solver(study, laws, {}, kept / "solves")
    least = min(one.row["depth_mm"] for one in seen[1.0])
    paths = [replace(cell, depths_mm=tuple(d for d in cell.depths_mm if d <= least + 1e-6)) for cell in sites]
    true = {
        gel: np.stack([_true_motion(s, cell, gel, kept, even) for s, cell in zip(seen[1.0], sites)])
        for gel in _gels()
    }
    for factor in COARSER:
        solved = {}
        for gel in _gels():
            stiffer = CATALOGUE["gel_stiffness"].to_study(study, {}, (gel - 1,)) if gel != 1 else study
            mesh = stiffer.mechanics.mesh if factor == 1 else stiffer.mechanics.mesh.coarser(factor)
            on_it = stiffer.model_copy(
                update={"mechanics": stiffer.mechanics.model_copy(update={"mesh": mesh})}
            )
            moved = motions_of(solver, on_it, paths)
            solved[gel] = np.stack([_motion(s, m, p, even) for s, m, p in zip(seen[1.0], moved, paths)])
        off = [_off(solved[1.0], true[1.0])]
        off += [_off(solved[gel] - solved[1.0], true[gel] - true[1.0]) for gel in _gels()[1:]]
        print(f"| {factor:g} | " + " | ".join(f"{100 * share:.1f} %" for share in off) + " |", flush=True)


def _off(found: np.ndarray, true: np.ndarray) -> float:
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))


if __name__ == "__main__":
    main()
