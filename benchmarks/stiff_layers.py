"""Bars of totals next to stiff skins and walls: six sensors, 20 places, several meshes, against half the default sizes.

usage: python benchmarks/stiff_layers.py [--solve | --fit | --nominal] [--sensors NAME ...]

The shares of stiff layers and walls in gelforge/indentation/solving/error_bars.py follow the largest likelihood on the
places of CALIBRATION. The others judge them. Depths are four, evenly. The reference has the steps of the default mesh.
Solutions are kept in results/stiff_layers and are read again: remove them after a change of the solver.
--solve: solve what is missing, print no table. --fit: print by power and decay the shares of largest likelihood there, and
the log likelihood of all errors there and at the other places. --nominal: the bars of a verdict's nominal
forces in place of those of labels. A place takes two CPU minutes on one thread, most of it for the reference.

Printed per sensor and mesh: root mean squares of error and bar [% of Fz], largest error over its bar, and how many 95 %
intervals hold; sideways the same, next to walls alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from itertools import chain, product
from pathlib import Path

import numpy as np
import pandas as pd
from error_bars import WITHIN, of_half_size, rms
from scipy.optimize import minimize
from sensors import ARTICLE

from gelforge.config import Mesh, Study, study_from
from gelforge.config.basis.variants import merged
from gelforge.config.studies.files import read_yaml
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving import resolution as resolution_module
from gelforge.indentation.solving.companion import solve_companion
from gelforge.indentation.solving.error_bars import SHARE_BENDING, Companion, error_bars
from gelforge.indentation.solving.resolution import DECAY, Resolution, resolution_of
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.laws_of_study import laws_of
from gelforge.mismatch.fem.base_bars import base_bars
from gelforge.progress import Progress, show

KEPT = Path("results/stiff_layers")
MESHES = {
    "standard": Mesh(),
    "far 0.6": Mesh(far_mm=0.6),
    "wall_parts: 4": Mesh(wall_parts=4.0),
    "fast": Mesh(quality="fast"),
    "near 0.6, far 2.4": Mesh(near_mm=0.6, far_mm=2.4),
}
STIFF_SKIN = {"elastosil_25_1": {"parameters": {"mu_kPa": [340.0, -0.008], "alpha": [2.8991, -8.2915]}}}


def layered(width_x: float, width_y: float, gel: float, skin: float, wall: float) -> dict:
    """Return the article's sensor with other sizes [mm]."""
    sensor = read_yaml(Path(ARTICLE["sensor"]))
    layers = [layer | {"thickness_mm": thickness} for layer, thickness in zip(sensor["layers"], (gel, skin))]
    return sensor | {"width_x_mm": width_x, "width_y_mm": width_y, "wall_mm": wall, "layers": layers}


def ball(radius: float) -> dict:
    """Return the change of the indenter [mm]."""
    return {"indenter": {"kind": "sphere", "radius_mm": radius}}


# study, deepest [mm], places [mm]
SENSORS = {
    "article": (
        ARTICLE,
        2.0,
        [(5, 5), (7, 16), (4, 16), (11, 12), (16, 16), (6, 10), (8, 8), (5, 12), (9.3, 16.2)],
    ),
    "article, ball of 2.5 mm": (merged(ARTICLE, ball(2.5)), 1.0, [(16, 16)]),
    "article, ball of 10 mm": (merged(ARTICLE, ball(10.0)), 1.5, [(16, 16)]),
    "film of 0.3 mm": (
        merged(ARTICLE, ball(4.0)) | {"sensor": layered(24.0, 24.0, 4.0, 0.3, 0.0)},
        1.2,
        [(12, 12)],
    ),
    "skin 40 times as stiff": (
        merged(ARTICLE, {"materials": STIFF_SKIN}) | {"sensor": layered(28.0, 24.0, 4.0, 1.0, 2.0)},
        1.5,
        [(6, 6), (9, 12), (5, 12), (7.3, 9.1), (14, 12)],
    ),
    "gel of 7 mm": (
        ARTICLE | {"sensor": layered(26.0, 26.0, 7.0, 1.0, 1.0)},
        2.0,
        [(6, 6), (8, 13), (13, 13)],
    ),
}
CALIBRATION = {
    "article": {(5, 5), (7, 16), (4, 16), (11, 12), (16, 16), (6, 10)},
    "article, ball of 2.5 mm": {(16, 16)},
    "film of 0.3 mm": {(12, 12)},
    "skin 40 times as stiff": {(6, 6), (9, 12)},
}


