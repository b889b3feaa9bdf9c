"""One pressed block in gelforge, FElupe and CalculiX, side by side in one run: unknowns, seconds, force.

usage: python benchmarks/against_peers.py [--size 0.75] [--limit 120]        (one thread; prints a Markdown table)

The same even mesh, neo-Hookean laws, K/mu, ball and eight depths for all; unbalanced force 1e-6. FElupe solves
without friction, with SciPy's SuperLU, its default, and with PARDISO, which its documentation advises. CalculiX
solves to its default tolerance at the K/mu where its element does not lock, without friction and with the paper's;
ours is repeated there. Each code uses one thread, so that CPU time tells on a busy machine too. What is not installed
is left out, by name.
"""
# ruff: noqa: E402  (threads are set before the libraries start theirs)

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import shutil
import time
from importlib import import_module

import numpy as np
import pandas as pd

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.contact.state import Settings
from gelforge.mechanics.indenters.shapes import Sphere
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.meshes.mesh import Block, Mesh, Sizes, layered_block
from gelforge.mechanics.solving.equilibrium import Press

BLOCK = Block(12.0, 12.0, (("gel", 3.0), ("skin", 1.0)))
MIDDLE, RADIUS = (6.0, 6.0), 5.0
LAWS = {
    "gel": Ogden((0.00564,), (2.0,)),
    "skin": Ogden((0.1234,), (2.0,)),
}  # the shear moduli of the paper's gel and skin
DEPTHS = 0.125 * np.arange(1, 9)  # mm
OURS, CALCULIX = 1000.0, 20.0  # K/mu
FORCE = "Fz at 1 mm [N]"
SOLVERS = ("scipy.sparse.linalg", "pypardiso")
PENALTY = 100.0  # N/mm^3; ours needs none
SLIP_STIFFNESS = 3.0  # N/mm^3, of elastic slip, which stays in the solution of CalculiX
FRICTION = 0.45  # the paper's; FElupe's twin has none


def even_mesh(size: float) -> Mesh:
    """Return the block's mesh of even elements, without hanging nodes."""
    return layered_block(BLOCK, *MIDDLE, Sizes(near=size, far=size))


class Clock:
    """Wall and CPU seconds since it was made, of this process and of those it has waited for."""

    def __init__(self):
        self._wall, self._cpu = time.perf_counter(), sum(os.times()[:4])

    def read(self) -> dict:
        return {"wall [s]": time.perf_counter() - self._wall, "CPU [s]": sum(os.times()[:4]) - self._cpu}


def gelforge_row(mesh: Mesh, bulk_to_shear: float, friction: float = 0.0) -> dict:
    """Return our row, from the mesh to the last force."""
    clock = Clock()
    press = Press(Body(mesh, LAWS, bulk_to_shear), Sphere(RADIUS), Settings(friction=friction))
    start = press.start(*MIDDLE)
    states = list(press.follow(start, start.centre - np.outer(DEPTHS, [0.0, 0.0, 1.0])))
    spent = clock.read()
    iterations = sum(s.iterations for s in states)
    return _row("gelforge", mesh, bulk_to_shear, friction, spent, states[-1].force[2], iterations)


def felupe_row(mesh: Mesh, bulk_to_shear: float, library: str) -> dict | None:
    """Return FElupe's row with spsolve of scipy.sparse.linalg or pypardiso, or None where one is not installed."""
    try:
        import felupe_model

        spsolve = import_module(library).spsolve
    except ImportError:
        return None
    clock = Clock()
    block = felupe_model.twin(mesh, LAWS, bulk_to_shear, np.array([*MIDDLE, RADIUS]))
    forces, iterations = felupe_model.press_with_penalty(block, RADIUS, DEPTHS, PENALTY, spsolve, 1e-6)
    name = f"FElupe, {library.split('.')[0]}"
    return _row(name, mesh, bulk_to_shear, 0.0, clock.read(), forces[-1][2], iterations)


def calculix_row(mesh: Mesh, bulk_to_shear: float, friction: float, limit_s: float) -> dict | None:
    """Return CalculiX' row, or None where there is no ccx; without a force if it did not reach the last depth in time."""
    import calculix_model

    if shutil.which("ccx") is None:
        return None
    clock = Clock()
    contact = calculix_model.Contact(PENALTY, friction, SLIP_STIFFNESS)
    forces = calculix_model.press(mesh, LAWS, bulk_to_shear, RADIUS, DEPTHS, contact, limit_s)
    last = -forces[-1] if len(forces) == len(DEPTHS) else np.nan
    name = f"CalculiX {calculix_model.ELEMENT}"
    return _row(name, mesh, bulk_to_shear, friction, clock.read(), last, None)


def _row(code, mesh, bulk_to_shear, friction, spent, force, iterations) -> dict:
    return {
        "code": code,
        "K/mu": bulk_to_shear,
        "friction": friction,
        "unknowns": 3 * int((~mesh.fixed).sum()),
        **spent,
        "iterations": iterations,
        FORCE: force,
    }


def beside(row: dict, ours: dict) -> dict:
    """Return the row with its time and force over ours; no time without the last force."""
    force = row[FORCE] / ours[FORCE]
    return row | {"CPU over ours": row["CPU [s]"] / ours["CPU [s]"] * force / force, "Fz over ours": force}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", type=float, default=0.75, help="element size [mm]")
    parser.add_argument("--limit", type=float, default=120.0, help="seconds that CalculiX may take")
    arguments = parser.parse_args()
    gelforge_row(even_mesh(3.0), OURS)  # loads the compiled kernels
    mesh, limit = even_mesh(arguments.size), arguments.limit
    rows = []
    felupe = {f"FElupe, {name}": lambda name=name: felupe_row(mesh, OURS, name) for name in SOLVERS}
    for ratio, friction, peers in (
        (OURS, 0.0, felupe),
        *(
            (CALCULIX, mu, {"CalculiX": lambda mu=mu: calculix_row(mesh, CALCULIX, mu, limit)})
            for mu in (0.0, FRICTION)
        ),
    ):
        ours = gelforge_row(mesh, ratio, friction)
        rows.append(beside(ours, ours))
        for name, run in peers.items():
            row = run()
            if row is None:
                print(f"{name}: not installed, left out")
            else:
                rows.append(beside(row, ours))
    print(pd.DataFrame(rows).to_markdown(index=False, floatfmt=".4g"))


if __name__ == "__main__":
    main()
