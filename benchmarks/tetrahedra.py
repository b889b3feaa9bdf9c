"""Quadratic tetrahedra against hexahedra on the paper's sensor, and the symmetry of a dome's unsymmetric mesh.

usage: python benchmarks/tetrahedra.py [--near 0.5 0.3] [--reference 0.2]   forces at the centre and what they cost
       python benchmarks/tetrahedra.py --places [--sizes 0.4 1.2]           within the error bars? at four places
       python benchmarks/tetrahedra.py --dome                               mirrored presses against solves of their own
                                                                            (one thread; minutes each)

Sizes are distances between nodes for both kinds of elements. Each mesh runs in a process of its own. The mesher's seconds
are part of a cell's. At the places both have the error bars that are stored; the hexahedra are the default mesh, the
tetrahedra have the given near and far size. They agree where they differ by at most two standard deviations,
2 sqrt(sigma_t^2 + sigma_h^2).
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys

import numpy as np

DEPTHS = tuple(0.25 * (k + 1) for k in range(8))
CENTRE = (16.0, 16.0)
PLACES = {"centre": CENTRE, "half-way": (21.5, 16.0), "edge": (27.0, 16.0), "corner": (27.0, 27.0)}
SHOWN = (1, 3, 7)  # 0.5, 1 and 2 mm
THREADS = {name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}


def one_cell(
    elements: str, near: float | None, far: float | None, place: tuple[float, float], bars: bool
) -> dict:
    """Return what a cell of the paper's sensor cost, its forces (D, 3) and their error bars; no sizes: the default's."""
    from gelforge.api.studies import paper_study
    from gelforge.indentation.paths.planned_cell import PlannedCell
    from gelforge.indentation.sensor.sensor_mesh import sensor_mesh
    from gelforge.indentation.solving.companion import simulate_label
    from gelforge.laws_of_study import laws_of

    study = paper_study()
    laws = laws_of(study, [])

    def with_mesh(bars, **sizes):
        mesh = study.mechanics.mesh.model_copy(update={"elements": elements, **sizes})
        mechanics = study.mechanics.model_copy(update={"mesh": mesh, "error_bars": bars})
        return study.model_copy(update={"mechanics": mechanics})

    coarse = with_mesh(False, near_mm=1.5, far_mm=3.0)
    simulate_label(coarse, laws, {}, PlannedCell("warm", *CENTRE, (0.3,)))  # loads kernels
    fine = with_mesh(bars, **({} if near is None else {"near_mm": near, "far_mm": far}))
    mesh = sensor_mesh(fine.sensor, fine.mechanics.mesh, *place)
    cell = simulate_label(fine, laws, {}, PlannedCell("bench", *place, DEPTHS))
    a = cell.attributes
    sizes = fine.mechanics.mesh
    return {
        "elements": elements,
        "near [mm]": sizes.near_mm,
        "far [mm]": sizes.far_mm,
        "number": len(mesh.elements),
        "unknowns": int(a["degrees_of_freedom"]),
        "CPU [s]": round(a["cpu_seconds"], 1),
        "wall [s]": round(a["seconds"], 1),
        "iterations": int(sum(a["iterations"])),
        "factorisations": int(sum(a["factorisations"])),
        "worst balance": f"{max(a['force_balance'], default=np.nan):.0e}",
        "peak [MiB]": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
        "status": a["status"],
        "companion": int(a.get("companion_unknowns", 0)),
        "force": cell.arrays["total_force_N"].tolist(),
        "sigma": cell.arrays["total_sigma_mesh_N"].tolist() if bars else [],
    }


def in_a_process(elements: str, near: float | None, far: float | None, place, bars: bool) -> dict:
    """Return the same, from a process of its own with one thread."""
    asked = json.dumps([elements, near, far, place, bars])
    command = [sys.executable, __file__, "--one", asked]
    done = subprocess.run(command, env=os.environ | THREADS, capture_output=True, text=True, check=True)
    row = json.loads(done.stdout.splitlines()[-1])
    print(json.dumps(row), file=sys.stderr, flush=True)
    return row


def costs(sizes: list[float], reference: float) -> None:
    """Print forces at the centre and what they cost, next to those of finer hexahedra."""
    import pandas as pd

    meshes = [("hexahedra", reference)]
    meshes += [(elements, near) for near in sizes for elements in ("hexahedra", "tetrahedra")]
    rows = [in_a_process(elements, near, 4 * near, CENTRE, False) for elements, near in meshes]
    forces = [-np.array(row.pop("force"))[:, 2] for row in rows]
    differences = [
        {"elements": row["elements"], "near [mm]": row["near [mm]"]}
        | {f"{d:g} mm": f"{f:.4f} ({100 * (f / r - 1):+.2f} %)" for d, f, r in zip(DEPTHS, force, forces[0])}
        for row, force in zip(rows, forces)
    ]
    print("Fz [N] and its difference to the first row:\n")
    print(pd.DataFrame(differences).to_markdown(index=False))
    print("\nCost:\n")
    print(pd.DataFrame(rows).drop(columns=["sigma", "companion"]).to_markdown(index=False))


def beside(place: str, hexahedra: dict, tetrahedra: dict) -> tuple[list[dict], dict]:
    """Return the table's rows of Fz at a place, and how many of all totals agree within two standard deviations."""
    (h, sigma_h), (t, sigma_t) = (
        (np.array(row["force"]), np.array(row["sigma"])) for row in (hexahedra, tetrahedra)
    )
    within = 2 * np.hypot(sigma_t, sigma_h)
    agree = np.abs(t - h) <= within
    rows = [
        {
            "place": place,
            "depth [mm]": DEPTHS[k],
            "hexahedra, -Fz [N]": f"{-h[k, 2]:.4f} ± {sigma_h[k, 2]:.4f}",
            "tetrahedra, -Fz [N]": f"{-t[k, 2]:.4f} ± {sigma_t[k, 2]:.4f}",
            "difference [%]": round(100 * (t[k, 2] / h[k, 2] - 1), 2),
            "two sigma [%]": round(100 * within[k, 2] / abs(h[k, 2]), 2),
            "within": "yes" if agree[k, 2] else "no",
        }
        for k in SHOWN
    ]
    counts = {f"F{axis} within": f"{agree[:, i].sum()} of {len(agree)}" for i, axis in enumerate("xyz")}
    worst = (np.abs(t - h) / within).max(axis=0)
    counts |= {"largest difference over two sigma, x y z": " ".join(f"{value:.2f}" for value in worst)}
    words = {
        f"unknowns, {r['elements']} (companion)": f"{r['unknowns']} ({r['companion']})"
        for r in (hexahedra, tetrahedra)
    }
    seconds = {f"CPU [s], {r['elements']}": r["CPU [s]"] for r in (hexahedra, tetrahedra)}
    return rows, {"place": place} | counts | words | seconds