def meshes(name: str) -> list[str]:
    """Return a sensor's meshes. Smaller far elements, which cost most, are for the stiffest skin alone."""
    return [mesh for mesh in MESHES if mesh != "far 0.6" or name == "skin 40 times as stiff"]


def study_of(name: str, mesh: Mesh) -> Study:
    """Return a sensor's study on a mesh."""
    content, deepest, _ = SENSORS[name]
    depths = [deepest * (k + 1) / 4 for k in range(4)]
    study = study_from(
        content | {"plan": {"grid": {"spacing_mm": 8.0, "margin_mm": 5.0}, "depths_mm": depths}}
    )
    return study.model_copy(update={"mechanics": study.mechanics.model_copy(update={"mesh": mesh})})


def solved(name: str, x: float, y: float, mesh: str | None) -> dict[str, np.ndarray]:
    """Return forces of a place on a mesh and on its coarse mesh, or of the reference (None)."""
    path = KEPT / f"{name}_{x:g}_{y:g}_{mesh or 'reference'}.npz".replace(" ", "_").replace(",", "").replace(
        ":", ""
    )
    if not path.is_file():
        study = study_of(name, MESHES[mesh]) if mesh else of_half_size(study_of(name, Mesh()))
        laws, planned = laws_of(study, []), PlannedCell("place", x, y, tuple(study.plan.depths_mm))
        cell = simulate_cell(study, laws, planned)
        if not cell.converged:
            raise SystemExit(f"{name} at ({x:g}, {y:g}) mm, {mesh}: {cell.attributes['reason']}")
        found = {
            "total": cell.arrays["total_force_N"],
            "bins": cell.arrays["bin_force_N"],
            "touched": (cell.arrays["node_state"] > 0).sum(axis=1),
        }
        if mesh:
            companion, _, _ = solve_companion(study, laws, planned, {})
            found |= {"coarse_total": companion.total, "coarse_bins": companion.bins}
        KEPT.mkdir(parents=True, exist_ok=True)
        np.savez(path, **found)
    with np.load(path) as kept:
        return dict(kept)


