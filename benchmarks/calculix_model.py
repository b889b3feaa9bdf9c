"""The same pressed block in CalculiX (ccx, Dhondt 2004): an input deck, one run, the force on the ball.

Neo-Hooke with U = K (J - 1)^2 / 2, penalty contact of the block's top with a rigid cap of a ball. Element C3D8R: C3D8 locks
at every K/mu of interest (a block of 1 mm elements pressed 1 mm: +24 % at K/mu = 5, +53 % at 20, +135 % at 100), C3D8R
agrees with ours within 1 % at K/mu = 20 and is 15 % stiffer at 100.
"""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.meshes.mesh import Mesh

CAP_THICKNESS = 0.3  # mm
ELEMENT = "C3D8R"
TOP_FACE = 2  # CalculiX's number of the face with corners 5 to 8


@dataclass(frozen=True)
class Contact:
    """Constants of the penalty contact."""

    penalty: float  # N/mm^3
    friction: float
    stick: float  # N/mm^3, slope of the friction before it slips


def cap(radius: float, reach: float, size: float, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes (n, 3) and hexahedra (m, 8) of the lowest part of a ball shell, out to a horizontal distance reach."""
    half = np.arctan(reach / np.sqrt(radius**2 - reach**2))
    count = max(8, int(np.ceil(2 * half * radius / size)))
    t = np.tan(np.linspace(-half, half, count + 1))  # equal angles: a square of the cube that becomes a ball
    x, y = np.meshgrid(t, t, indexing="ij")
    direction = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    X = np.concatenate([centre + radius * direction, centre + (radius - CAP_THICKNESS) * direction])
    corner = np.arange((count + 1) ** 2).reshape(count + 1, -1)
    quads = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], -1).reshape(-1, 4)
    return X, np.hstack([quads, quads + len(direction)])


def deck(
    mesh: Mesh, laws: dict[str, Ogden], bulk_to_shear: float, radius: float, depths, contact: Contact
) -> str:
    """Return the input deck; one step per depth."""
    size = np.linalg.norm(mesh.X[mesh.elements[0, 1]] - mesh.X[mesh.elements[0, 0]])
    middle = (mesh.X.max(axis=0)[:2] + mesh.X.min(axis=0)[:2]) / 2
    X, shell = cap(radius, 1.4 * np.sqrt(2 * radius * depths[-1]), size / 2, np.array([*middle, radius]))
    N, E = len(mesh.X), len(mesh.elements)
    lines = ["*NODE, NSET=ALL", *_rows(np.concatenate([mesh.X, X]), "{:.12g}")]
    for r, name in enumerate(mesh.regions):
        numbers = np.flatnonzero(mesh.region == r)
        lines += [f"*ELEMENT, TYPE={ELEMENT}, ELSET={name.upper()}"]
        lines += [f"{e + 1}," + ",".join(map(str, mesh.elements[e] + 1)) for e in numbers]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=CAP"]
    lines += [f"{E + e + 1}," + ",".join(map(str, nodes + N + 1)) for e, nodes in enumerate(shell)]
    for name, law in laws.items():
        if name in mesh.regions:
            mu = law.shear_modulus
            lines += [f"*MATERIAL, NAME=M{name.upper()}", "*HYPERELASTIC, NEO HOOKE"]
            lines += [f"{mu / 2:.10g},{2 / (bulk_to_shear * mu):.10g}"]
            lines += [f"*SOLID SECTION, ELSET={name.upper()}, MATERIAL=M{name.upper()}"]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", "1000.,0.3", "*SOLID SECTION, ELSET=CAP, MATERIAL=STEEL"]
    top = np.flatnonzero((mesh.X[mesh.elements[:, 4:], 2] > -1e-9).all(axis=1))
    lines += ["*SURFACE, NAME=TOP", *(f"{e + 1},S{TOP_FACE}" for e in top)]
    lines += ["*SURFACE, NAME=BALL", *(f"{E + e + 1},S1" for e in range(len(shell)))]
    lines += ["*NSET, NSET=BASE", *(f"{n + 1}," for n in np.flatnonzero(mesh.fixed))]
    lines += ["*NSET, NSET=HELD", *(f"{N + n + 1}," for n in range(len(X)))]
    lines += [
        "*SURFACE INTERACTION, NAME=HARD",
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR",
        f"{contact.penalty:g}",
    ]
    if contact.friction:
        lines += ["*FRICTION", f"{contact.friction:g},{contact.stick:g}"]
    lines += ["*CONTACT PAIR, INTERACTION=HARD, TYPE=SURFACE TO SURFACE", "TOP,BALL"]
    lines += ["*BOUNDARY", "BASE,1,3"]
    for depth in depths:
        lines += ["*STEP, NLGEOM, INC=200", "*STATIC", "1.,1.,1e-3,1."]
        lines += ["*BOUNDARY", "HELD,1,2", f"HELD,3,3,{-depth:.10g}"]
        lines += ["*NODE PRINT, NSET=BASE, TOTALS=ONLY, FREQUENCY=1000", "RF", "*END STEP"]
    return "\n".join(lines) + "\n"


def press(
    mesh: Mesh, laws, bulk_to_shear: float, radius: float, depths, contact: Contact, limit_s: float
) -> list[float]:
    """Return the vertical force [N] on the block's base at each depth reached within limit_s seconds."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "press.inp").write_text(deck(mesh, laws, bulk_to_shear, radius, depths, contact))
        try:
            subprocess.run(
                ["ccx", "press"], cwd=folder, env=os.environ | {"OMP_NUM_THREADS": "1"}, timeout=limit_s,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            pass
        printed = Path(folder, "press.dat").read_text() if Path(folder, "press.dat").exists() else ""
    rows = re.findall(r"total force.*?\n\s*\n((?:\s+[-+0-9.E]+){3})", printed)
    return [float(row.split()[2]) for row in rows]


def _rows(values: np.ndarray, form: str) -> list[str]:
    return [f"{n + 1}," + ",".join(form.format(v) for v in row) for n, row in enumerate(values)]