def places(near: float, far: float) -> None:
    """Print forces of both elements at several places, with error bars."""
    import pandas as pd

    pairs = {
        name: (
            in_a_process("hexahedra", None, None, at, True),
            in_a_process("tetrahedra", near, far, at, True),
        )
        for name, at in PLACES.items()
    }
    found = [beside(name, *pair) for name, pair in pairs.items()]
    print(pd.DataFrame([row for rows, _ in found for row in rows]).to_markdown(index=False), "\n")
    print(f"Over all {len(DEPTHS)} depths:\n")
    print(pd.DataFrame([counts for _, counts in found]).to_markdown(index=False))


def dome() -> None:
    """Print how far mirrored presses of config/smoke/dome.yaml are from solves of their own, over their error bars."""
    os.environ.update(THREADS)
    import pandas as pd

    from gelforge.config import load_study
    from gelforge.indentation.paths.planned_cell import PlannedCell
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.indentation.solving.companion import simulate_label
    from gelforge.indentation.solving.mirror import mirror_cell
    from gelforge.laws_of_study import laws_of

    study = load_study("config/smoke/dome.yaml")
    laws, planned = laws_of(study, []), plan_cells(study)
    rows, solved = [], {}
    images = {cell.source: cell for cell in planned.values() if cell.source}  # the last of each source
    for image in images.values():
        source = planned[image.source]
        solved[source.name] = simulate_label(study, laws, {}, source)
        mirrored = mirror_cell(solved[source.name], study, laws, image)
        alone = PlannedCell(image.name, image.x_mm, image.y_mm, image.depths_mm)
        own = simulate_label(study, laws, {}, alone)
        m, o = (cell.arrays["total_force_N"] for cell in (mirrored, own))
        bars = np.hypot(*(cell.arrays["total_sigma_mesh_N"] for cell in (mirrored, own)))
        bins = mirrored.arrays["bin_force_N"] - own.arrays["bin_force_N"]
        largest = np.abs(own.arrays["bin_force_N"]).max(axis=(1, 2))
        for k, depth in enumerate(image.depths_mm):
            rows.append(
                {
                    "press [mm]": f"({image.x_mm:g}, {image.y_mm:g}) of ({source.x_mm:g}, {source.y_mm:g})",
                    "depth [mm]": depth,
                    "mirrored, -Fz [N]": round(-m[k, 2], 4),
                    "its own, -Fz [N]": round(-o[k, 2], 4),
                    "difference of Fz [%]": round(100 * (m[k, 2] / o[k, 2] - 1), 2),
                    "largest over two sigma, x y z": round(
                        float(np.max(np.abs(m - o)[k] / (2 * bars[k]))), 2
                    ),
                    "largest of a bin, over the largest bin [%]": round(
                        100 * np.abs(bins[k]).max() / largest[k], 1
                    ),
                }
            )
    print(pd.DataFrame(rows).to_markdown(index=False), end="\n\n")
    rows = [row for name, cell in solved.items() for row in beside_finer(study, laws, planned[name], cell)]
    print(pd.DataFrame(rows).to_markdown(index=False))