def shares(
    name: str, x: float, y: float, mesh: str, resolution: Resolution | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return errors and bars (D, 3) of totals over Fz of the reference; resolution: another than the site's own."""
    found, true = solved(name, x, y, mesh), solved(name, x, y, None)["total"]
    study = study_of(name, MESHES[mesh])
    coarse = found["coarse_total"], found["coarse_bins"]
    companion = Companion(*coarse, *(np.empty((0, *values.shape)) for values in coarse))
    if resolution is None:
        resolution = resolution_of(study.sensor, study.mechanics.mesh, laws_of(study, []), x, y)
    shape = study.sensor.bins.ny, study.sensor.bins.nx
    bars = error_bars(found["total"], found["bins"], found["touched"], shape, companion, resolution)
    size = np.abs(true[:, 2:])
    return (found["total"] - true) / size, bars["total_sigma_mesh_N"] / size


def likeliest(power: float, decay: float) -> dict[str, str]:
    """Return the shares of largest likelihood on the places of calibration, by the power of elements and the decay."""
    resolution_module.DECAY = decay
    parts: dict[bool, list] = {True: [], False: []}
    for name, (_, _, places) in SENSORS.items():
        for (x, y), mesh in product(places, meshes(name)):
            study = study_of(name, MESHES[mesh])
            at = resolution_of(study.sensor, study.mechanics.mesh, laws_of(study, []), x, y)
            error, bar = shares(name, x, y, mesh, Resolution(at.through))
            moved = np.ptp([x, study.sensor.width_x_mm / 2]) + np.ptp([y, study.sensor.width_y_mm / 2]) > 0
            parts[(x, y) in CALIBRATION.get(name, set())].append((error, bar, at, moved))

    def loss(logs: np.ndarray, calibration: bool, sideways: bool) -> float:
        total = 0.0
        for error, bar, at, moved in parts[calibration]:
            if sideways and not moved:  # no force sideways in the middle
                continue
            axes = [0, 1] if sideways else [2]
            walls = np.exp(logs[0]) * at.contrast * at.walls
            stiff = (
                0.0 if sideways else min(np.exp(logs[1]) / at.through**power, SHARE_BENDING / at.through**2)
            )
            sigma = np.sqrt(bar[:, axes] ** 2 + walls**2 + (stiff * at.contrast) ** 2)
            total += float((np.log(sigma) + (error[:, axes] / sigma) ** 2 / 2).sum())
        return total

    vertical = minimize(loss, np.log([0.06, 6.0**power / 60]), (True, False), "Nelder-Mead").x
    across = minimize(loss, np.log([0.04]), (True, True), "Nelder-Mead").x
    return {
        "power": f"{power:g}",
        "decay": f"{decay:g}",
        "stiff": f"{np.exp(vertical[1]):.3g}",
        "walls, z": f"{np.exp(vertical[0]):.3f}",
        "walls, x and y": f"{np.exp(across[0]):.3f}",
        "log likelihood z, calibration": f"{-loss(vertical, True, False):.0f}",
        "z, others": f"{-loss(vertical, False, False):.0f}",
        "x and y, calibration": f"{-loss(across, True, True):.0f}",
        "x and y, others": f"{-loss(across, False, True):.0f}",
    }


def nominal_shares(name: str, x: float, y: float, mesh: str) -> tuple[np.ndarray, np.ndarray]:
    """Return errors and a verdict's bars (D, 3) of totals over Fz of the reference."""
    found, true = solved(name, x, y, mesh), solved(name, x, y, None)["total"]
    study, size = study_of(name, MESHES[mesh]), np.abs(true[:, 2:])
    at = resolution_of(study.sensor, study.mechanics.mesh, laws_of(study, []), x, y)
    return (found["total"] - true) / size, base_bars(found["total"], found["coarse_total"], at) / size


def row(
    name: str,
    mesh: str,
    places: list[tuple[float, float]],
    bars: Callable[[str, float, float, str], tuple[np.ndarray, np.ndarray]],
) -> dict[str, str]:
    """Return a row of the table."""
    pairs = [bars(name, x, y, mesh) for x, y in places]
    error, bar = (np.concatenate(values) for values in zip(*pairs))
    kind = "calibration" if set(places) <= CALIBRATION.get(name, set()) else "judged"
    cells = {"sensor": name, "mesh": mesh, "places": f"{len(places)}, {kind}"}
    for label, axes in (("Fz", [2]), ("Fx, Fy", [0, 1])):
        e, s = error[:, axes], bar[:, axes]
        cells |= {
            f"{label}, rms error [%]": f"{100 * rms(e):.2f}",
            f"{label}, rms sigma [%]": f"{100 * rms(s):.2f}",
            f"{label}, largest error over sigma": f"{np.max(np.abs(e) / s):.1f}",
            f"{label} holds [%]": f"{100 * np.mean(np.abs(e) <= WITHIN * s):.0f}",
        }
    return cells


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sensors", nargs="+", choices=SENSORS, default=list(SENSORS), metavar="NAME")
    parser.add_argument("--solve", action="store_true", help="solve what is missing, print no table")
    parser.add_argument("--fit", action="store_true", help="print the shares of largest likelihood")
    parser.add_argument(
        "--nominal", action="store_true", help="print a verdict's bars in place of the labels'"
    )
    options = parser.parse_args()
    work = [(name, x, y) for name in options.sensors for x, y in SENSORS[name][2]]
    show()
    with Progress("places", len(work)) as progress:
        for name, x, y in work:
            for mesh in chain(meshes(name), [None]):
                solved(name, float(x), float(y), mesh)
            progress.advance(note=name)
    if options.solve:
        return
    if options.fit:
        tried = [(3, DECAY), (4, DECAY), (5, DECAY), (6, DECAY), (5, 1.0), (5, 1.5), (5, 3.0)]
        print(
            pd.DataFrame([likeliest(*one) for one in tried]).to_markdown(index=False, disable_numparse=True)
        )
        return
    rows = []
    for name in options.sensors:
        found = CALIBRATION.get(name, set())
        groups = [p for p in SENSORS[name][2] if p in found], [p for p in SENSORS[name][2] if p not in found]
        bars = nominal_shares if options.nominal else shares
        rows += [row(name, mesh, places, bars) for places in groups if places for mesh in meshes(name)]
    print(pd.DataFrame(rows).to_markdown(index=False, disable_numparse=True))


if __name__ == "__main__":
    main()