def beside_finer(study, laws, planned, cell) -> list[dict]:
    """Return a row per depth: a cell's forces and bars next to a solve with two thirds of its sizes."""
    from gelforge.indentation.solving.companion import simulate_label

    mechanics = study.mechanics.model_copy(
        update={"mesh": study.mechanics.mesh.coarser(2 / 3), "error_bars": False}
    )
    finer = simulate_label(study.model_copy(update={"mechanics": mechanics}), laws, {}, planned)
    F, G = (c.arrays["total_force_N"] for c in (cell, finer))
    bars = cell.arrays["total_sigma_mesh_N"]
    unknowns = [
        cell.attributes["companion_unknowns"],
        *(c.attributes["degrees_of_freedom"] for c in (cell, finer)),
    ]
    return [
        {
            "press [mm]": f"({planned.x_mm:g}, {planned.y_mm:g})",
            "unknowns: companion, cell, finer": ", ".join(map(str, unknowns)),
            "depth [mm]": depth,
            "-Fz [N]": f"{-F[k, 2]:.4f} ± {bars[k, 2]:.4f}",
            "finer, -Fz [N]": round(-G[k, 2], 4),
            "difference over sigma, x y z": ", ".join(f"{v:.2f}" for v in (G - F)[k] / bars[k]),
        }
        for k, depth in enumerate(planned.depths_mm)
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--near", type=float, nargs="+", default=[0.5, 0.3])
    parser.add_argument("--reference", type=float, default=0.2, help="size of the finer hexahedral mesh [mm]")
    parser.add_argument("--places", action="store_true")
    parser.add_argument("--sizes", type=float, nargs=2, default=[0.4, 1.2], metavar=("NEAR", "FAR"))
    parser.add_argument("--dome", action="store_true")
    parser.add_argument("--one", metavar="JSON", help="one cell, for the processes that this starts")
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(one_cell(*json.loads(arguments.one))))
    elif arguments.places:
        places(*arguments.sizes)
    elif arguments.dome:
        dome()
    else:
        costs(arguments.near, arguments.reference)


if __name__ == "__main__":
    main()
